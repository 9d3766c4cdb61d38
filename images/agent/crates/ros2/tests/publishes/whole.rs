//! Nothing of ours is lost, and that is proved, whatever the stack publishes beside it.

use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::time::Duration;

use bagpipe_replay::{Mode, Progress, Replayed, Stage};
use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, RELAY, Scene, recording, recording_of};
use crate::standin::eventually;
use crate::{
    LATCHED, OUT, RELIABLE, answered, beside_five_of_another, beside_who_begins_uncounted, counts,
    has_met, late_queue, line, start_keeping, start_lane, start_lane_of, start_other, strings,
    whole,
};

/// Plays messages of /in while another node of the stack publishes it, each of its calls returning so
/// much later than the message goes out.
fn beside_another(scene: &Scene, late: &str, burst: &str, plays: usize) -> Vec<Replayed> {
    let _lane = start_lane(scene, "1000", &[]);
    let paces = ["--every-us", "10000", "--burst", burst, "--returns-late-us", late];
    let _other = start_other(scene, &paces);
    scene.await_offered("/in", 1);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 50, 60);
    (0..plays).map(|_| scene.play(&played, &ask).unwrap()).collect()
}

#[test]
fn what_the_stack_was_publishing_when_we_came_is_no_loss_of_ours() {
    for replayed in beside_another(&Scene::new(), "3000", "5", 3) {
        assert_eq!(line(&replayed.ledger), whole(50));
    }
}

#[test]
fn nor_is_what_it_publishes_where_a_publish_is_always_under_way() {
    let replayed = beside_another(&Scene::new(), "60000000", "1", 1).remove(0);
    assert_eq!(line(&replayed.ledger), whole(50));
}

#[test]
fn what_waits_of_the_stack_s_own_when_we_come_costs_no_message_of_ours() {
    let scene = Scene::new();
    let _other = start_keeping(&scene, 10, &[]);
    let _lane = start_lane_of(&scene, &late_queue("10"), &["--delay-us", "50000"]);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(LATCHED), 150, 60), &ask).unwrap();
    assert_eq!(line(&replayed.ledger), whole(150));
}

#[test]
fn nor_does_what_a_publisher_keeps_for_the_node_and_that_is_on_its_way() {
    let scene = Scene::new();
    let _other = start_keeping(&scene, 10, &["--meets-late-ms", "60000"]);
    let _lane = start_lane_of(&scene, &late_queue("10"), &[]);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(LATCHED), 50, 60), &ask).unwrap().ledger;
    assert_eq!(line(&ledger), whole(50));
}

/// Plays messages to a node that is at other work for so long when it is given as many of another's as
/// its queue holds.
fn while_at_other_work(scene: &Scene, microseconds: &str) -> Replayed {
    let queue = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let work = "/work:std_msgs/msg/String:10:reliable:transient_local";
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--first-us", microseconds];
    let lane = [&lane[..], &["--answers-from", "60"]].concat();
    let ends = ["--sub", work, "--sub", queue];
    let _lane = scene.start("standin_node", &[&lane[..], &ends, &OUT].concat());
    let _worker =
        scene.start("standin_node", &["--name", "/worker", "--pub", work, "--burst", "1"]);
    eventually(|| counts(scene, Kind::Subscription, "/lane", "/work").taken == 1);
    let _other =
        scene.start("standin_node", &["--name", "/other", "--pub", queue, "--burst", "10"]);
    scene.await_published("/in", 10);
    // What it keeps is on its way to the node once it knows it, before the first one of ours.
    eventually(|| has_met(scene, "/other"));
    let qos = LATCHED.replace("100", "10");
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    scene.play(&recording_of(&strings(&qos), 50, 60), &ask).unwrap()
}

#[test]
fn nor_do_a_node_s_other_work_and_what_comes_meanwhile() {
    for microseconds in ["500000", "4000000"] {
        let scene = Scene::new();
        let replayed = while_at_other_work(&scene, microseconds);
        assert_eq!((line(&replayed.ledger), answered(&scene)), (whole(50), 50), "{microseconds}");
    }
}

