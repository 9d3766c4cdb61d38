//! Publishers of the stack beside our recorder and beside our player: what they publish is none of
//! ours, and comes before their calls have returned, as on a busy machine.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bagpipe_log::Connection;
use bagpipe_replay::{Mode, Progress, Replayed, Stage, Strength};
use bagpipe_ros2ledger::{Counts, Endpoint, Kind};
use scene::{Ask, DEFAULT, RELAY, Scene, imu, recorded, recording, recording_of};
use standin::{Node, eventually};

#[test]
fn who_has_published_before_and_returns_late_lacks_nothing_of_the_recording() {
    let scene = Scene::new();
    let words = ["--name", "/relay", "--relay", "/in=/out", "--returns-late-us", "30000"];
    let (input, output) =
        ("/in:sensor_msgs/msg/Imu:10:reliable", "/out:std_msgs/msg/String:100:reliable");
    let ends = ["--sub", input, "--pub", output];
    let _relay = scene.start("standin_node", &[&words[..], &ends].concat());
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    for _before in 0..2 {
        let replayed = scene.play(&recording(&["/in"], 30, 50), &ask).unwrap();
        assert_eq!(recorded(&replayed).len(), 30);
    }
}

/// A channel of strings, which the stand-in's nodes publish as well.
fn strings(qos: &str) -> Connection {
    Connection {
        datatype: "std_msgs/msg/String".to_owned(),
        definition: "string data\n".into(),
        offered_qos: Some(qos.to_owned()),
        ..imu("/in")
    }
}

const RELIABLE: &str =
    "- history: keep_last\n  depth: 1000\n  reliability: reliable\n  durability: volatile\n";
const LATCHED: &str =
    "- history: keep_last\n  depth: 100\n  reliability: reliable\n  durability: transient_local\n";
const OUT: [&str; 2] = ["--pub", "/out:std_msgs/msg/String:5000:reliable"];

/// A node of the stack that answers /in, of which its queue holds so many.
fn start_lane(scene: &Scene, depth: &str, more: &[&str]) -> Node {
    let queue = format!("/in:std_msgs/msg/String:{depth}:reliable");
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--sub", &queue];
    scene.start("standin_node", &[&lane[..], &OUT, more].concat())
}

/// One that publishes /in as well.
fn start_other(scene: &Scene, more: &[&str]) -> Node {
    let other = ["--name", "/other", "--pub", "/in:std_msgs/msg/String:1000:reliable"];
    scene.start("standin_node", &[&other[..], more].concat())
}

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
        let ledger = &replayed.ledger;
        if ledger.strength != Some(Strength::Sent) {
            assert_eq!((ledger.sent, ledger.received, ledger.dropped), (50, 50, 0));
        }
    }
}

#[test]
fn where_a_publish_is_always_under_way_nobody_knows_what_a_node_got_of_ours() {
    let replayed = beside_another(&Scene::new(), "60000000", "1", 1).remove(0);
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (50, Some(Strength::Sent)));
    let expected = "the stack publishes /in too, and /lane may have had messages of that to take when \
                    ours began, so that what it got of ours can't be known";
    assert!(
        replayed.playback.warnings.iter().any(|one| one == expected),
        "{:?}",
        replayed.playback.warnings
    );
}

/// Plays messages to a node that takes its time for each, and for which as many of another node's wait
/// as its queue holds. How many were lost by then, by all that it has taken; and what the ledger says.
fn behind_others(depth: u64, delay: &str, mode: Mode) -> (u64, u64) {
    let scene = Scene::new();
    let queue = format!("/in:std_msgs/msg/String:{depth}:reliable:transient_local");
    let other =
        ["--name", "/other", "--pub", &queue, "--burst", &depth.to_string()].map(str::to_owned);
    let _other = scene.start("standin_node", &other.each_ref().map(String::as_str));
    scene.await_published("/in", depth);
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--delay-us", delay, "--sub", &queue];
    let _lane = scene.start("standin_node", &[&lane[..], &OUT].concat());
    let played = recording_of(&strings(LATCHED), 150, 60);
    let replayed = scene.play(&played, &Ask { mode, ..DEFAULT }).unwrap();
    let all = scene.ledger.endpoints().unwrap();
    let lane =
        all.iter().find(|one| one.kind == Kind::Subscription && one.node == "/lane").unwrap();
    assert!(replayed.ledger.strength >= Some(Strength::Taken), "{:?}", replayed.ledger.strength);
    assert_eq!(replayed.ledger.sent, 150);
    (depth + 150 - lane.counts.taken, replayed.ledger.dropped)
}

#[test]
fn what_waited_of_the_stack_s_own_when_we_came_hides_no_loss_of_ours() {
    let (lost, reported) = behind_others(100, "8000", Mode::Realtime);
    assert!(lost > 0, "the node was too fast");
    assert_eq!(reported, lost);
}

