//! Topics of several types that somebody publishes whom the graph does not name: nothing of them can be recorded,
//! and nobody counts what there was.

use std::time::Duration;

use bagpipe_replay::{Mode, ReplayError, Replayed};

use crate::scene::{Ask, DEFAULT, RELAY, Scene, recorded, recording};
use crate::standin::eventually;

const TALK: &str = "/talk:std_msgs/msg/String:1000:reliable";
/// A node for which /talk is of another type.
const READS: [&str; 4] = ["--name", "/reads", "--sub", "/talk:sensor_msgs/msg/Imu:10:reliable"];

fn play(scene: &Scene, record: &[&str], messages: u64) -> Result<Replayed, ReplayError> {
    let ask = Ask { mode: Mode::Realtime, record, drain: Duration::from_secs(1), ..DEFAULT };
    scene.play(&recording(&["/in"], messages, 100), &ask)
}

/// Waits until a topic has so many publishers and so many types.
fn await_topic(scene: &Scene, topic: &str, publishers: u64, types: usize) {
    let scout = scene.graph.player();
    eventually(|| {
        let found = scout.topic_of_graph(topic).unwrap();
        (found.publishers, found.types.len()) == (publishers, types)
    });
}

fn missed(played: Result<Replayed, ReplayError>) -> String {
    let error = played.err().unwrap();
    assert_eq!(error.reason(), "RecordingIncomplete");
    error.to_string()
}

#[test]
fn what_nobody_that_is_named_publishes_as_one_of_two_types_is_missed() {
    for messages in [20, 2000] {
        let scene = Scene::new();
        let _reads = scene.start("standin_node", &READS);
        let _relay = scene.start("standin_node", &RELAY);
        let program = ["/other", "/talk", "std_msgs/String"];
        let _program = scene.start_uncounted("dds_relay", &program);
        await_topic(&scene, "/talk", 1, 2);
        let text = missed(play(&scene, &["/out", "/talk"], messages));
        assert!(text.contains("/talk was not recorded, and has publishers (at least 1)"), "{text}");
    }
}

#[test]
fn nor_is_it_recorded_beside_what_is_played_as_another_type() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let _program = scene.start_uncounted("dds_relay", &["/other", "/in", "std_msgs/String"]);
    await_topic(&scene, "/in", 1, 2);
    let text = missed(play(&scene, &["/out", "/in"], 1000));
    assert!(text.contains("/in was not recorded, and has publishers (at least 1)"), "{text}");
}

#[test]
fn a_topic_of_two_types_that_nobody_publishes_lacks_nothing() {
    let scene = Scene::new();
    let _reads = scene.start("standin_node", &READS);
    let other = ["--name", "/other", "--sub", TALK];
    let _other = scene.start("standin_node", &other);
    let _relay = scene.start("standin_node", &RELAY);
    await_topic(&scene, "/talk", 0, 2);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}

#[test]
fn nor_does_one_whose_publisher_counts_and_has_published_nothing() {
    let scene = Scene::new();
    let _reads = scene.start("standin_node", &READS);
    // Which of two nodes of one name is shown is the graph's choice: so it is with whichever began first.
    let _relay = scene.start("standin_node", &RELAY);
    let _silent = scene.start("standin_node", &["--name", "/relay", "--pub", TALK]);
    await_topic(&scene, "/talk", 1, 2);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}

#[test]
fn what_only_a_program_publishes_that_is_no_node_is_recorded_as_the_one_type_that_it_has() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let _program = scene.start_uncounted("dds_relay", &["/in", "/talk", "sensor_msgs/Imu"]);
    await_topic(&scene, "/talk", 1, 1);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    let talked = recorded(&replayed).iter().filter(|one| one.0 == "/talk").count();
    assert!(talked > 0, "{talked}");
    let warnings = replayed.playback.warnings.join("; ");
    let named = "programs of DDS that are no nodes, or nodes of a name that another has, publish /talk (at least 1)";
    assert!(warnings.contains(named), "{warnings}");
}
