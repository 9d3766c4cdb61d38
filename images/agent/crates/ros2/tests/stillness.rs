//! When lock-step goes on: past what hides what is on its way, and past what never comes.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::time::Duration;

use bagpipe_replay::{Mode, Replayed};
use scene::{Ask, MS, Scene, recorded, recording};

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
