//! Nodes with a life cycle: the play begins once those that were named are active, and ends with a
//! sentence once one is not any more.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::time::Duration;

use bagpipe_replay::{Mode, Progress, ReplayError, Replayed, Stage};
use scene::{Ask, DEFAULT, RELAY, Scene, recorded, recording};

const ACTIVE: Ask<'static> = Ask { active: &["/ns/relay"], ..DEFAULT };

/// A relay within a namespace, with these further options.
fn relay<'a>(further: &[&'a str]) -> Vec<&'a str> {
    [&["--name", "/ns/relay"], &RELAY[2..], further].concat()
}

fn assert_whole(replayed: &Replayed, messages: u64) {
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (messages, messages, 0));
    assert_eq!(recorded(replayed).len() as u64, messages);
}

#[test]
fn a_node_that_was_active_before_anybody_looked_is_played_to() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay(&["--life-cycle", "active"]));
    scene.await_subscriptions(1);
    assert_whole(&scene.play(&recording(&["/in"], 200, 100), &ACTIVE).unwrap(), 200);
}

// Promise: not-before-active
#[test]
fn the_play_does_not_begin_before_the_node_is_active() {
    let scene = Scene::new();
    let relay = scene.start("standin_node", &relay(&["--life-cycle", "inactive"]));
    // Before it has a subscription, the signal might end it.
    scene.await_subscriptions(1);
    let mut stages = Vec::new();
    // It is looked at twice a second: by then all else has long been there.
    let mut seen = |progress: Progress| {
        stages.push(progress.stage);
        if stages.len() == 6 {
            relay.signal("USR1");
        }
    };
    let replayed = scene.play_while(&recording(&["/in"], 200, 100), &ACTIVE, &mut seen).unwrap();
    assert_eq!(stages[..6], [Stage::Subscribe; 6]);
    assert_whole(&replayed, 200);
}

/// Why nothing was played in so many seconds.
fn refusal(scene: &Scene, active: &[&str], seconds: u64) -> String {
    let ask = Ask { active, deadline: Duration::from_secs(seconds), ..DEFAULT };
    let error = scene.play(&recording(&["/in"], 5, 100), &ask).err().unwrap();
    assert_eq!(error.reason(), "NeverSubscribed");
    error.to_string()
}

#[test]
fn who_is_not_active_in_time_is_named_with_its_state() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay(&["--life-cycle", "inactive"]));
    let expected = "waited in vain for /ns/relay to be active (it is inactive) for 8.0 s";
    assert_eq!(refusal(&scene, &["/ns/relay"], 8), expected);
}

#[test]
fn who_is_not_there_or_has_no_life_cycle_is_named() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay(&[]));
    let expected = "waited in vain for /ns/relay to be active (nobody serves /ns/relay/get_state), \
                    /more to be active (nobody serves /more/get_state) for 3.0 s";
    assert_eq!(refusal(&scene, &["/ns/relay", "/more"], 3), expected);
}

/// A lock-step play to a node that is made inactive by one of the messages.
fn left_after(messages: &str, all: u64) -> Result<Replayed, ReplayError> {
    let scene = Scene::new();
    let leaves = relay(&["--life-cycle", "active", "--leave-after", messages]);
    let _relay = scene.start("standin_node", &leaves);
    let ask = Ask { mode: Mode::Lockstep, steps: &[("/in", "/out")], ..ACTIVE };
    scene.play(&recording(&["/in"], all, 100), &ask)
}

// Promise: leaves-active
#[test]
fn who_leaves_midway_ends_the_play_and_is_named() {
    let error = left_after("50", 20_000).err().unwrap();
    assert_eq!(error.reason(), "NodeInactive");
    let sentence = error.to_string();
    let expected = "/ns/relay, which stack.ros2.active names, has left the state active: it is \
                    deactivating";
    assert!(sentence.starts_with(expected), "{sentence}");
}

#[test]
fn who_has_had_everything_may_leave() {
    assert_whole(&left_after("200", 200).unwrap(), 200);
}
