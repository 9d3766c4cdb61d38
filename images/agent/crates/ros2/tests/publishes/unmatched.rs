//! Who subscribes and does not match the player, or has matched it and does not report so.

use std::time::Duration;

use bagpipe_replay::{Mode, Progress, Replayed, Stage, Strength};
use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, Scene, recorded, recording_of};
use crate::standin::{Node, eventually};
use crate::{
    OUT, OUT_OTHER, RELIABLE, await_known, counts, queue, start_lane, start_lane_of, strings,
};

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
            scene.await_subscriptions(2);
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
    scene.await_subscriptions(2);
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
    let lane = start_lane_of(&scene, &queue("100"), &["--renew", "1:500:2000000"]);
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
    assert!(lines.len() == 2 && lines.iter().all(|(all, ..)| *all == 5000), "{lines:?}");
    let taken = |pid: u32| -> u64 {
        let all = scene.ledger.endpoints().unwrap();
        let of_it =
            all.iter().filter(|one| one.process.pid == pid && one.kind == Kind::Subscription);
        of_it.map(|one| one.counts.taken_own).sum()
    };
    let taken = [taken(lane.pid()), taken(second.unwrap().pid())];
    let received: Vec<u64> = lines.iter().map(|(_, received, _)| *received).collect();
    // One message may have found room just before a subscription was listed, and go out behind that.
    let of_ours = |(received, taken): (&u64, &u64)| (*taken - 1..=*taken).contains(received);
    assert!(received.iter().zip(&taken).all(of_ours), "{received:?} of {taken:?}");
    // Each lacks what the other had alone: the second one the first 500 at least.
    assert!(received[0] < 5000 && received[1] <= 4500, "{received:?}");
}

const TIMELY: &str = "  deadline: {sec: 1, nsec: 0}\n  liveliness: manual_by_topic\n  \
                      liveliness_lease_duration: {sec: 20, nsec: 0}\n";

#[test]
fn who_asks_for_the_recorded_deadline_and_liveliness_is_played_to_and_who_asks_for_more_is_named() {
    let recorded_as = strings(&[RELIABLE, TIMELY].concat());
    let scene = Scene::new();
    let start = |name, presence, output: &[&str]| {
        let input = ["--presence", presence, "--sub", "/in:std_msgs/msg/String:10:reliable"];
        scene.start("standin_node", &[&["--name", name], output, &input].concat())
    };
    let _lane = start("/lane", "1000:20000:manual", &[&["--relay", "/in=/out"], &OUT[..]].concat());
    let _strict = start("/strict", "999:0:automatic", &[]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let replayed = scene.play(&recording_of(&recorded_as, 50, 60), &ask).unwrap();
    assert_eq!(lines_of(&replayed, "/lane"), [(50, 50, Strength::Called)]);
    assert_eq!(lines_of(&replayed, "/strict"), []);
    let why = "/strict subscribes to /in, but it wants them within a deadline that the recorded publishers \
               did not offer: set its quality of service";
    assert_eq!(replayed.playback.warnings[0], why);
}

#[test]
fn what_was_recorded_without_a_deadline_is_played_without_one() {
    let scene = Scene::new();
    let asks = ["--presence", "1000:0:automatic", "--sub", "/in:std_msgs/msg/String:10:reliable"];
    let _strict = scene.start("standin_node", &[&["--name", "/strict"], &asks[..]].concat());
    let _lane = start_lane(&scene, "10", &[]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 50, 60), &ask).unwrap();
    assert_eq!(lines_of(&replayed, "/strict"), []);
    assert!(replayed.playback.warnings[0].starts_with("/strict subscribes to /in, but it wants"));
}

#[test]
fn the_recording_has_the_deadline_and_the_liveliness_that_the_stack_offers() {
    let scene = Scene::new();
    let lane =
        ["--name", "/lane", "--relay", "/in=/out", "--sub", "/in:std_msgs/msg/String:10:reliable"];
    let offers = [&["--presence", "1000:20000:manual"], &OUT[..]].concat();
    let _lane = scene.start("standin_node", &[&lane[..], &offers].concat());
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 20, 60), &ask).unwrap();
    let made = bagpipe_mcap::Mcap::open(replayed.recorded_bag.clone()).unwrap();
    let out = made.connections().iter().find(|one| one.topic == "/out").unwrap();
    let offered = out.offered_qos.clone().unwrap();
    assert!(offered.contains("deadline: {sec: 1, nsec: 0}\n"), "{offered}");
    assert!(offered.contains("liveliness: manual_by_topic\n"), "{offered}");
    assert!(offered.contains("liveliness_lease_duration: {sec: 20, nsec: 0}\n"), "{offered}");
    assert_eq!(recorded(&replayed).len(), 20);
}

