//! Who sets a play's pace is known to the player and to the stack's nodes, who by the clock wait for no slow reader.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::fs::File;
use std::os::unix::fs::FileExt as _;

use bagpipe_replay::{Mode, Progress, Stage};
use bagpipe_ros2ledger::Flow;
use scene::{Ask, DEFAULT, RELAY, Scene, recording};

/// Where the player's memory, of which this process has one at a time, has it (`player/layout.h`).
const BY_THE_CLOCK: u64 = 32;

fn keeps_to_the_clock() -> u64 {
    let files = std::fs::read_dir("/proc/self/fd").unwrap().map(|file| file.unwrap().path());
    let is_its = |file: &std::path::PathBuf| {
        let name = std::fs::read_link(file).unwrap_or_default();
        name.to_string_lossy().contains("bagpipe-ros2-player")
    };
    let file = files.into_iter().find(is_its).unwrap();
    let mut word = [0; 8];
    File::open(file).unwrap().read_exact_at(&mut word, BY_THE_CLOCK).unwrap();
    u64::from_le_bytes(word)
}

#[test]
fn the_player_and_the_nodes_keep_to_the_clock_where_the_clock_sets_the_pace() {
    let by = [(Mode::Realtime, (1, Flow::ByTheClock)), (Mode::Max, (0, Flow::Controlled))];
    for (mode, keeps) in [&by[..], &[(Mode::Lockstep, (0, Flow::Controlled))]].concat() {
        let scene = Scene::new();
        let _relay = scene.start("standin_node", &RELAY);
        let mut found = None;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play {
                found = Some((keeps_to_the_clock(), scene.ledger.flow()));
            }
        };
        scene
            .play_while(&recording(&["/in"], 50, 100), &Ask { mode, ..DEFAULT }, &mut seen)
            .unwrap();
        assert_eq!(found, Some(keeps), "{mode:?}");
    }
}
