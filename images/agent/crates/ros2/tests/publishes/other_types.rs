//! Topics of several types, some of whose publishers the graph does not name.

use std::time::Duration;

use bagpipe_mcap::Mcap;
use bagpipe_replay::{Mode, ReplayError, Replayed};

use crate::scene::{Ask, DEFAULT, RELAY, Scene, recorded, recording};
use crate::standin::eventually;

const TALK: &str = "/talk:std_msgs/msg/String:1000:reliable";
/// A node for which /talk is of another type.
const READS: [&str; 4] = ["--name", "/reads", "--sub", TALK];

fn play(scene: &Scene, record: &[&str], messages: u64) -> Result<Replayed, ReplayError> {
    let ask = Ask { mode: Mode::Realtime, record, drain: Duration::from_secs(1), ..DEFAULT };
    scene.play(&recording(&["/in"], messages, 100), &ask)
}

/// Waits until a topic has so many publishers.
fn await_topic(scene: &Scene, topic: &str, publishers: usize) {
    let scout = scene.graph.player();
    eventually(|| scout.publishers_of(topic).unwrap().len() == publishers);
}

fn missed(played: Result<Replayed, ReplayError>) -> String {
    let error = played.err().unwrap();
    assert_eq!(error.reason(), "RecordingIncomplete");
    error.to_string()
}

/// How many messages of a topic were recorded, each as this type.
fn as_type(replayed: &Replayed, topic: &str, datatype: &str) -> usize {
    let mcap = Mcap::open(replayed.recorded_bag.clone()).unwrap();
    let of_topic = mcap.connections().iter().filter(|one| one.topic == topic);
    assert!(of_topic.into_iter().all(|one| one.datatype == datatype));
    recorded(replayed).iter().filter(|one| one.0 == topic).count()
}

const OTHER_TYPE: &str =
    "publish it as std_msgs/msg/String, and it is recorded as sensor_msgs/msg/Imu";

#[test]
fn what_only_a_program_publishes_that_is_no_node_is_recorded_as_its_own_type() {
    // Whoever subscribes as another type, and by a pattern as well as by its name.
    for (messages, record) in [(20, "/talk"), (2000, "/talk"), (1000, "/ta.k")] {
        let scene = Scene::new();
        let _reads = scene.start("standin_node", &READS);
        let _relay = scene.start("standin_node", &RELAY);
        let _program = scene.start_uncounted("dds_relay", &["/in", "/talk", "sensor_msgs/Imu"]);
        await_topic(&scene, "/talk", 1);
        let replayed = play(&scene, &["/out", record], messages).unwrap();
        assert!(as_type(&replayed, "/talk", "sensor_msgs/msg/Imu") > 0);
        let warnings = replayed.playback.warnings.join("; ");
        let named = "programs of DDS that are no nodes, or nodes of a name that another has, publish /talk (at least 1)";
        assert!(warnings.contains(named), "{warnings}");
    }
}

#[test]
fn what_is_published_as_another_type_than_a_node_s_is_missed_of_who_does_not_count() {
    for messages in [20, 2000] {
        let scene = Scene::new();
        let talks = ["--name", "/talks", "--pub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
        let _talks = scene.start("standin_node", &talks);
        let _relay = scene.start("standin_node", &RELAY);
        let _program = scene.start_uncounted("dds_relay", &["/other", "/talk", "std_msgs/String"]);
        await_topic(&scene, "/talk", 2);
        let text = missed(play(&scene, &["/out", "/talk"], messages));
        assert!(text.contains("/talk has publishers (at least 1) that do not count"), "{text}");
        assert!(text.contains(OTHER_TYPE), "{text}");
    }
}

#[test]
fn so_it_is_of_a_node_whose_name_another_has() {
    let scene = Scene::new();
    let talks = ["--name", "/talks", "--pub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
    let _talks = scene.start("standin_node", &talks);
    let _relay = scene.start("standin_node", &RELAY);
    let _namesake = scene.start_uncounted("standin_node", &["--name", "/talks", "--pub", TALK]);
    await_topic(&scene, "/talk", 2);
    let text = missed(play(&scene, &["/out", "/talk"], 1000));
    assert!(text.contains("/talk has publishers (at least 1) that do not count"), "{text}");
}

#[test]
fn who_counts_and_has_published_nothing_as_another_type_is_missed_by_nobody() {
    let scene = Scene::new();
    let talks = ["--name", "/talks", "--pub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
    let _talks = scene.start("standin_node", &talks);
    let _relay = scene.start("standin_node", &RELAY);
    let _silent = scene.start("standin_node", &["--name", "/silent", "--pub", TALK]);
    let _namesake = scene.start("standin_node", &["--name", "/talks", "--pub", TALK]);
    await_topic(&scene, "/talk", 3);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}

#[test]
fn what_is_played_as_another_type_is_recorded_as_the_stack_publishes_it() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let _program = scene.start_uncounted("dds_relay", &["/other", "/in", "std_msgs/String"]);
    await_topic(&scene, "/in", 1);
    let replayed = play(&scene, &["/out", "/in"], 1000).unwrap();
    assert_eq!(as_type(&replayed, "/in", "std_msgs/msg/String"), 0);
}

#[test]
fn a_topic_of_two_types_that_nobody_publishes_lacks_nothing() {
    let scene = Scene::new();
    let _reads = scene.start("standin_node", &READS);
    let other = ["--name", "/other", "--sub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
    let _other = scene.start("standin_node", &other);
    let _relay = scene.start("standin_node", &RELAY);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}