#[test]
fn nor_does_it_make_room_in_a_queue_that_has_none() {
    assert_eq!(behind_others(10, "50000", Mode::Max), (0, 0));
}

#[test]
fn nor_is_a_loss_hidden_by_what_a_publisher_keeps_for_the_node_and_that_is_on_its_way() {
    let scene = Scene::new();
    let queue = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let keeps = ["--name", "/other", "--pub", queue, "--burst", "10", "--meets-late-ms", "60000"];
    let _other = scene.start("standin_node", &keeps);
    scene.await_published("/in", 10);
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--sub", queue];
    let _lane = scene.start("standin_node", &[&lane[..], &OUT].concat());
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(LATCHED), 50, 60), &ask).unwrap().ledger;
    assert_eq!((ledger.sent, ledger.strength), (50, Some(Strength::Sent)));
}

/// Plays messages to a node that is at other work for so long when it is given as many of another's as
/// its queue holds, of which it was seen to be empty before. How many were lost by then, by all that it
/// has taken; and what was reported.
fn while_at_other_work(microseconds: &str) -> (u64, Replayed) {
    let scene = Scene::new();
    let queue = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let work = "/work:std_msgs/msg/String:10:reliable:transient_local";
    let lane = ["--name", "/lane", "--relay", "/in=/out", "--first-us", microseconds];
    let ends = ["--sub", work, "--sub", queue];
    let _lane = scene.start("standin_node", &[&lane[..], &ends, &OUT].concat());
    let taken = |topic: &str| {
        let all = scene.ledger.endpoints().unwrap();
        let of = |one: &&Endpoint| one.kind == Kind::Subscription && one.topic == topic;
        all.iter().find(of).map_or(0, |one| one.counts.taken)
    };
    let _worker =
        scene.start("standin_node", &["--name", "/worker", "--pub", work, "--burst", "1"]);
    eventually(|| taken("/work") == 1);
    let _other =
        scene.start("standin_node", &["--name", "/other", "--pub", queue, "--burst", "10"]);
    scene.await_published("/in", 10);
    let qos = LATCHED.replace("100", "10");
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(&qos), 50, 60), &ask).unwrap();
    assert_eq!(replayed.ledger.sent, 50);
    (60 - taken("/in"), replayed)
}

#[test]
fn nor_where_the_node_is_at_other_work_and_looks_at_no_queue() {
    let (lost, replayed) = while_at_other_work("500000");
    assert_eq!((lost, replayed.ledger.dropped), (0, 0));
    assert_eq!(replayed.ledger.strength, Some(Strength::Called));
}

#[test]
fn nor_is_a_loss_hidden_where_that_work_takes_longer_than_is_waited() {
    let (lost, replayed) = while_at_other_work("4000000");
    let ledger = &replayed.ledger;
    let unproved = ledger.strength == Some(Strength::Sent);
    assert!(unproved || ledger.dropped == lost, "{lost} lost; {ledger:?}");
}

#[test]
fn who_published_uncounted_and_has_left_is_named_at_the_end() {
    let scene = Scene::new();
    let input = "/in:sensor_msgs/msg/Imu:10:reliable";
    let _relay = scene.start("standin_node", &RELAY);
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
    assert_eq!(replayed.ledger.strength, Some(Strength::Sent));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("/leaves publishes /in too"), "{warnings}");
}

