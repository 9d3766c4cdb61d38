//! The real robot_state_publisher of Debian on the real recording of a PR2.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use bagpipe_replay::Mode;
use bagpipe_ros1::Value;
use graph::Graph;
use scene::{TMP, pr2, request, run};

/// Names of the joints in a serialised sensor_msgs/JointState: header (seq, stamp,
/// frame_id), then string[] name.
fn joint_names(data: &[u8]) -> Vec<String> {
    let number = |at: usize| u32::from_le_bytes(data[at..at + 4].try_into().unwrap()) as usize;
    let mut at = 12 + 4 + number(12);
    let count = number(at);
    at += 4;
    let mut names = Vec::new();
    for _ in 0..count {
        let length = number(at);
        names.push(String::from_utf8(data[at + 4..at + 4 + length].to_vec()).unwrap());
        at += 4 + length;
    }
    names
}

/// A robot with those joints, each between the base and a link of its own, and one fixed.
fn urdf(joints: &[String]) -> String {
    let mut text = String::from("<robot name=\"pr2\"><link name=\"base\"/><link name=\"mast\"/>");
    text += "<joint name=\"mast_joint\" type=\"fixed\"><parent link=\"base\"/>\
             <child link=\"mast\"/></joint>";
    for joint in joints {
        text += &format!(
            "<link name=\"{joint}_link\"/><joint name=\"{joint}\" type=\"continuous\">\
             <parent link=\"base\"/><child link=\"{joint}_link\"/><axis xyz=\"0 0 1\"/></joint>"
        );
    }
    text + "</robot>"
}

#[test]
fn a_pr2_drives_the_robot_state_publisher_at_its_own_and_at_four_times_its_speed() {
    // Its queue holds one message, so a loaded machine loses some: how many is not ours to
    // say, but every one must be accounted for.
    pr2_drives(1.0, Some(4_000_000_000));
    pr2_drives(4.0, None);
}

/// Plays the recording, or its first `nanoseconds`.
fn pr2_drives(rate: f64, nanoseconds: Option<u64>) {
    let program = "/usr/lib/robot_state_publisher/robot_state_publisher";
    let bag = pr2();
    let timeline = bag.timeline(|_| true).unwrap();
    let joints = joint_names(timeline.get(0).unwrap().data);
    assert_eq!(joints.len(), 42);
    let graph = Graph::start(TMP);
    let master = graph.client();
    master.set_param("/robot_description", &Value::from(urdf(&joints))).unwrap();
    let _node = graph.spawn(program, &[]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/joint_states".to_owned()];
    request.record_topics = vec!["/tf".to_owned(), "/tf_static".to_owned()];
    request.mode = Mode::Realtime;
    request.rate = rate;
    if let Some(nanoseconds) = nanoseconds {
        request.window.end = request.window.start + nanoseconds;
    }
    let played = timeline.between(request.window.start, request.window.end).len() as u64;
    let replayed = run(&bag, &request).unwrap();
    eprintln!("{}", serde_json::to_string(&replayed).unwrap());
    let ledger = &replayed.ledger;
    assert_eq!(ledger.sent, played);
    assert_eq!(ledger.topics[0].subscribers[0].node, "/robot_state_publisher");
    assert_eq!(ledger.received + ledger.dropped, played);
    assert!(ledger.received > played / 20, "{ledger:?}");
    let counts: Vec<(&str, u64)> = replayed
        .recorded
        .topics
        .iter()
        .map(|topic| (topic.topic.as_str(), topic.messages))
        .collect();
    assert_eq!(counts[0].0, "/tf");
    // It publishes at most 50 times a second of the joint states' own stamps, which are
    // 10 ms apart: every other message at the most, and of those that it got no fewer than that.
    assert!((ledger.received / 4..=played / 2 + 1).contains(&counts[0].1), "{counts:?}");
    assert_eq!(counts[1], ("/tf_static", 1));
}
