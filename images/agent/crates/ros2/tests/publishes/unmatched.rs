//! Who subscribes and does not match the player, or has matched it and does not report so.

use std::time::Duration;

use bagpipe_replay::{Mode, Progress, Replayed, Stage, Strength};
use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, Scene, recording_of};
use crate::standin::{Node, eventually};
use crate::{RELIABLE, counts, queue, start_lane, start_lane_of, strings};

/// A node's lines: what was sent to it and received of that, and how far that is proved.
fn lines_of(replayed: &Replayed, node: &str) -> Vec<(u64, u64, Strength)> {
    let all = replayed.ledger.topics.iter().flat_map(|topic| &topic.subscribers);
    let of_it = all.filter(|line| line.node == node);
    of_it.map(|line| (line.received + line.dropped, line.received, line.strength)).collect()
}

/// A node that has spun, and then computes for so long before it takes what is played.
fn start_planner(scene: &Scene, us: &str) -> (Node, Node) {
    let begins = "/begin:std_msgs/msg/String:1:reliable:transient_local";
    let starter = ["--name", "/starter", "--pub", begins, "--burst", "1"];
    let starter = scene.start("standin_node", &starter);
    let (input, slow) = (queue("10"), format!("1:{us}"));
    let planner = ["--name", "/planner", "--sub", begins, "--slow", &slow, "--sub", &input];
    let planner = scene.start("standin_node", &planner);
    eventually(|| counts(scene, Kind::Subscription, "/planner", "/begin").taken == 1);
    (starter, planner)
}

#[test]
fn who_computes_when_the_player_comes_is_waited_for_and_counted_from_the_first_message() {
    for (mode, messages) in [(Mode::Max, 300), (Mode::Lockstep, 50)] {
        let scene = Scene::new();
        let _planner = start_planner(&scene, "5000000");
        let _lane = start_lane(&scene, "10", &[]);
        let ask = Ask { mode, drain: Duration::from_secs(20), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), messages, 60), &ask).unwrap();
        for node in ["/lane", "/planner"] {
            let all = [(messages, messages, Strength::Called)];
            assert_eq!(lines_of(&replayed, node), all, "{node} {mode:?}");
        }
    }
}

#[test]
fn what_waits_behind_another_callback_is_counted_when_that_has_ended() {
    let scene = Scene::new();
    // More than 2 s of it are left when the last message has gone out.
    let _planner = start_planner(&scene, "8000000");
    let _lane = start_lane(&scene, "10", &[]);
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(30), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 8, 60), &ask).unwrap();
    assert_eq!(lines_of(&replayed, "/planner"), [(8, 8, Strength::Called)]);
}

#[test]
fn who_asks_for_another_type_is_named_and_neither_waited_for_nor_proved() {
    for mode in [Mode::Max, Mode::Realtime] {
        for messages in [100, 1500] {
            let scene = Scene::new();
            let other = ["--name", "/planner", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
            let _planner = scene.start("standin_node", &other);
            let _lane = start_lane(&scene, "1000", &["--delay-us", "500"]);
            let ask = Ask { mode, drain: Duration::from_secs(3), ..DEFAULT };
            let recording = recording_of(&strings(RELIABLE), messages, 60);
            let replayed = scene.play(&recording, &ask).unwrap();
            assert_eq!(lines_of(&replayed, "/lane"), [(messages, messages, Strength::Called)]);
            assert_eq!(lines_of(&replayed, "/planner"), [(messages, 0, Strength::Sent)]);
            let warnings = replayed.playback.warnings.join("; ");
            let named = "/planner subscribes to /in and has not matched the player, so that it got \
                         nothing of ours, by all that is known: it asks for sensor_msgs/msg/Imu, \
                         and std_msgs/msg/String is played";
            assert!(warnings.contains(named), "{warnings}");
        }
    }
}

#[test]
fn who_spins_late_is_counted_though_another_one_never_matches() {
    let scene = Scene::new();
    let other = ["--name", "/other", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
    let _other = scene.start("standin_node", &other);
    let planner = ["--name", "/planner", "--sub", &queue("10"), "--spins-late-us", "5000000"];
    let _planner = scene.start("standin_node", &planner);
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(20), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 60, 60), &ask).unwrap();
    assert_eq!(lines_of(&replayed, "/planner"), [(60, 60, Strength::Called)]);
    assert_eq!(lines_of(&replayed, "/other"), [(60, 0, Strength::Sent)]);
}

#[test]
fn two_processes_of_one_name_have_a_line_each_though_one_had_no_subscription_for_a_while() {
    let scene = Scene::new();
    let first = ["--name", "/first", "--delay-us", "1000", "--sub", &queue("10")];
    let _first = scene.start("standin_node", &first);
    let _lane = start_lane_of(&scene, &queue("100"), &["--renew", "1:500:2000000"]);
    let mut second = None;
    let mut seen = |progress: Progress| {
        let away = || counts(&scene, Kind::Subscription, "/lane", "/in").taken >= 500;
        if progress.stage == Stage::Play && second.is_none() && away() {
            second = Some(start_lane_of(&scene, &queue("100"), &[]));
        }
    };
    let recording = recording_of(&strings(RELIABLE), 5000, 60);
    let replayed = scene.play_while(&recording, &DEFAULT, &mut seen).unwrap();
    let lines = lines_of(&replayed, "/lane");
    assert_eq!(lines.len(), 2, "{lines:?}");
    // Each lacks what the other had alone: the second one the first 500 at least.
    assert!(lines.iter().all(|(all, received, _)| *all == 5000 && *received <= 4500), "{lines:?}");
}
