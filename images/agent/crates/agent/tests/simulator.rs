//! A simulator at the worker's end of the pipe: its turns, and what ends them early.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::time::Duration;

use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use bagpipe_wire::{Duplex, End, FileHeader, FrameType, OwnedFrame, to_map};
use rmpv::Value;
use worker::*;

/// A rospy node that answers every /chatter with an /echo.
const ECHO: &str = r#"exec /usr/bin/python3 -u -c '
import rospy
from std_msgs.msg import String
rospy.init_node("echo")
out = rospy.Publisher("/echo", String, queue_size=10)
rospy.Subscriber("/chatter", String, lambda m: out.publish("echo of " + m.data), queue_size=10)
rospy.spin()
'"#;
const SECOND: u64 = 1_000_000_000;

fn drive(agent: &Agent, script: &str) -> Value {
    let Value::Map(mut case) = agent.case(script, &[("subscribe", 100.0), ("stop", 2.0)]) else {
        panic!("a case is a map")
    };
    case.retain(|(key, _)| !["playback", "window"].contains(&key.as_str().unwrap()));
    let step = map(&[
        ("trigger", "/chatter".into()),
        ("answer", "/echo".into()),
        ("deadline", 60.0.into()),
    ]);
    let playback = map(&[
        ("mode", "lockstep".into()),
        ("rate", 1.0.into()),
        ("steps", Value::Array(vec![step])),
    ]);
    let publication = map(&[
        ("topic", "/chatter".into()),
        ("type", "std_msgs/String".into()),
        ("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1".into()),
        ("definition", "string data\n".into()),
        ("latching", false.into()),
    ]);
    let simulator = map(&[("publications", Value::Array(vec![publication]))]);
    case.push(("playback".into(), playback));
    case.push(("simulator".into(), simulator));
    case.push(("window".into(), window(SECOND, 4 * SECOND)));
    Value::Map(case)
}

fn text(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat()
}

fn step(link: &mut Duplex, time: u64, place: u64, data: Vec<u8>) {
    let message = Value::Array(vec![place.into(), Value::Binary(data)]);
    let fields = map(&[("time", time.into()), ("messages", Value::Array(vec![message]))]);
    let mut payload = Vec::new();
    rmpv::encode::write_value(&mut payload, &fields).unwrap();
    send(link, FrameType::Step, &payload);
}

/// The next frame that is no METRIC.
fn next(link: &mut Duplex) -> OwnedFrame {
    loop {
        let frame = receive(link);
        if frame.kind != FrameType::Metric {
            return frame;
        }
    }
}

/// The agent's turn: the stack's messages in ANSWER.
fn answered(link: &mut Duplex) -> Vec<Value> {
    let frame = next(link);
    assert_eq!(frame.kind, FrameType::Answer, "{}", String::from_utf8_lossy(&frame.payload));
    let fields = rmpv::decode::read_value(&mut &frame.payload[..]).unwrap();
    at(&fields, "messages").as_array().unwrap().clone()
}

fn refused(wrong: impl Fn(&mut Duplex)) -> String {
    let agent = Agent::start(1);
    let mut link = agent.greet(0, drive(&agent, ECHO));
    assert!(answered(&mut link).is_empty());
    wrong(&mut link);
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "ProtocolError");
    until("nothing is left", Duration::from_secs(60), || agent.left().is_empty());
    abort.message
}

