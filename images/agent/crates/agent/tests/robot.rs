//! The demo's stack for real: Debian's robot_state_publisher, fed with the PR2 recording.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use rmpv::Value;
use worker::*;

const NODE: &str = "/usr/lib/robot_state_publisher/robot_state_publisher";

/// The joint names of a serialised sensor_msgs/JointState.
fn joints(message: &[u8]) -> Vec<String> {
    let number = |at: usize| u32::from_le_bytes(message[at..at + 4].try_into().unwrap()) as usize;
    // seq, stamp, then frame_id.
    let mut at = 12 + 4 + number(12);
    let count = number(at);
    at += 4;
    (0..count)
        .map(|_| {
            let length = number(at);
            let name = std::str::from_utf8(&message[at + 4..at + 4 + length]).unwrap();
            at += 4 + length;
            name.to_owned()
        })
        .collect()
}

/// A robot with those joints, all on one base, and one fixed link.
fn urdf(joints: &[String]) -> String {
    let one = |name: &String| {
        format!(
            "<link name='{name}_link'/><joint name='{name}' type='continuous'>\
             <parent link='base'/><child link='{name}_link'/><axis xyz='0 0 1'/></joint>"
        )
    };
    let fixed = "<link name='lamp'/><joint name='lamp_joint' type='fixed'>\
                 <parent link='base'/><child link='lamp'/></joint>";
    let joints: String = joints.iter().map(one).collect();
    format!("<robot name='pr2'><link name='base'/>{fixed}{joints}</robot>")
}

/// Each input waits for the answer to the one before: the node's queue holds one message.
fn in_lockstep() -> Value {
    let step = map(&[
        ("trigger", "/joint_states".into()),
        ("answer", "/tf".into()),
        ("deadline", 60.0.into()),
    ]);
    map(&[("mode", "lockstep".into()), ("steps", Value::Array(vec![step]))])
}

#[test]
fn the_pr2_recording_reaches_robot_state_publisher_whole() {
    if without_ros() {
        return;
    }
    let recording = std::fs::read(needed::pr2_recording()).unwrap();
    let bag = Bag::open(MemoryChunkedFile::new(recording.clone())).unwrap();
    let timeline = bag.timeline(|_| true).unwrap();
    let names = joints(timeline.get(0).unwrap().data);
    assert_eq!(names.len(), 42);
    let (start, lead_in) = (bag.time_range().unwrap().0 + 1_000_000_000, 500_000_000);
    let end = start + 3_000_000_000;
    let within = timeline.between(start, end).len() as u64;
    let before = timeline.between(start - lead_in, start).len() as u64;

    let agent = Agent::start(1);
    let parameters = vec![
        ("/robot_description".into(), urdf(&names).as_str().into()),
        ("/use_sim_time".into(), true.into()),
        // Else the node answers at most 50 times a second of the recording's time.
        ("/robot_state_publisher/publish_frequency".into(), 1000.0.into()),
    ];
    let mut case = agent.case_with(&format!("exec {NODE}"), &[], parameters);
    let window = [("lead_in_start", start - lead_in), ("start", start), ("end", end)]
        .map(|(name, time)| (name, Value::from(time)));
    let Value::Map(entries) = &mut case else { panic!("a case is a map") };
    for (key, value) in entries {
        match key.as_str() {
            Some("window") => *value = map(&window),
            Some("topics") => *value = strings(&["/joint_states"]),
            Some("playback") => *value = in_lockstep(),
            Some("record") => *value = map(&[("topics", strings(&["/tf", "/tf_static"]))]),
            _ => {}
        }
    }
    let (result, recorded) = agent.run(0, case, &recording).result();
    let number = |path| at(&result, path).as_u64().unwrap();
    assert_eq!(number("ledger.sent"), within, "{result}");
    assert_eq!(number("ledger.lead_in"), before, "{result}");
    assert_eq!((number("ledger.received"), number("ledger.dropped")), (within, 0), "{result}");
    println!("sent {within} (lead-in {before}), recorded {}", number("recorded.messages"));

    let recorded = Bag::open(MemoryChunkedFile::new(recorded)).unwrap();
    let of = |topic: &str| recorded.timeline(|each| each.topic == topic).unwrap().len();
    assert_eq!(of("/tf_static"), 1);
    assert_eq!(of("/tf") as u64, within);
    let statics = recorded.connections().iter().find(|each| each.topic == "/tf_static");
    assert!(statics.unwrap().latching);
}
