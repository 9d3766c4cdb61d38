//! Publishers of the stack beside our recorder and beside our player: what they publish is none of
//! ours, and comes before their calls have returned, as on a busy machine.
#![allow(clippy::unwrap_used)]

mod lost;
#[path = "../scene/mod.rs"]
mod scene;
#[path = "../../../ros2player/tests/standin/mod.rs"]
mod standin;
mod stopped;
mod unclear;
mod whole;

use bagpipe_log::Connection;
use bagpipe_replay::{Ledger, Mode, Strength};
use bagpipe_ros2ledger::{Counts, Endpoint, Kind};
use scene::{Ask, DEFAULT, Scene, imu, recorded, recording};
use standin::Node;

const RELIABLE: &str =
    "- history: keep_last\n  depth: 1000\n  reliability: reliable\n  durability: volatile\n";
const LATCHED: &str =
    "- history: keep_last\n  depth: 100\n  reliability: reliable\n  durability: transient_local\n";
const OUT: [&str; 2] = ["--pub", "/out:std_msgs/msg/String:5000:reliable"];

/// A channel of strings, which the stand-in's nodes publish as well.
fn strings(qos: &str) -> Connection {
    Connection {
        datatype: "std_msgs/msg/String".to_owned(),
        definition: "string data\n".into(),
        offered_qos: Some(qos.to_owned()),
        ..imu("/in")
    }
}

/// A node of the stack that answers what is played on /in, of which its queue holds so many: not what the
/// stack publishes, which is shorter.
fn start_lane(scene: &Scene, depth: &str, more: &[&str]) -> Node {
    let queue = format!("/in:std_msgs/msg/String:{depth}:reliable");
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--answers-from", "60", "--sub", &queue];
    scene.start("standin_node", &[&lane[..], &OUT, more].concat())
}

/// One that publishes /in as well.
fn start_other(scene: &Scene, more: &[&str]) -> Node {
    let other = ["--name", "/other", "--pub", "/in:std_msgs/msg/String:1000:reliable"];
    scene.start("standin_node", &[&other[..], more].concat())
}

/// What a node has done on a topic.
fn counts(scene: &Scene, kind: Kind, node: &str, topic: &str) -> Counts {
    let all = scene.ledger.endpoints().unwrap();
    let of = |one: &&Endpoint| one.kind == kind && one.node == node && one.topic == topic;
    all.iter().find(of).map(|one| one.counts).unwrap_or_default()
}

/// Messages of ours that the node has answered by now.
fn answered(scene: &Scene) -> u64 {
    counts(scene, Kind::Publisher, "/lane", "/out").published
}

/// What was sent, received and lost, by how far it is proved.
fn line(ledger: &Ledger) -> (u64, u64, u64, Option<Strength>) {
    (ledger.sent, ledger.received, ledger.dropped, ledger.strength)
}

/// The line of a play in which nothing was lost.
fn whole(sent: u64) -> (u64, u64, u64, Option<Strength>) {
    (sent, sent, 0, Some(Strength::Called))
}

#[test]
fn who_has_published_before_and_returns_late_lacks_nothing_of_the_recording() {
    let scene = Scene::new();
    let words = ["--name", "/relay", "--relay", "/in=/out", "--returns-late-us", "30000"];
    let (input, output) =
        ("/in:sensor_msgs/msg/Imu:10:reliable", "/out:std_msgs/msg/String:100:reliable");
    let ends = ["--sub", input, "--pub", output];
    let _relay = scene.start("standin_node", &[&words[..], &ends].concat());
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    for _before in 0..2 {
        let replayed = scene.play(&recording(&["/in"], 30, 50), &ask).unwrap();
        assert_eq!(recorded(&replayed).len(), 30);
    }
}
