//! What a node publishes reaches the recorder and other nodes though it is larger than a socket.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use bagpipe_replay::Mode;
use bagpipe_ros2ledger::Flow;
use scene::{Ask, DEFAULT, RELAY, Scene, recording};

/// More than a socket of Cyclone DDS holds on any machine.
const LARGE: &str = "4000000";
const MESSAGES: u64 = 2;

/// A node that answers each message with one of so many bytes, played to in a scene.
fn played(reliability: &str, ask: &Ask<'_>) -> u64 {
    let scene = Scene::new();
    let output = format!("/out:std_msgs/msg/String:100:{reliability}");
    let relay = ["--name", "/relay", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
    let answers = ["--pub", &output, "--relay", "/in=/out", "--answer-bytes", LARGE];
    let _relay = scene.start("standin_node", &[&relay[..], &answers[..]].concat());
    let replayed = scene.play(&recording(&["/in"], MESSAGES, 100), ask).unwrap();
    replayed.recorded.messages
}

#[test]
fn at_the_subscribers_pace_all_of_it_reaches_the_recorder() {
    for reliability in ["best_effort", "reliable"] {
        for mode in [Mode::Max, Mode::Lockstep] {
            let recorded = played(reliability, &Ask { mode, ..DEFAULT });
            assert_eq!(recorded, MESSAGES, "{reliability} {mode:?}");
        }
    }
}

#[test]
fn where_a_job_asks_for_it_the_nodes_publish_as_without_a_ledger() {
    let mut scene = Scene::new();
    scene.flow_control = false;
    let _relay = scene.start("standin_node", &RELAY);
    for mode in [Mode::Max, Mode::Realtime] {
        scene.ledger.control_flow(Flow::Controlled);
        scene.play(&recording(&["/in"], 5, 100), &Ask { mode, ..DEFAULT }).unwrap();
        assert_eq!(scene.ledger.flow(), Flow::Free, "{mode:?}");
    }
}
