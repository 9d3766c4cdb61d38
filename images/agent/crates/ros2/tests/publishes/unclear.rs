//! Where the middleware does not say whose messages a node takes: unproved beside another publisher, and
//! as exact as ever where there is none.

use std::time::Duration;

use bagpipe_replay::{Mode, Progress, Replayed, Stage, Strength};

use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, Scene, recording_of};
use crate::standin::eventually;
use crate::{
    RELIABLE, answered, beside_five_of_another, beside_who_begins_uncounted, counts, line, queue,
    start_lane, start_other, strings, whole,
};

const NONE: [&str; 2] = ["--origins", "none"];

/// That it is not known what the node got, and why.
fn assert_unproved(replayed: &Replayed, sent: u64) {
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (sent, Some(Strength::Sent)));
    let expected = "the stack publishes /in too, and the middleware of /lane does not say whose \
                    messages it takes, so that what it got of ours can't be known";
    let warnings = &replayed.playback.warnings;
    assert!(warnings.iter().any(|one| one == expected), "{warnings:?}");
    assert!(!warnings.iter().any(|one| one.contains(" lost ")), "{warnings:?}");
}

#[test]
fn where_nobody_else_publishes_all_is_known() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "10", &NONE);
    for mode in [Mode::Max, Mode::Lockstep] {
        let ask = Ask { mode, ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 300, 60), &ask).unwrap();
        assert_eq!(line(&replayed.ledger), whole(300), "{mode:?}");
    }
}

#[test]
fn nothing_is_proved_beside_another_publisher() {
    for mode in [Mode::Max, Mode::Lockstep] {
        let scene = Scene::new();
        let _lane = start_lane(&scene, "10", &NONE);
        let _other = start_other(&scene, &["--every-us", "20000"]);
        scene.await_offered("/in", 5);
        let ask = Ask { mode, drain: Duration::from_secs(5), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 50, 60), &ask).unwrap();
        assert_unproved(&replayed, 50);
    }
}

#[test]
fn nor_beside_one_that_begins_to_publish_uncounted() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &NONE);
    let replayed = beside_who_begins_uncounted(&scene);
    assert_unproved(&replayed, 700);
}

#[test]
fn what_one_lost_that_came_late_is_waited_for_once() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &[&NONE[..], &["--delay-us", "3000"]].concat());
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 && other.is_none() {
            // It publishes before it knows anybody, and leaves the lane time for all that came.
            let words = ["--burst", "50", "--every-us", "5000", "--in-all", "250"];
            other = Some(start_other(&scene, &words));
            scene.await_published("/in", 50);
        }
    };
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(20), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 400, 60);
    let replayed = scene.play_while(&played, &ask, &mut seen).unwrap();
    assert_unproved(&replayed, 400);
    assert_eq!(answered(&scene), 400);
}

#[test]
fn messages_with_their_publishers_gid_are_as_exact_as_those_with_a_handle() {
    for mode in [Mode::Max, Mode::Lockstep] {
        let scene = Scene::new();
        // Slow enough for the other's to come in between.
        let lane = ["--origins", "gid", "--delay-us", "6000"];
        let _lane = start_lane(&scene, "10", &lane);
        let replayed = beside_five_of_another(&scene, true, mode, 50);
        assert_eq!(line(&replayed.ledger), whole(50), "{mode:?}");
    }
}

#[test]
fn what_seems_to_be_lost_is_not_waited_for_as_long_as_who_has_stopped() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1", &NONE);
    let other = ["--every-us", "2000"];
    let _other = start_other(&scene, &other);
    scene.await_offered("/in", 5);
    // As many waits of so long would outlast the case.
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(20), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 60, 60), &ask).unwrap();
    assert_unproved(&replayed, 60);
}

#[test]
fn nothing_is_proved_where_somebody_published_whom_nobody_saw() {
    let scene = Scene::new();
    // It is at work until the other has left, and knows of none of its messages whose they are.
    let _lane = start_lane(&scene, "50", &["--first-us", "6000000"]);
    let queue = queue("1000");
    let _witness = scene.start("standin_node", &["--name", "/witness", "--sub", &queue]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(20), ..DEFAULT };
    let replayed = std::thread::scope(|scope| {
        scope.spawn(|| {
            eventually(|| counts(&scene, Kind::Subscription, "/lane", "/in").taken > 0);
            let words = ["--name", "/other", "--pub", &queue, "--burst", "0", "--every-us", "1000"];
            let other = scene.start_uncounted("standin_node", &words);
            // As many have come to who is at no work.
            eventually(|| {
                let witness = counts(&scene, Kind::Subscription, "/witness", "/in");
                witness.taken - witness.taken_own >= 100
            });
            assert!(other.end());
        });
        scene.play(&recording_of(&strings(RELIABLE), 51, 60), &ask).unwrap()
    });
    let taken = counts(&scene, Kind::Subscription, "/lane", "/in");
    assert!(taken.taken_unknown > 0, "{taken:?}");
    assert_unproved(&replayed, 51);
}
