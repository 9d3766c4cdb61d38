//! What is lost of ours beside what the stack publishes is counted as lost, and nothing else is.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bagpipe_replay::{Ledger, Mode, Progress, Stage, Strength};
use bagpipe_ros2ledger::Kind;

use crate::scene::{Ask, DEFAULT, RELAY, Scene, recording, recording_of};
use crate::standin::{Graph, LONG, Node, eventually};
use crate::{
    LATCHED, OUT, RELIABLE, STANDING, answered, counts, late_queue, losing_midway_from_rest,
    start_keeping, start_lane, start_lane_of, start_other, strings,
};

/// What was sent, received and lost, which was proved. Of the last callbacks it is known whether they
/// have ended where the last look finds the node at rest between two of the other publisher's messages.
fn proved(ledger: &Ledger) -> (u64, u64, u64) {
    assert!(ledger.strength >= Some(Strength::Taken), "{ledger:?}");
    (ledger.sent, ledger.received, ledger.dropped)
}

/// Waits until the node has taken all that waits for it.
fn await_rest(scene: &Scene) {
    scene.ledger.watch_matches(true);
    let lane = || counts(scene, Kind::Subscription, "/lane", "/in");
    let since = lane().seen_at + Duration::from_millis(100);
    eventually(|| lane().seen_at > since && lane().rested == Some(lane().taken));
}

#[test]
fn what_waited_of_the_stack_s_own_when_we_came_hides_no_loss_of_ours() {
    let scene = Scene::new();
    let _other = start_keeping(&scene, 100, &[]);
    let _lane = start_lane_of(&scene, &late_queue("100"), &["--delay-us", "8000"]);
    let ask = Ask { mode: Mode::Realtime, ..DEFAULT };
    let ledger = scene.play(&recording_of(&strings(LATCHED), 150, 60), &ask).unwrap().ledger;
    await_rest(&scene);
    let lost = 150 - answered(&scene);
    assert!(lost > 0, "the node was too fast");
    assert_eq!(proved(&ledger), (150, 150 - lost, lost));
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

#[test]
fn what_comes_while_a_node_is_away_hides_no_loss_of_ours() {
    let mut all_lost = 0;
    for _again in 0..3 {
        let scene = Scene::new();
        let mut lane = Spinning::start(&scene, "/in:std_msgs/msg/String:20:reliable");
        let taken = || counts(&scene, Kind::Subscription, "/lane", "/in").taken;
        let _other = start_other(&scene, &["--every-us", "10000"]);
        eventually(|| taken() > 20);
        let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(1), ..DEFAULT };
        let replayed = scene.play(&recording_of(&strings(RELIABLE), 300, 60), &ask).unwrap();
        lane.let_go();
        await_rest(&scene);
        let lost = 300 - answered(&scene);
        // What lies in its queue of twenty at the play's end it may take later.
        let (sent, received, dropped) = proved(&replayed.ledger);
        assert_eq!((sent, received + dropped), (300, 300));
        assert!((lost..=lost + 20).contains(&dropped), "{lost} lost, {dropped} reported");
        all_lost += lost;
    }
    assert!(all_lost > 0, "the node was too fast");
}

#[test]
fn what_another_overwrites_is_counted_and_not_waited_for_as_long_as_who_has_stopped() {
    let scene = Scene::new();
    let _lane = start_lane(&scene, "1", &["--delay-us", "3000"]);
    let _other = start_other(&scene, &["--every-us", "2000"]);
    scene.await_offered("/in", 5);
    // As many waits of so long would outlast the case.
    let ask = Ask { mode: Mode::Lockstep, drain: Duration::from_secs(20), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 150, 60), &ask).unwrap();
    let lost = 150 - answered(&scene);
    assert!(lost > 0, "the other was too slow");
    let (sent, received, dropped) = proved(&replayed.ledger);
    assert_eq!((sent, received + dropped), (150, 150));
    // The last one may come when it is not waited for any more.
    assert!((lost..=lost + 1).contains(&dropped), "{lost} lost, {dropped} reported");
}