/// A node that takes for 6 ms in each 100, as one that spins in a loop, until it is let go. It
/// answers what is played, which is longer than what the stack publishes.
struct Spinning {
    _node: Arc<Node>,
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Spinning {
    fn start(scene: &Scene, queue: &str) -> Spinning {
        let lane = ["--name", "/lane", "--relay", "/in=/out", "--sub", queue];
        let words = [&lane[..], &OUT, &["--answers-from", "60"]].concat();
        let node = Arc::new(scene.start("standin_node", &words));
        let over = Arc::new(AtomicBool::new(false));
        let thread = std::thread::spawn({
            let (node, over) = (Arc::clone(&node), Arc::clone(&over));
            move || {
                let mut next = Instant::now();
                while !over.load(SeqCst) {
                    node.signal("CONT");
                    std::thread::sleep(Duration::from_millis(6));
                    node.signal("STOP");
                    next += Duration::from_millis(100);
                    std::thread::sleep(next.saturating_duration_since(Instant::now()));
                }
                node.signal("CONT");
            }
        });
        Spinning { _node: node, over, thread: Some(thread) }
    }

    /// From now on it takes whatever comes.
    fn let_go(&mut self) {
        self.over.store(true, SeqCst);
        let _has_ended = self.thread.take().map(JoinHandle::join);
    }
}

impl Drop for Spinning {
    fn drop(&mut self) {
        self.let_go();
    }
}

/// What a node has done on a topic.
fn counts(scene: &Scene, kind: Kind, node: &str, topic: &str) -> Counts {
    let all = scene.ledger.endpoints().unwrap();
    let of = |one: &&Endpoint| one.kind == kind && one.node == node && one.topic == topic;
    all.iter().find(of).map(|one| one.counts).unwrap_or_default()
}

#[test]
fn what_comes_while_a_node_is_away_hides_no_loss_of_ours() {
    for _again in 0..3 {
        let scene = Scene::new();
        let mut lane = Spinning::start(&scene, "/in:std_msgs/msg/String:20:reliable");
        let lanes = || counts(&scene, Kind::Subscription, "/lane", "/in");
        let other = start_other(&scene, &["--every-us", "10000"]);
        eventually(|| lanes().taken > 20);
        let mut stopped = false;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && !stopped {
                other.signal("STOP");
                stopped = true;
            }
        };
        let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(1), ..DEFAULT };
        let played = recording_of(&strings(RELIABLE), 300, 60);
        let replayed = scene.play_while(&played, &ask, &mut seen).unwrap();
        lane.let_go();
        scene.ledger.watch_matches(true);
        let since = lanes().seen_at + Duration::from_millis(100);
        eventually(|| lanes().seen_at > since && lanes().rested == Some(lanes().taken));
        let lost = 300 - counts(&scene, Kind::Publisher, "/lane", "/out").published;
        let ledger = &replayed.ledger;
        let unproved = ledger.strength == Some(Strength::Sent);
        assert!(unproved || ledger.dropped >= lost, "{lost} lost; {ledger:?}");
    }
}

#[test]
fn who_subscribes_again_beside_another_publisher_is_unproved_and_has_lost_nothing() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &["--renew-every", "20"]);
    let _other = start_other(&scene, &["--burst", "5"]);
    scene.await_published("/in", 5);
    let ask = Ask { mode: Mode::Lockstep, ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 100, 60), &ask).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (100, Some(Strength::Sent)));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("can't be known") && !warnings.contains(" lost "), "{warnings}");
}

#[test]
fn beside_who_begins_to_publish_uncounted_nothing_is_proved_and_nothing_called_lost() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "5000", &[]);
    let mut other = None;
    let looks = scene.graph.player();
    let is_there = || looks.graph().unwrap().iter().any(|node| node.name == "/other");
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && other.is_none() {
            let queue = "/in:std_msgs/msg/String:1000:reliable";
            let words = ["--name", "/other", "--pub", queue, "--burst", "1"];
            other = Some(scene.start_uncounted("standin_node", &words));
            eventually(is_there);
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(2), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 700, 60);
    let replayed = scene.play_while(&played, &ask, &mut seen).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (700, Some(Strength::Sent)));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(
        warnings.contains("/other publishes /in too") && !warnings.contains(" lost "),
        "{warnings}"
    );
}

#[test]
fn where_another_s_messages_come_and_go_a_lost_one_is_waited_for_once() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1", &["--delay-us", "3000"]);
    let _other = start_other(&scene, &["--every-us", "5000"]);
    scene.await_offered("/in", 5);
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(1), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 30, 60), &ask).unwrap();
    let ledger = &replayed.ledger;
    let whole = ledger.received == 30 && ledger.dropped == 0;
    assert!(whole || ledger.strength == Some(Strength::Sent), "{ledger:?}");
}

#[test]
fn what_another_publishes_overwrites_none_of_ours_at_the_subscribers_pace() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "10", &["--delay-us", "2000"]);
    let _other = start_other(&scene, &["--every-us", "20000"]);
    scene.await_offered("/in", 5);
    let ask = Ask { mode: Mode::Max, ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(RELIABLE), 1000, 60), &ask).unwrap().ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (1000, 1000, 0));
}

#[test]
fn what_one_who_came_late_published_before_it_was_known_is_no_loss_of_ours() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &[]);
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && other.is_none() {
            // It publishes before it knows anybody.
            other = Some(start_other(&scene, &["--every-us", "1000"]));
        }
    };
    for mode in [Mode::Lockstep, Mode::Realtime] {
        let ask = Ask { mode, drain: Duration::from_secs(1), ..DEFAULT };
        let replayed =
            scene.play_while(&recording_of(&strings(RELIABLE), 900, 60), &ask, &mut seen).unwrap();
        let ledger = &replayed.ledger;
        let whole = (ledger.received, ledger.dropped) == (900, 0);
        assert!(whole || ledger.strength == Some(Strength::Sent), "{mode:?} {ledger:?}");
    }
}

