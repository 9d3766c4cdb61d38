//! Who has stopped is named, whatever others take and publish meanwhile.

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Duration;

use bagpipe_replay::{Mode, Progress, Stage, Strength};
use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, Scene, recording_of};
use crate::standin::eventually;
use crate::{
    LATCHED, RELIABLE, answered, counts, late_queue, line, start_lane, start_lane_of, start_other,
    strings, whole,
};

#[test]
fn who_has_stopped_beside_another_publisher_is_named() {
    let scene = Scene::new();
    let lane = start_lane(&scene, "1000", &["--delay-us", "3000"]);
    let _other = start_other(&scene, &["--burst", "5"]);
    scene.await_published("/in", 5);
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 {
            lane.signal("STOP");
        }
    };
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(1), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 400, 60);
    let error = scene.play_while(&played, &ask, &mut seen).unwrap_err();
    assert_eq!(error.reason(), "StackStoppedReading");
}

/// Plays messages to a node and to one that stops in the midst, beside another publisher, if there is
/// one; how that failed.
fn beside_who_stops(sleeper: &[&str], mode: Mode, other: bool) -> String {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "100", &[]);
    let queue = ["--name", "/sleeper", "--sub", "/in:std_msgs/msg/String:10:reliable"];
    let sleeper = scene.start("standin_node", &[&queue[..], sleeper].concat());
    scene.await_subscriptions(2);
    let _other = other.then(|| {
        let other = start_other(&scene, &["--every-us", "50000"]);
        scene.await_published("/in", 2);
        other
    });
    let ask = Ask { mode, drain: Duration::from_secs(1), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 1000, 60);
    let replayed = std::thread::scope(|scope| {
        scope.spawn(|| {
            // Of ours: the play has begun.
            let taken_own = || counts(&scene, Kind::Subscription, "/sleeper", "/in").taken_own;
            eventually(|| taken_own() > 20);
            sleeper.signal("STOP");
        });
        scene.play(&played, &ask).map(|replayed| replayed.ledger)
    });
    replayed.unwrap_err().to_string()
}

#[test]
fn who_has_stopped_is_named_though_others_take_what_another_publishes() {
    let name = "the node /sleeper has taken nothing";
    for (sleeper, mode, other) in [
        (["--delay-us", "3000"], Mode::Max, false),
        (["--delay-us", "3000"], Mode::Max, true),
        (["--delay-us", "3000"], Mode::Lockstep, true),
        // Within its callback.
        (["--delay-us", "40000"], Mode::Lockstep, true),
    ] {
        let why = beside_who_stops(&sleeper, mode, other);
        assert!(why.contains(name), "{sleeper:?} {mode:?} {other}: {why}");
    }
}

#[test]
fn who_takes_nothing_and_is_in_no_callback_is_named_with_what_that_may_be() {
    for (reliability, why) in [
        ("reliable", "runs: it takes from the topic too seldom"),
        ("best_effort", "runs: they were lost on their way, as it asks for best effort, or"),
    ] {
        let scene = Scene::new();
        let queue = format!("/in:std_msgs/msg/String:1:{reliability}");
        let idle = scene.start("standin_node", &["--name", "/idle", "--sub", &queue]);
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && progress.sent == 0 {
                idle.signal("STOP");
            }
        };
        let ask = Ask { mode: Mode::Max, drain: Duration::from_millis(500), ..DEFAULT };
        let played = recording_of(&strings(RELIABLE), 50, 60);
        let error = scene.play_while(&played, &ask, &mut seen).unwrap_err();
        assert_eq!(error.reason(), "StackStoppedReading");
        let words = error.to_string();
        assert!(words.starts_with("the node /idle has taken nothing from /in for "), "{words}");
        assert!(words.contains(why), "{words}");
    }
}

#[test]
fn who_has_stopped_is_named_though_another_comes_and_goes() {
    let scene = Scene::new();
    let queue = "/in:std_msgs/msg/String:10:reliable";
    let sleeper = ["--name", "/sleeper", "--sub", queue, "--delay-us", "3000"];
    let sleeper = scene.start("standin_node", &sleeper);
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(4), ..DEFAULT };
    let over = AtomicBool::new(false);
    let why = std::thread::scope(|scope| {
        scope.spawn(|| {
            eventually(|| counts(&scene, Kind::Subscription, "/sleeper", "/in").taken > 20);
            sleeper.signal("STOP");
            while !over.load(SeqCst) {
                // More often than is waited for who has stopped.
                let _comes = scene.start("standin_node", &["--name", "/comes", "--sub", queue]);
                std::thread::sleep(Duration::from_secs(3));
            }
        });
        let played = recording_of(&strings(RELIABLE), 1000, 60);
        let replayed = scene.play(&played, &ask).map(|replayed| replayed.ledger);
        over.store(true, SeqCst);
        replayed.unwrap_err().to_string()
    });
    assert!(why.contains("the node /sleeper has taken nothing"), "{why}");
}

#[test]
fn who_works_off_what_another_gave_it_has_not_stopped() {
    let scene = Scene::new();
    let queue = late_queue("1000");
    let _lane = start_lane_of(&scene, &queue, &["--delay-us", "20000"]);
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 && other.is_none() {
            let words = ["--name", "/other", "--pub", &queue, "--burst", "300"];
            other = Some(scene.start("standin_node", &words));
            // More than ours, while these wait: what the other keeps has begun to come.
            let taken = || counts(&scene, Kind::Subscription, "/lane", "/in").taken;
            eventually(|| taken() > progress.sent + 5);
        }
    };
    // Of what the other gives it, it takes fewer in that time.
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(5), ..DEFAULT };
    let played = recording_of(&strings(LATCHED), 60, 60);
    let ledger = scene.play_while(&played, &ask, &mut seen).unwrap().ledger;
    assert!(counts(&scene, Kind::Subscription, "/lane", "/in").taken > 300);
    assert_eq!((line(&ledger), answered(&scene)), (whole(60), 60));
}

#[test]
fn nor_has_one_that_is_never_at_rest() {
    let scene = Scene::new();
    // Each of its threads has something of the other's in hand at almost all times.
    let both = ["--sub", "/in:std_msgs/msg/String:10:reliable", "--threads", "2"];
    let _lane = start_lane(&scene, "10", &[&both[..], &["--delay-us", "3000"]].concat());
    let _other = start_other(&scene, &["--every-us", "2500"]);
    scene.await_offered("/in", 5);
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(5), ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(RELIABLE), 30, 60), &ask).unwrap().ledger;
    assert_eq!((ledger.sent, ledger.received + ledger.dropped), (30, 30));
    assert!(ledger.strength >= Some(Strength::Taken), "{ledger:?}");
}