#[test]
fn who_publishes_uncounted_and_leaves_makes_nothing_unproved() {
    let scene = Scene::new();
    let input = "/in:sensor_msgs/msg/Imu:2000:reliable";
    let relay = RELAY.map(|one| if one == RELAY[3] { input } else { one });
    let _relay = scene.start("standin_node", &relay);
    let leaves = ["--name", "/leaves", "--pub", input, "--burst", "1"];
    let mut leaves = Some(scene.start_uncounted("standin_node", &leaves));
    let looks = scene.graph.player();
    let is_there = || looks.graph().unwrap().iter().any(|node| node.name == "/leaves");
    eventually(is_there);
    let mut left = false;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && !left {
            assert!(leaves.take().unwrap().end());
            eventually(|| !is_there());
            left = true;
        }
    };
    let ask = Ask { mode: Mode::Realtime, ..DEFAULT };
    let replayed = scene.play_while(&recording(&["/in"], 700, 100), &ask, &mut seen).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((line(ledger), ledger.topics[0].subscribers.len()), (whole(700), 1));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(!warnings.contains("/in too"), "{warnings}");
}

#[test]
fn who_subscribes_again_beside_another_publisher_has_all() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &["--renew-every", "20"]);
    let _other = start_other(&scene, &["--burst", "5"]);
    scene.await_published("/in", 5);
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 100, 60), &ask).unwrap();
    assert_eq!((line(&replayed.ledger), answered(&scene)), (whole(100), 100));
}

#[test]
fn who_begins_to_publish_uncounted_makes_nothing_unproved() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "5000", &[]);
    let replayed = beside_who_begins_uncounted(&scene);
    assert_eq!((line(&replayed.ledger), answered(&scene)), (whole(700), 700));
}

#[test]
fn what_another_publishes_overwrites_none_of_ours_at_the_subscribers_pace() {
    for counted in [true, false] {
        let scene = Scene::new();
        let _lane = start_lane(&scene, "10", &["--delay-us", "2000"]);
        let ledger = beside_five_of_another(&scene, counted, Mode::Max, 1000).ledger;
        assert_eq!((line(&ledger), answered(&scene)), (whole(1000), 1000), "{counted}");
    }
}

#[test]
fn what_one_who_came_late_published_before_it_was_known_is_no_loss_of_ours() {
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let scene = Scene::new();
        let _lane = start_lane(&scene, "1000", &[]);
        let mut other = None;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && other.is_none() {
                // It publishes before it knows anybody; all of it and of ours find room in the queue.
                let paces = ["--every-us", "1000", "--in-all", "100"];
                other = Some(start_other(&scene, &paces));
            }
        };
        let ask = Ask { mode, drain: Duration::from_secs(1), ..DEFAULT };
        let replayed =
            scene.play_while(&recording_of(&strings(RELIABLE), 900, 60), &ask, &mut seen).unwrap();
        assert_eq!(line(&replayed.ledger), whole(900), "{mode:?}");
    }
}

#[test]
fn who_begins_to_publish_before_the_play_is_counted_though_it_met_nobody_at_first() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &[]);
    let leader = ["--name", "/leader", "--life-cycle", "inactive"];
    let leader = scene.start("standin_node", &leader);
    let scout = scene.graph.player();
    // Before it has a node, the signal would end it.
    eventually(|| scout.graph().unwrap().iter().any(|node| node.name == "/leader"));
    let (mut looks, mut other) = (0, None);
    let mut seen = |progress: Progress| {
        looks += u32::from(progress.stage == Stage::Subscribe);
        if looks == 2 {
            // It publishes before it knows anybody, and then no more until its subscriber knows us.
            other = Some(start_other(&scene, &["--burst", "50"]));
            scene.await_published("/in", 50);
        } else if looks == 4 {
            leader.signal("USR1");
        }
    };
    let ask = Ask { mode: Mode::Lockstep, active: &["/leader"], ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 100, 60);
    let ledger = scene.play_while(&played, &ask, &mut seen).unwrap().ledger;
    assert!(looks >= 4 && other.is_some(), "{looks}");
    assert_eq!((line(&ledger), answered(&scene)), (whole(100), 100));
}

#[test]
fn what_a_node_can_t_be_given_by_another_is_no_loss_of_ours() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &[]);
    let best_effort = ["--pub", "/in:std_msgs/msg/String:1000:best_effort"];
    let paces = ["--every-us", "10000"];
    let words = [&["--name", "/other"][..], &best_effort, &paces].concat();
    let _other = scene.start("standin_node", &words);
    scene.await_published("/in", 5);
    let played = recording_of(&strings(RELIABLE), 300, 60);
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let ask = Ask { mode, drain: Duration::from_secs(1), ..DEFAULT };
        let replayed = scene.play(&played, &ask).unwrap();
        assert_eq!(line(&replayed.ledger), whole(300), "{mode:?}");
    }
}