#[test]
fn who_begins_to_publish_before_the_play_is_counted_though_it_met_nobody_at_first() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1000", &[]);
    let leader = ["--name", "/leader", "--life-cycle", "inactive"];
    let leader = scene.start("standin_node", &leader);
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
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (100, 100, 0));
    assert_eq!(ledger.strength, Some(Strength::Called));
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
        let ledger = &replayed.ledger;
        assert_eq!((ledger.sent, ledger.received, ledger.dropped), (300, 300, 0), "{mode:?}");
        assert_eq!(ledger.strength, Some(Strength::Called), "{:?}", replayed.playback.warnings);
    }
}

#[test]
fn where_another_reaches_one_of_a_node_s_subscriptions_nothing_is_proved() {
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
        }
    };
    let ask = Ask { mode: Mode::Realtime, ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 1000, 60);
    let replayed = scene.play_while(&played, &ask, &mut seen).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (1000, Some(Strength::Sent)));
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
    assert_eq!((ledger.sent, ledger.strength), (3000, Some(Strength::Sent)));
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
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(1), ..DEFAULT };
    let replayed =
        scene.play_while(&recording_of(&strings(RELIABLE), 400, 60), &ask, &mut seen).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.strength), (400, Some(Strength::Sent)));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("began to publish /in too"), "{warnings}");
    assert_eq!(counts(&scene, Kind::Subscription, "/lane", "/in").taken, 400);
}

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
    let _other = other.then(|| {
        let other = start_other(&scene, &["--every-us", "50000"]);
        scene.await_published("/in", 2);
        other
    });
    let ask = Ask { mode, drain: Duration::from_secs(1), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 1000, 60);
    let replayed = std::thread::scope(|scope| {
        scope.spawn(|| {
            let taken = || counts(&scene, Kind::Subscription, "/sleeper", "/in").taken;
            eventually(|| taken() > 20);
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
fn a_node_keeps_its_line_where_somebody_comes_who_publishes_just_before_the_first_message() {
    let scene = Scene::new();
    let lossy = ["--name", "/lossy", "--delay-us", "20000"];
    let lossy = [&lossy[..], &["--sub", "/in:sensor_msgs/msg/Imu:1:reliable"]].concat();
    let _lossy = scene.start("standin_node", &lossy);
    let fine = ["--name", "/fine", "--relay", "/two=/out"];
    let fine = [&fine[..], &["--sub", "/two:sensor_msgs/msg/Imu:1000:reliable"], &OUT].concat();
    let _fine = scene.start("standin_node", &fine);
    let mut other = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && other.is_none() {
            let words = ["--name", "/other", "--pub", "/in:sensor_msgs/msg/Imu:10:reliable"];
            let words = [&words[..], &["--burst", "0"]].concat();
            other = Some(scene.start("standin_node", &words));
            eventually(|| {
                let all = scene.ledger.endpoints().unwrap();
                all.iter().any(|one| one.node == "/other" && one.kind == Kind::Publisher)
            });
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(1), ..DEFAULT };
    let recording = recording(&["/in", "/two"], 200, 60);
    let ledger = scene.play_while(&recording, &ask, &mut seen).unwrap().ledger;
    let line = &ledger.topics[0].subscribers[0];
    assert_eq!((ledger.sent, line.node.as_str()), (200, "/lossy"), "{ledger:?}");
    let lost = 100 - counts(&scene, Kind::Subscription, "/lossy", "/in").taken;
    assert!(line.strength == Strength::Sent || line.dropped == lost, "{lost}: {ledger:?}");
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
        let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(1), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 900, 60), &ask);
        over.store(true, SeqCst);
        replayed.map(|replayed| replayed.ledger)
    });
    let ledger = replayed.unwrap();
    let whole = (ledger.received, ledger.dropped) == (900, 0);
    assert!(whole || ledger.strength == Some(Strength::Sent), "{ledger:?}");
}

#[test]
fn who_asks_for_more_than_is_offered_is_not_waited_for() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "10", &["--delay-us", "1000"]);
    let wants = "/in:std_msgs/msg/String:10:reliable:transient_local";
    let _odd = scene.start("standin_node", &["--name", "/odd", "--sub", wants]);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Max, drain: Duration::from_secs(1), ..DEFAULT };
    let played = recording_of(&strings(RELIABLE), 3000, 60);
    let ledger = scene.play(&played, &ask).map(|replayed| replayed.ledger).unwrap();
    assert_eq!(
        (ledger.received, ledger.dropped, ledger.strength),
        (3000, 0, Some(Strength::Called))
    );
    let lines: Vec<&String> = ledger.topics[0].subscribers.iter().map(|one| &one.node).collect();
    assert_eq!(lines, ["/lane"]);
}