#[test]
fn turns_go_on_until_the_world_ends_and_both_sides_are_recorded() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let mut link = agent.greet(0, drive(&agent, ECHO));
    assert!(answered(&mut link).is_empty());
    for number in 0..3 {
        step(&mut link, (1 + number) * SECOND, 0, text(&format!("turn {number}")));
        let expected = Value::Array(vec![
            "/echo".into(),
            "std_msgs/String".into(),
            Value::Binary(text(&format!("echo of turn {number}"))),
        ]);
        assert_eq!(answered(&mut link), [expected]);
    }
    let end = link.encoder().end();
    assert_eq!((end.files, end.bytes), (0, 0));
    send(&mut link, FrameType::End, &to_map(&end).unwrap());
    let (result, bag) = answer(&mut link).result();
    assert_eq!(at(&result, "ledger.sent").as_u64(), Some(3));
    assert_eq!(at(&result, "ledger.received").as_u64(), Some(3));
    assert_eq!(at(&result, "playback.steps.0.answered").as_u64(), Some(3));
    let bag = Bag::open(MemoryChunkedFile::new(bag)).unwrap();
    let timeline = bag.timeline(|_| true).unwrap();
    let mut recorded = Vec::new();
    for place in 0..timeline.len() {
        let message = timeline.get(place).unwrap();
        let connection = bag.connections().iter().find(|c| c.id == message.connection).unwrap();
        recorded.push((message.time / SECOND, connection.topic.clone()));
    }
    let expected: Vec<_> = (1..=3)
        .flat_map(|time| [(time, "/chatter".to_owned()), (time, "/echo".to_owned())])
        .collect();
    assert_eq!(recorded, expected);
    let callers: Vec<_> = bag.connections().iter().map(|c| c.caller_id.clone().unwrap()).collect();
    assert_eq!(callers, ["/bagpipe_simulator", "/echo"]);
}

#[test]
fn a_worker_that_leaves_between_turns_frees_the_slot() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let mut link = agent.greet(0, drive(&agent, ECHO));
    answered(&mut link);
    step(&mut link, SECOND, 0, text("the last word"));
    answered(&mut link);
    assert!(!agent.left().is_empty());
    drop(link);
    until("nothing is left", Duration::from_secs(60), || agent.left().is_empty());
    let mut link = agent.greet(0, drive(&agent, ECHO));
    assert!(answered(&mut link).is_empty());
}

#[test]
fn a_stack_that_ends_while_the_worker_thinks_is_reported() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let end = folder.path().join("end");
    let dies = format!(
        "import os, time\nwhile not os.path.exists(\"{}\"): time.sleep(0.05)\nos._exit(4)",
        end.display()
    );
    let mut link = agent.greet(0, drive(&agent, &ECHO.replace("rospy.spin()", &dies)));
    answered(&mut link);
    std::fs::write(&end, "").unwrap();
    let abort = answer(&mut link).abort();
    assert_eq!((abort.reason.as_str(), abort.exit_status), ("StackCrashed", Some(4)));
    assert!(abort.message.contains("during the play"), "{}", abort.message);
}

#[test]
fn time_must_advance() {
    if without_ros() {
        return;
    }
    let message = refused(|link| {
        step(link, 2 * SECOND, 0, text("a"));
        answered(link);
        step(link, 2 * SECOND, 0, text("b"));
    });
    assert_eq!(
        message,
        "the simulator's time must advance: 2000000000 ns came after 2000000000 ns"
    );
}

#[test]
fn a_topic_that_was_not_announced_and_a_frame_out_of_turn_are_refused() {
    if without_ros() {
        return;
    }
    let message = refused(|link| step(link, SECOND, 7, text("a")));
    assert_eq!(message, "the simulator speaks on topic number 7, and it has 1");
    let header = FileHeader { name: "a.bag".to_owned(), size: 0, ranges: vec![] };
    let file = to_map(&header).unwrap();
    let message = refused(|link| send(link, FrameType::File, &file));
    assert_eq!(message, "expected STEP or END, and FILE came");
    let message = refused(|link| {
        let end = End { files: 1, bytes: 0, digest: 7 };
        send(link, FrameType::End, &to_map(&end).unwrap());
    });
    assert!(message.starts_with("END says End { files: 1"), "{message}");
}

#[test]
fn a_simulator_without_lock_step_is_refused() {
    let agent = Agent::start(1);
    let Value::Map(mut case) = drive(&agent, ECHO) else { panic!("a case is a map") };
    case.retain(|(key, _)| key.as_str() != Some("playback"));
    let mut link = agent.greet(0, Value::Map(case));
    let abort = answer(&mut link).abort();
    assert_eq!(abort.message, "case case-1: a simulator plays in lock-step only");
}
