//! Who else is at a topic. Publishers of the stack beside our recorder and beside our player: what they
//! publish is none of ours, and comes before their calls have returned, as on a busy machine. Subscribers
//! that come late or again (`late`), to whom things are given that were not sent to them.
#![allow(clippy::unwrap_used)]

mod late;
mod lost;
mod other_types;
#[path = "../scene/mod.rs"]
mod scene;
#[path = "../../../ros2player/tests/standin/mod.rs"]
mod standin;
mod stopped;
mod strangers;
mod unclear;
mod unmatched;
mod unnamed;
mod whole;

use std::time::Duration;

use bagpipe_log::Connection;
use bagpipe_replay::{Ledger, Mode, Progress, Replayed, Stage, Strength};
use bagpipe_ros2ledger::{Counts, Endpoint, Kind};
use bagpipe_ros2player::{GraphNode, Player};
use scene::{Ask, DEFAULT, Scene, imu, recorded, recording, recording_of};
use standin::{Node, eventually};

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

/// A queue for what is played, of so many; and one that is given what was kept before it came.
fn queue(depth: &str) -> String {
    format!("/in:std_msgs/msg/String:{depth}:reliable")
}

fn late_queue(depth: &str) -> String {
    format!("{}:transient_local", queue(depth))
}

/// A node of the stack that answers what is played on /in, of which its queue holds so many: not what the
/// stack publishes, which is shorter.
fn start_lane(scene: &Scene, depth: &str, more: &[&str]) -> Node {
    start_lane_of(scene, &queue(depth), more)
}

fn start_lane_of(scene: &Scene, queue: &str, more: &[&str]) -> Node {
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--answers-from", "60", "--sub", queue];
    scene.start("standin_node", &[&lane[..], &OUT, more].concat())
}

/// One that publishes /in as well.
fn start_other(scene: &Scene, more: &[&str]) -> Node {
    let queue = queue("1000");
    let other = ["--name", "/other", "--pub", &queue];
    scene.start("standin_node", &[&other[..], more].concat())
}

/// One that has published so many, and keeps them for who comes late.
fn start_keeping(scene: &Scene, many: u64, more: &[&str]) -> Node {
    let (many_words, queue) = (many.to_string(), late_queue(&many.to_string()));
    let other = ["--name", "/other", "--pub", &queue, "--burst", &many_words];
    let other = scene.start("standin_node", &[&other[..], more].concat());
    scene.await_published("/in", many);
    other
}

/// During a play, has a node lose what it is to lose when the recorder has long been there.
fn losing_midway(node: &Node) -> impl FnMut(Progress) {
    let mut loses = false;
    move |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 && !loses {
            node.signal("USR2");
            loses = true;
        }
    }
}

/// How long a start goes on that a node stands still in: for many looks.
const STANDING: Duration = Duration::from_secs(2);

/// The same of one that stands still from when it knows the recorder to the play's begin: looks find that all
/// that it has published has come to the recorder, however slowly that comes.
fn losing_midway_from_rest(scene: &Scene, node: &Node, name: &str) -> impl FnMut(Progress) {
    let (mut stands, mut loses) = (false, losing_midway(node));
    move |progress: Progress| {
        if progress.stage == Stage::Subscribe && !stands && has_met(scene, name) {
            node.signal("STOP");
            stands = true;
        }
        if progress.stage == Stage::Play && stands {
            node.signal("CONT");
            stands = false;
        }
        loses(progress);
    }
}

/// Whether an endpoint of a node has matched one other.
fn has_met(scene: &Scene, node: &str) -> bool {
    let all = scene.ledger.endpoints().unwrap();
    all.iter().any(|one| one.node == node && one.matched == Some(1))
}

/// A topic that is recorded, which a node publishes besides.
const OUT_OTHER: &str = "/out_other:std_msgs/msg/String:10:reliable";

/// Waits until the recorder subscribes to that: in a look behind the one that found its publisher, and with
/// that whatever the node had published before.
fn await_known(scout: &Player) {
    let is_recorder = |one: &GraphNode| one.name.starts_with("/bagpipe_player_");
    let subscribes = |one: &GraphNode| one.subscribes.iter().any(|of| of.0 == "/out_other");
    eventually(|| scout.graph().unwrap().iter().any(|one| is_recorder(one) && subscribes(one)));
}

/// Plays messages by the clock, and when that begins a node that does not count publishes as well.
fn beside_who_begins_uncounted(scene: &Scene) -> Replayed {
    let mut other = None;
    let looks = scene.graph.player();
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && other.is_none() {
            let queue = queue("1000");
            let words = ["--name", "/other", "--pub", &queue, "--pub", OUT_OTHER, "--burst", "1"];
            other = Some(scene.start_uncounted("standin_node", &words));
            // The play may end before the next look.
            await_known(&looks);
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(2), ..DEFAULT };
    scene.play_while(&recording_of(&strings(RELIABLE), 700, 60), &ask, &mut seen).unwrap()
}

/// Plays messages to a node that has a queue of ten, beside one that publishes one before the play and five
/// in it: so many find room behind as many of ours, however long the node takes nothing.
fn beside_five_of_another(scene: &Scene, counted: bool, mode: Mode, messages: u64) -> Replayed {
    let (queue, goes_on) = (queue("1000"), scene.file("goes-on"));
    let paces = ["--knows", "1", "--burst", "1", "--every-us", "50000", "--in-all", "6"];
    let other = ["--name", "/other", "--pub", &queue, "--goes-on", goes_on.to_str().unwrap()];
    let other = [&other[..], &paces].concat();
    let _other = match counted {
        true => scene.start("standin_node", &other),
        false => {
            scene.start_uncounted("standin_node", &[&other[..], &["--pub", OUT_OTHER]].concat())
        }
    };
    let taken = || counts(scene, Kind::Subscription, "/lane", "/in");
    eventually(|| taken().taken == 1);
    let looks = scene.graph.player();
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && !goes_on.exists() {
            // Of who does not count it is known by a look that it publishes.
            if !counted {
                await_known(&looks);
            }
            std::fs::write(&goes_on, "").unwrap();
        }
    };
    let played = recording_of(&strings(RELIABLE), messages, 60);
    let replayed = scene.play_while(&played, &Ask { mode, ..DEFAULT }, &mut seen).unwrap();
    eventually(|| taken().taken - taken().taken_own == 6);
    replayed
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