#[test]
fn nor_is_what_one_of_its_subscriptions_is_given_and_another_is_not() {
    let scene = Scene::new();
    let both = ["--sub", "/in:std_msgs/msg/String:1000:best_effort"];
    let _lane = start_lane(&scene, "1000", &both);
    let best_effort = ["--name", "/other", "--pub", "/in:std_msgs/msg/String:1000:best_effort"];
    let other = [&best_effort[..], &["--every-us", "5000"]].concat();
    let other = scene.start("standin_node", &other);
    scene.await_published("/in", 5);
    // Nothing of it waits when ours begin.
    other.signal("STOP");
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 {
            other.signal("CONT");
            scene.await_published("/in", 11);
        }
    };
    // For as long as a second, so that somebody looks meanwhile.
    let ask = Ask { mode: Mode::Realtime, rate: 0.5, ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 500, 60);
    let replayed = scene.play_while(&played, &ask, &mut seen).unwrap();
    assert!(counts(&scene, Kind::Publisher, "/other", "/in").published > 10);
    assert_eq!(line(&replayed.ledger), whole(500));
}

#[test]
fn what_another_loses_that_did_not_know_the_node_yet_is_no_loss_of_ours() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "5000", &[]);
    // It publishes for the first time when the play has begun, and nothing of that comes to anybody.
    let late = ["--burst", "0", "--every-us", "1500000", "--meets-late-ms", "600000"];
    let _other = start_other(&scene, &late);
    eventually(|| {
        let all = scene.ledger.endpoints().unwrap();
        all.iter().any(|one| one.node == "/other" && one.matched.is_some())
    });
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(1), ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(RELIABLE), 3000, 60), &ask).unwrap().ledger;
    assert_eq!(line(&ledger), whole(3000));
    assert!(counts(&scene, Kind::Publisher, "/other", "/in").offered > 0);
    assert_eq!(counts(&scene, Kind::Subscription, "/lane", "/in").taken, 3000);
}

#[test]
fn nor_is_a_node_at_fault_beside_one_that_comes_late_and_falls_silent() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &["--delay-us", "3000"]);
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && progress.sent > 0 && other.is_none() {
            // It publishes before it knows anybody.
            other = Some(start_other(&scene, &["--burst", "50"]));
            scene.await_published("/in", 50);
        }
    };
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(5), ..DEFAULT };
    let replayed =
        scene.play_while(&recording_of(&strings(RELIABLE), 400, 60), &ask, &mut seen).unwrap();
    assert_eq!((line(&replayed.ledger), answered(&scene)), (whole(400), 400));
}

#[test]
fn the_play_begins_though_publishers_of_the_stack_come_and_go() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "100", &[]);
    let over = AtomicBool::new(false);
    let replayed = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(SeqCst) {
                // It publishes before it knows anybody.
                let _comes = start_other(&scene, &["--burst", "5"]);
                std::thread::sleep(Duration::from_millis(300));
            }
        });
        let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(3), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 900, 60), &ask);
        over.store(true, SeqCst);
        replayed.map(|replayed| replayed.ledger)
    });
    assert_eq!((line(&replayed.unwrap()), answered(&scene)), (whole(900), 900));
}

#[test]
fn who_asks_for_more_than_is_offered_is_not_waited_for() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "10", &["--delay-us", "1000"]);
    let wants = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let _odd = scene.start("standin_node", &["--name", "/odd", "--sub", wants]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(5), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 3000, 60);
    let ledger = scene.play(&played, &ask).map(|replayed| replayed.ledger).unwrap();
    assert_eq!(line(&ledger), whole(3000));
    let lines: Vec<&String> = ledger.topics[0].subscribers.iter().map(|one| &one.node).collect();
    assert_eq!(lines, ["/lane"]);
}

#[test]
fn nor_is_a_subscription_that_asks_for_more_beside_one_of_its_node_that_does_not() {
    let scene = Scene::new();
    let wants = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let _lane = start_lane(&scene, "10", &["--delay-us", "1000", "--sub", wants]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(5), ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(RELIABLE), 300, 60), &ask).unwrap().ledger;
    assert_eq!(line(&ledger), whole(300));
}
