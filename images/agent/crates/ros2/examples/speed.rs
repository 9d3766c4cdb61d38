//! How fast a recording is played into a node of the stand-in over Cyclone DDS, with its proof:
//! `cargo run --release -p bagpipe-ros2 --example speed [ROUNDS [WORD]]` prints medians with their
//! spread, of all or of those whose line has the word.
#![allow(clippy::unwrap_used)]

#[path = "../tests/scene/mod.rs"]
mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use bagpipe_replay::{Mode, Replayed};
use scene::{Ask, Scene, recording};

const NODE: [&str; 4] = ["--name", "/relay", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
const ANSWERS: [&str; 4] = ["--pub", "/out:std_msgs/msg/String:10:reliable", "--relay", "/in=/out"];

fn main() {
    let mut arguments = std::env::args().skip(1);
    let rounds = arguments.next().and_then(|text| text.parse().ok()).unwrap_or(5);
    let word = arguments.next().unwrap_or_default();
    let bare = NODE.to_vec();
    let relay = [NODE, ANSWERS].concat();
    let measure = |what: &str, rounds, how| {
        if what.contains(&word) {
            measure(what, rounds, how);
        }
    };
    measure("full speed, 1 KB, messages/s", rounds, (&bare, Mode::Max, 100_000, 1000));
    measure("full speed, 1 MB, messages/s", rounds, (&bare, Mode::Max, 300, 1_000_000));
    measure(
        "full speed, 1 KB, answered and recorded, messages/s",
        rounds,
        (&relay, Mode::Max, 50_000, 1000),
    );
    measure(
        "lock-step, 1 KB, answered and recorded, messages/s",
        rounds,
        (&relay, Mode::Lockstep, 5_000, 1000),
    );
}

fn measure(what: &str, rounds: usize, how: (&[&str], Mode, u64, usize)) {
    let mut rates: Vec<f64> = (0..rounds).map(|_| rate(&played(how))).collect();
    rates.sort_by(f64::total_cmp);
    let (least, median, most) = (rates[0], rates[rates.len() / 2], rates[rates.len() - 1]);
    println!("{what}: {median:.0} ({least:.0} to {most:.0})");
}

/// One play, in which nothing was lost.
fn played((arguments, mode, messages, length): (&[&str], Mode, u64, usize)) -> Replayed {
    let scene = Scene::new();
    let _node = scene.start("standin_node", arguments);
    let steps: &[(&str, &str)] = match mode {
        Mode::Lockstep => &[("/in", "/out")],
        Mode::Max | Mode::Realtime => &[],
    };
    let ask = Ask { mode, steps, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], messages, length), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (messages, messages, 0));
    replayed
}

fn rate(replayed: &Replayed) -> f64 {
    replayed.ledger.sent as f64 / replayed.playback.played_seconds
}
