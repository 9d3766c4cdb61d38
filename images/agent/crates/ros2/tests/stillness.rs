//! When lock-step goes on: past what hides what is on its way, and past what never comes.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::time::Duration;

use bagpipe_replay::{Mode, Replayed};
use scene::{Ask, MS, RELAY, Scene, recorded, recording};
use standin::Node;

/// The times of what was recorded, in ms.
fn times(replayed: &Replayed) -> Vec<u64> {
    recorded(replayed).iter().map(|(_, time, _)| time / MS).collect()
}

/// A node that passes on from one topic to the other.
fn passes_on<'a>(name: &'a str, sub: &'a str, publisher: &'a str, relay: &'a str) -> Vec<&'a str> {
    vec!["--name", name, "--sub", sub, "--pub", publisher, "--relay", relay]
}

const IN: &str = "/in:sensor_msgs/msg/Imu:10:reliable";
const OUT: &str = "/out:std_msgs/msg/String:100:reliable";

/// Starts a node that passes on what comes on /in to itself, within its process, and from there to /out.
fn hands_over(scene: &Scene, more: &[&str]) -> Node {
    let middle = "/middle:std_msgs/msg/String:10:reliable";
    let both = ["--name", "/both", "--sub", IN, "--sub", middle, "--pub", middle, "--pub", OUT];
    let relays = ["--within", "--relay", "/in=/middle", "--relay", "/middle=/out"];
    let node = scene.start("standin_node", &[&both[..], &relays, more].concat());
    scene.await_subscriptions(2);
    node
}

#[test]
fn what_is_handed_over_within_a_process_belongs_to_its_step_and_is_no_loss() {
    let scene = Scene::new();
    // What was handed over waits while it is not yet back from the callback that did so.
    let _both = hands_over(&scene, &["--returns-us", "3000"]);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 20, 50), &ask).unwrap();
    // What is waited for in vain twice in a row is named.
    assert_eq!(replayed.playback.warnings, [] as [String; 0]);
    assert_eq!(times(&replayed), (1000..1020).collect::<Vec<_>>());
}

#[test]
fn a_thread_that_never_sleeps_has_each_lacking_message_cost_less_than_the_one_before() {
    let scene = Scene::new();
    let half = [&RELAY[..], &["--drop-every", "2"]].concat();
    let _relay = scene.start("standin_node", &half);
    // It asks for more than is offered, so that nothing reaches it.
    let deaf = ["--name", "/deaf", "--sub", "/out:std_msgs/msg/String:5:reliable:transient_local"];
    let _deaf = scene.start("standin_node", &[&deaf[..], &["--wakeful"]].concat());
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(2), ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 40, 50), &ask).unwrap();
    assert_eq!(times(&replayed), (1000..1040).step_by(2).collect::<Vec<_>>());
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("what /deaf was sent on /out did not all come to it"), "{warnings}");
    // Twice 2 s and then half as long each time, where each of twenty took 2 s.
    let seconds = replayed.playback.played_seconds;
    assert!(seconds < 20.0, "{seconds}");
}

#[test]
fn a_callback_that_never_ends_hides_nothing_that_is_on_its_way() {
    let scene = Scene::new();
    let middle = "/out_middle:std_msgs/msg/String:100:best_effort";
    let first = passes_on("/first", IN, middle, "/in=/out_middle");
    let second = passes_on("/second", middle, OUT, "/out_middle=/out");
    let _first = scene.start("standin_node", &first);
    // The next message comes while it is not yet back.
    let _second = scene.start("standin_node", &[&second[..], &["--returns-us", "5000"]].concat());
    let hangs = ["--name", "/hangs", "--sub", middle, "--delay-us", "120000000"];
    let _hangs = scene.start("standin_node", &hangs);
    scene.await_subscriptions(3);
    let drain = Duration::from_secs(2);
    let ask = Ask { mode: Mode::Lockstep, drain, record: &["/out"], ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 60, 50), &ask).unwrap();
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("a callback of /hangs on /out_middle was not over"), "{warnings}");
    assert_eq!(times(&replayed), (1000..1060).collect::<Vec<_>>());
}

#[test]
fn what_is_not_seen_within_a_process_that_never_sleeps_is_named_as_that_and_ends() {
    let scene = Scene::new();
    let _both = hands_over(&scene, &["--wakeful"]);
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(1), ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 30, 50), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (30, 30, 0));
    assert_eq!(times(&replayed).len(), 30);
    let warnings = replayed.playback.warnings.join("; ");
    let named = "what /both is handed on /middle within its process is not counted";
    assert!(warnings.contains(named) && !warnings.contains("did not all come"), "{warnings}");
    let seconds = replayed.playback.played_seconds;
    assert!(seconds < 15.0, "{seconds}");
}