// Promise: recording-is-compared
#[test]
fn what_a_publisher_goes_on_to_publish_makes_up_for_nothing_of_it_that_was_lost() {
    for (mode, every_us, loses, returns_late_us) in [
        (Mode::Max, "1000", "1", "0"),
        (Mode::Realtime, "1000", "20", "0"),
        (Mode::Realtime, "20000", "1", "0"),
        // A call is under way for four fifths of the time.
        (Mode::Realtime, "5000", "1", "20000"),
    ] {
        let scene = Scene::new();
        let _lane = start_lane(&scene, "10", &["--delay-us", "500"]);
        let talks = "/talk:std_msgs/msg/String:1000:reliable";
        let talks = ["--name", "/talker", "--pub", talks, "--every-us", every_us, "--loses", loses];
        let late = ["--returns-late-us", returns_late_us];
        let talker = scene.start("standin_node", &[&talks[..], &late].concat());
        scene.await_published("/talk", 1);
        let (drain, stable) = (Duration::from_secs(1), STANDING);
        let ask = Ask { mode, record: &["/talk"], drain, stable, ..DEFAULT };
        let recording = recording_of(&strings(RELIABLE), 3000, 60);
        let mut seen = losing_midway_from_rest(&scene, &talker, "/talker");
        let played = scene.play_while(&recording, &ask, &mut seen);
        let Err(error) = played else { panic!("passed, which lost {loses}") };
        assert_eq!(error.reason(), "RecordingIncomplete", "{error}");
        let lost: u64 = loses.parse().unwrap();
        let sentence = error.to_string();
        let (before, _) =
            sentence.split_once(" messages of /talk did not reach the recorder").unwrap();
        let missing: u64 = before.rsplit(' ').next().unwrap().parse().unwrap();
        // One that is published just then may stand for one of them.
        assert!((lost.max(2) - 1..=lost).contains(&missing), "{sentence}");
    }
}

#[test]
fn what_is_published_by_who_never_met_the_recorder_is_lost_where_it_was_there_before_the_play() {
    for (elsewhere, fails) in [(true, true), (false, false)] {
        let scene = Scene::new();
        let _relay = scene.start("standin_node", &RELAY);
        let far = ["--name", "/far", "--pub", "/out2:std_msgs/msg/String:1000:reliable"];
        let far = [&far[..], &["--burst", "0", "--every-us", "1000"]].concat();
        // In another domain it is in the ledger alone.
        let domain = if elsewhere { &Graph::new() } else { &scene.graph };
        let _far = domain.start_counting("standin_node", &far, &scene.ledger);
        scene.await_published("/out2", 1);
        let ask = Ask { mode: Mode::Realtime, ..DEFAULT };
        let played = scene.play(&recording(&["/in"], 100, 100), &ask);
        let Err(error) = played else {
            assert!(!fails, "passed without a message of /out2");
            continue;
        };
        let sentence = error.to_string();
        assert!(fails && error.reason() == "RecordingIncomplete", "{sentence}");
        assert!(
            sentence
                .contains(" messages of /out2 did not reach the recorder, which /far did not know")
        );
    }
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
    // It ends when the node is at rest, and has taken what it will.
    let ask = Ask { mode: Mode::Realtime, drain: LONG, ..DEFAULT };
    let recording = recording(&["/in", "/two"], 200, 60);
    let ledger = scene.play_while(&recording, &ask, &mut seen).unwrap().ledger;
    let line = &ledger.topics[0].subscribers[0];
    assert_eq!((ledger.sent, line.node.as_str()), (200, "/lossy"), "{ledger:?}");
    let lost = 100 - counts(&scene, Kind::Subscription, "/lossy", "/in").taken;
    assert!(line.strength >= Strength::Taken, "{line:?}");
    assert_eq!(line.dropped, lost);
}