#[test]
fn who_is_waited_for_when_the_first_message_goes_out_by_the_clock_has_all_of_them_in_one_line() {
    let scene = Scene::new();
    let (deep, late) = (queue("10000"), "4000000");
    let _lane = scene.start("standin_node", &["--name", "/lane", "--sub", &deep]);
    let first = ["--name", "/first", "--sub", &deep, "--spins-late-us", late];
    let _first = scene.start("standin_node", &first);
    scene.await_subscriptions(2);
    let scout = scene.graph.player();
    let mut second = None;
    let mut seen = |progress: Progress| {
        // When the start has ended, and before the first message.
        if progress.stage == Stage::LeadIn && second.is_none() {
            let words = ["--name", "/second", "--sub", &deep, "--spins-late-us", "3000000"];
            let words = [&words[..], &["--pub", OUT_OTHER]].concat();
            second = Some(scene.start("standin_node", &words));
            scene.await_subscriptions(3);
            // What goes out before the player's middleware knows it never comes to it.
            await_known(&scout);
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(10), ..DEFAULT };
    let replayed =
        scene.play_while(&recording_of(&strings(RELIABLE), 6_000, 60), &ask, &mut seen).unwrap();
    for node in ["/lane", "/first", "/second"] {
        assert_eq!(lines_of(&replayed, node), [(6_000, 6_000, Strength::Called)], "{node}");
    }
    assert!(second.is_some());
}

#[test]
fn of_two_processes_of_one_name_the_line_of_who_never_matched_stays_when_it_ends() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "10", &["--delay-us", "1000"]);
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage != Stage::Play {
            return;
        }
        if progress.sent > 500 && other.is_none() {
            let words = ["--name", "/lane", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
            other = Some(Some(scene.start("standin_node", &words)));
            scene.await_subscriptions(2);
        }
        if progress.sent > 2_500 {
            other.as_mut().map(Option::take);
        }
    };
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(3), ..DEFAULT };
    let replayed =
        scene.play_while(&recording_of(&strings(RELIABLE), 4_000, 60), &ask, &mut seen).unwrap();
    let [(4_000, 4_000, Strength::Called), (4_000, 0, Strength::Sent)] =
        lines_of(&replayed, "/lane")[..]
    else {
        panic!("{:?}", replayed.ledger);
    };
}

#[test]
fn of_two_processes_of_one_name_that_ask_for_two_types_the_one_that_fits_is_counted() {
    for first in ["sensor_msgs/msg/Imu", "std_msgs/msg/String"] {
        let all = ["sensor_msgs/msg/Imu", "std_msgs/msg/String"];
        let scene = Scene::new();
        let start = |of: &str| {
            let input = format!("/in:{of}:10:reliable");
            scene.start("standin_node", &["--name", "/lane", "--sub", &input])
        };
        let _one = start(first);
        let _other = start(all.iter().find(|of| **of != first).unwrap());
        scene.await_subscriptions(2);
        let ask = Ask { drain: Duration::from_secs(3), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 300, 60), &ask).unwrap();
        let mut lines = lines_of(&replayed, "/lane");
        lines.sort_unstable();
        assert_eq!(lines, [(300, 0, Strength::Sent), (300, 300, Strength::Called)], "{first}");
    }
}

#[test]
fn who_is_in_the_graph_before_its_process_has_listed_it_is_proved_once_it_has() {
    let scene = Scene::new();
    // What the start waits for meanwhile.
    let leader = ["--name", "/leader", "--life-cycle", "inactive"];
    let leader = scene.start("standin_node", &leader);
    let _first = scene.start("standin_node", &["--name", "/first", "--sub", &queue("10")]);
    scene.await_subscriptions(1);
    let scout = scene.graph.player();
    let is_there = || {
        let nodes = scout.graph().unwrap();
        nodes.iter().any(|node| node.name == "/second" && !node.subscribes.is_empty())
    };
    // Before it has a node, the signal would end it.
    eventually(|| scout.graph().unwrap().iter().any(|node| node.name == "/leader"));
    let mut second = None;
    let replayed = std::thread::scope(|scope| {
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Subscribe && second.is_none() {
                let words = ["--name", "/second", "--sub", &queue("10"), "--lists-late-ms", "1500"];
                second = Some(scene.start("standin_node", &words));
                eventually(is_there);
                scope.spawn(|| {
                    scene.await_subscriptions(2);
                    leader.signal("USR1");
                });
            }
        };
        let ask = Ask { active: &["/leader"], drain: Duration::from_secs(3), ..DEFAULT };
        scene.play_while(&recording_of(&strings(RELIABLE), 300, 60), &ask, &mut seen).unwrap()
    });
    for node in ["/first", "/second"] {
        assert_eq!(lines_of(&replayed, node), [(300, 300, Strength::Called)], "{node}");
    }
}
