//! Recordings of ROS 2 played into nodes of other processes over Cyclone DDS: all that is sent is
//! taken and called back, all that is published is recorded, and lock-step is the same each time.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::time::Duration;

use bagpipe_replay::{AnswerBy, Mode, Strength};
use scene::{Ask, MS, Scene, recorded, recording};

const RELAY: [&str; 8] = [
    "--name",
    "/relay",
    "--sub",
    "/in:sensor_msgs/msg/Imu:10:reliable",
    "--pub",
    "/out:std_msgs/msg/String:10:reliable",
    "--relay",
    "/in=/out",
];

#[test]
fn at_full_speed_nothing_is_lost_and_all_that_is_answered_is_recorded() {
    for (program, strength) in
        [("standin_node", Strength::Called), ("standin_node_py", Strength::Taken)]
    {
        let scene = Scene::new();
        let _relay = scene.start(program, &RELAY);
        let mcap = recording(&["/in"], 5000, 1000);
        let replayed = scene.play(&mcap, &Ask::default()).unwrap();
        let ledger = &replayed.ledger;
        assert_eq!((ledger.sent, ledger.received, ledger.dropped), (5000, 5000, 0), "{program}");
        assert_eq!(ledger.strength, Some(strength));
        assert_eq!(ledger.topics[0].subscribers[0].node, "/relay");
        assert_eq!(recorded(&replayed).len(), 5000);
    }
}

#[test]
fn the_slowest_of_several_nodes_governs_and_each_has_its_line() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let slow =
        ["--name", "/slow", "--sub", "/in:sensor_msgs/msg/Imu:1:best_effort", "--delay-us", "300"];
    let _slow = scene.start("standin_node", &slow);
    // The play begins once a subscriber is there for each topic: the slow one's own.
    let other =
        ["--name", "/other", "--sub", "/also:sensor_msgs/msg/Imu:3:reliable", "--threads", "3"];
    let _other = scene.start("standin_node", &other);
    scene.await_subscriptions(3);
    let replayed = scene.play(&recording(&["/in", "/also"], 1000, 2000), &Ask::default()).unwrap();
    let lines: Vec<(&str, &str, u64, u64)> = replayed
        .ledger
        .topics
        .iter()
        .flat_map(|topic| {
            topic
                .subscribers
                .iter()
                .map(|line| (topic.topic.as_str(), line.node.as_str(), line.received, line.dropped))
        })
        .collect();
    let expected =
        [("/in", "/relay", 500, 0), ("/in", "/slow", 500, 0), ("/also", "/other", 500, 0)];
    assert_eq!(lines, expected);
    assert_eq!(replayed.ledger.strength, Some(Strength::Called));
}

#[test]
fn messages_of_a_mebibyte_arrive_one_after_the_other() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let replayed = scene.play(&recording(&["/in"], 60, 1 << 20), &Ask::default()).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (60, 60, 0));
    assert_eq!(recorded(&replayed).len(), 60);
}

#[test]
fn in_realtime_the_lead_in_is_counted_apart() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let ask = Ask { mode: Mode::Realtime, lead_in: 100 * MS, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 300, 100), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.lead_in, ledger.sent, ledger.received, ledger.dropped), (100, 200, 200, 0));
    assert_eq!(recorded(&replayed).len(), 200);
}

/// A lock-step play of two inputs, of which the slower one decides the answer's time.
fn in_lock_step(program: &str, by: AnswerBy) -> Vec<(String, u64, Vec<u8>)> {
    let scene = Scene::new();
    let relay = [&RELAY[..], &["--use-sim-time"]].concat();
    let _relay = scene.start(program, &relay);
    let second = [
        "--name",
        "/second",
        "--sub",
        "/more:sensor_msgs/msg/Imu:2:reliable",
        "--pub",
        "/out2:geometry_msgs/msg/PoseStamped:1:reliable",
        "--relay-stamp",
        "/more=/out2",
        "--delay-us",
        "200",
    ];
    let _second = scene.start(program, &second);
    scene.await_subscriptions(3);
    let steps = match by {
        AnswerBy::Count => &[("/in", "/out")][..],
        AnswerBy::Stamp => &[("/more", "/out2")][..],
    };
    let ask = Ask { mode: Mode::Lockstep, steps, by, use_sim_time: true, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in", "/more"], 400, 100), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (400, 400, 0));
    assert_eq!(replayed.playback.steps[0].answered, 200);
    recorded(&replayed)
}

#[test]
fn two_lock_step_runs_record_the_same_messages_at_the_same_times() {
    let first = in_lock_step("standin_node", AnswerBy::Count);
    assert_eq!(first.len(), 400);
    // Each answer has the time of its input, though one of the two is awaited by no step.
    let times: Vec<u64> = first.iter().map(|(_, time, _)| time / MS).collect();
    assert_eq!(times, (1000..1400).collect::<Vec<_>>());
    assert_eq!(in_lock_step("standin_node", AnswerBy::Count), first);
    assert_eq!(in_lock_step("standin_node", AnswerBy::Stamp), first);
    // A node without tracepoints is seen to come back for more.
    assert_eq!(in_lock_step("standin_node_py", AnswerBy::Count), first);
}

#[test]
fn a_node_that_is_killed_has_lost_what_it_did_not_take() {
    let scene = Scene::new();
    let dies = [&RELAY[..], &["--die-after", "50"]].concat();
    let _relay = scene.start("standin_node", &dies);
    let replayed = scene.play(&recording(&["/in"], 200, 100), &Ask::default()).unwrap();
    let line = &replayed.ledger.topics[0].subscribers[0];
    assert_eq!((replayed.ledger.sent, line.received, line.dropped), (200, 50, 150));
    assert_ne!(line.strength, Strength::Called);
}

#[test]
fn who_asks_for_more_than_was_recorded_is_named() {
    let scene = Scene::new();
    let late = ["--name", "/late", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable:transient_local"];
    let _late = scene.start("standin_node", &late);
    let ask = Ask { record: &["/none"], deadline: Duration::from_secs(3), ..Ask::default() };
    let error = scene.play(&recording(&["/in"], 5, 100), &ask).err().unwrap();
    assert_eq!(error.reason(), "NeverSubscribed");
    let sentence = error.to_string();
    assert!(
        sentence.contains("/late subscribes to /in, but it wants what was published"),
        "{sentence}"
    );
}

#[test]
fn a_subscriber_that_does_not_count_is_there_and_nothing_of_it_is_proved() {
    let scene = Scene::new();
    let _hidden = scene.start_uncounted("standin_node", &RELAY);
    let replayed = scene.play(&recording(&["/in"], 20, 100), &Ask::default()).unwrap();
    let line = &replayed.ledger.topics[0].subscribers[0];
    assert_eq!((line.node.as_str(), line.received, line.strength), ("/relay", 0, Strength::Sent));
}
