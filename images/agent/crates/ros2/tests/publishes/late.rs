//! Who comes late, and who subscribes again: what is kept for it, and given to it, hides no loss of what is
//! played from then on, and each subscription goes on where the one was whose place it takes.

use std::time::Duration;

use bagpipe_replay::{Ledger, LedgerSubscriber, Mode, Progress, Replayed, Stage, Strength};
use bagpipe_ros2ledger::{Counts, Endpoint, Kind};

use crate::scene::{self, Ask, DEFAULT, MS, Scene, recording_of};
use crate::standin::{Node, eventually};
use crate::{LATCHED, RELIABLE, counts, late_queue, line, queue, start_lane_of, strings, whole};

/// The number of the message that each answer is to, in the order of their coming.
fn answered_numbers(replayed: &Replayed, messages: u64) -> Vec<u64> {
    scene::answered_numbers(replayed, messages, 60)
}

/// How many of them are behind all before them.
fn behind(numbers: &[u64]) -> u64 {
    let ahead = numbers.iter().scan(0, |most, number| {
        let is_new = *number >= *most;
        *most = (*most).max(number + 1);
        Some(is_new)
    });
    ahead.filter(|is_new| *is_new).count() as u64
}

/// Plays messages that are kept for who comes late to a node that subscribes again now and then, and is
/// given again what is kept, as far as its queue holds it: to which messages its answers are, and what
/// the ledger says.
fn to_one_that_subscribes_again(
    mode: Mode,
    queue: &str,
    messages: u64,
    more: &[&str],
) -> (Vec<u64>, Ledger) {
    let scene = Scene::new();
    let _lane = start_lane_of(&scene, queue, more);
    let ask = Ask { mode, drain: Duration::from_secs(2), ..DEFAULT };
    let replayed = scene.play(&recording_of(&strings(LATCHED), messages, 60), &ask).unwrap();
    (answered_numbers(&replayed, messages), replayed.ledger)
}

fn every_100(delay_us: &str) -> [&str; 4] {
    ["--renew-every", "100", "--delay-us", delay_us]
}

#[test]
fn what_is_given_to_a_node_again_hides_no_loss() {
    let queue = late_queue("50");
    let (answers, ledger) =
        to_one_that_subscribes_again(Mode::Lockstep, &queue, 400, &every_100("0"));
    assert!(answers.len() > 400, "nothing was given again");
    assert_eq!((line(&ledger), behind(&answers)), (whole(400), 400));
    let best_effort = "/in:std_msgs/msg/String:10:best_effort:transient_local";
    for (mode, queue, delay) in [
        (Mode::Max, late_queue("10").as_str(), "1000"),
        (Mode::Realtime, &late_queue("10"), "2000"),
        // Who does not confirm what it has is given nothing again.
        (Mode::Max, best_effort, "1000"),
    ] {
        let (answers, ledger) = to_one_that_subscribes_again(mode, queue, 400, &every_100(delay));
        // At the play's end what lay in the queue that it destroyed last may yet come again.
        let counted = ledger.received..=ledger.received + 10;
        let all = ledger.sent == 400 && counted.contains(&behind(&answers));
        assert!(all, "{} {mode:?} {queue} {ledger:?}", behind(&answers));
    }
}

#[test]
fn of_two_subscriptions_each_goes_on_where_the_one_was_whose_place_it_takes() {
    let of_two = |mode, queue: &str, delay| {
        let more = [&every_100(delay)[..], &["--sub", queue]].concat();
        to_one_that_subscribes_again(mode, queue, 350, &more)
    };
    // All that lay in a queue that was destroyed is given again. None is destroyed near the end.
    for (mode, delay) in [(Mode::Lockstep, "0"), (Mode::Max, "500")] {
        let (answers, ledger) = of_two(mode, &late_queue("50"), delay);
        assert_eq!((ledger.received, behind(&answers)), (350, 350), "{mode:?} {ledger:?}");
    }
    // None of it is.
    let (answers, ledger) = of_two(Mode::Max, &queue("10"), "500");
    let answered = answers.len() as u64;
    assert!(answered < 350, "nothing was lost");
    assert!((answered - 10..=answered).contains(&ledger.received), "{answered} {ledger:?}");
}

/// Whether each subscription that the node has had is late, those first that were listed first.
fn late(scene: &Scene) -> Vec<bool> {
    let all = scene.ledger.endpoints().unwrap();
    let lanes = |one: &&Endpoint| one.kind == Kind::Subscription && one.node == "/lane";
    all.iter().filter(lanes).map(|one| one.late).collect()
}

/// What is reported of the node.
fn line_of_lane(replayed: &Replayed) -> &LedgerSubscriber {
    let lines = &replayed.ledger.topics[0].subscribers;
    lines.iter().find(|line| line.node == "/lane").unwrap()
}

/// Plays at full speed to a node whose first subscription is faster than its second, which answers: how
/// often it does, and which of its subscriptions are late.
fn to_a_fast_and_a_slow_one(
    kept: &str,
    queue: &str,
    messages: u64,
    more: &[&str],
) -> (u64, Vec<bool>, Ledger) {
    let scene = Scene::new();
    let lane = [&["--sub", queue, "--threads", "2"], more].concat();
    let _lane = start_lane_of(&scene, queue, &lane);
    let replayed = scene.play(&recording_of(&strings(kept), messages, 60), &DEFAULT).unwrap();
    let answers = answered_numbers(&replayed, messages).len() as u64;
    (answers, late(&scene), replayed.ledger)
}

#[test]
fn one_that_was_ahead_and_is_created_again_between_two_looks_is_ahead_as_before() {
    let more = ["--slow", "2:20000", "--renew", "1:100:50000"];
    let (answered, _, ledger) = to_a_fast_and_a_slow_one(LATCHED, &late_queue("10"), 150, &more);
    assert_eq!((answered, line(&ledger)), (150, whole(150)));
}

#[test]
fn what_lay_in_the_queue_of_one_that_goes_and_comes_again_is_lost() {
    let more = ["--slow", "2:5000", "--renew", "2:100:100000"];
    let (answered, _, ledger) = to_a_fast_and_a_slow_one(RELIABLE, &queue("20"), 400, &more);
    assert_eq!((ledger.received, ledger.dropped), (answered, 400 - answered), "{ledger:?}");
    assert!(answered <= 385, "{answered}: nothing lay in its queue");
}

/// Messages of which it is not known what became of them.
fn unknown(sent: u64) -> (u64, u64, u64, Option<Strength>) {
    (sent, 0, sent, Some(Strength::Sent))
}

/// What lay in the queue of the one may come to the other, and in the time of both each gets all.
#[test]
fn of_one_that_is_created_before_the_one_before_it_is_destroyed_nothing_is_known() {
    for (kept, queue) in [(RELIABLE, queue("10")), (LATCHED, late_queue("10"))] {
        for apart in ["0", "50000"] {
            let scene = Scene::new();
            let renewed = format!("1:100:{apart}");
            let more = ["--renew", &renewed, "--overlaps", "--delay-us", "1000"];
            let _lane = start_lane_of(&scene, &queue, &more);
            let replayed = scene.play(&recording_of(&strings(kept), 300, 60), &DEFAULT).unwrap();
            assert_eq!(line(&replayed.ledger), unknown(300), "{queue} {apart}");
            let warning = "a subscription of /lane to /in came or went during the play, so that what \
                           it got of ours can't be known";
            assert!(replayed.playback.warnings.iter().any(|one| one == warning));
        }
    }
}

/// What it is given again is ours, too, and may be what it was given before.
#[test]
fn of_what_is_given_again_without_its_publisher_nothing_is_known() {
    let more = [&every_100("1000")[..], &["--origins", "none"]].concat();
    let queue = late_queue("10");
    let (_, ledger) = to_one_that_subscribes_again(Mode::Max, &queue, 250, &more);
    assert_eq!(line(&ledger), unknown(250));
}

/// The one that stays has taken all, and the other one has not.
#[test]
fn where_one_of_two_goes_for_good_while_messages_wait_for_it_nothing_is_known() {
    let more = ["--slow", "2:20000", "--renew", "2:50:60000000"];
    let scene = Scene::new();
    let queue = queue("10");
    let lane = [&["--sub", queue.as_str(), "--threads", "2"], &more[..]].concat();
    let _lane = start_lane_of(&scene, &queue, &lane);
    let replayed = scene.play(&recording_of(&strings(RELIABLE), 150, 60), &DEFAULT).unwrap();
    assert_eq!(line(&replayed.ledger), unknown(150));
}

/// To a node that comes back after 1.5 s nothing was sent meanwhile.
#[test]
fn what_is_kept_while_a_node_is_away_was_not_sent_to_it() {
    let scene = Scene::new();
    let first = ["--name", "/first", "--delay-us", "1000", "--sub", &queue("10")];
    let _first = scene.start("standin_node", &first);
    let _lane = start_lane_of(&scene, &late_queue("100"), &["--renew", "1:1000:1500000"]);
    scene.await_subscriptions(2);
    let replayed = scene.play(&recording_of(&strings(LATCHED), 3500, 60), &DEFAULT).unwrap();
    assert_eq!(late(&scene), [false, true]);
    let line = line_of_lane(&replayed);
    let answers = answered_numbers(&replayed, 3500).len() as u64;
    // One message may have found room just before it was listed, and go out behind that: it comes with the
    // hundred that were kept or behind them, before the player meets the node or after.
    let of_ours = answers - 101..=answers - 99;
    assert!(of_ours.contains(&line.received), "{answers} answers, {line:?}");
    assert_eq!(line.received + line.dropped, 3500);
}

/// A node that comes when two hundred messages are out is given the last four hundred, which are kept; when
/// it has taken some of what goes out from then on, it is stopped, until its queue has overwritten others.
#[test]
fn what_is_kept_for_a_node_that_comes_late_hides_no_loss_of_what_is_played_from_then_on() {
    let kept = LATCHED.replace("depth: 100", "depth: 400");
    let scene = Scene::new();
    let first = ["--name", "/first", "--sub", &queue("5000")];
    let _first = scene.start("standin_node", &first);
    let (mut lane, mut stopped, mut goes_on): (Option<Node>, _, _) = (None, None, false);
    let mut seen = |progress: Progress| {
        let of = |node| counts(&scene, Kind::Subscription, node, "/in");
        match (&lane, stopped) {
            (None, _) if progress.stage == Stage::Play && of("/first").taken >= 200 => {
                lane = Some(start_lane_of(&scene, &late_queue("400"), &[]));
                // Nothing goes out meanwhile: what it is given first is what was kept.
                eventually(|| of("/lane").taken > 0);
            }
            (Some(node), None) if of("/lane").taken_own >= 50 => {
                node.signal("STOP");
                stopped = Some(of("/first").taken);
            }
            (Some(node), Some(since)) if !goes_on && of("/first").taken >= since + 700 => {
                node.signal("CONT");
                goes_on = true;
            }
            _ => {}
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(2), ..DEFAULT };
    let recording = recording_of(&strings(&kept), 6000, 60);
    let replayed = scene.play_while(&recording, &ask, &mut seen).unwrap();
    assert!(goes_on, "the machine was too slow");
    let line = line_of_lane(&replayed);
    // What it had missed is not separated from what it lost.
    assert_eq!(line.received + line.dropped, 6000);
    // Of what is kept some may have gone out after it was listed, on a slow machine most.
    let Counts { taken, taken_own, .. } = counts(&scene, Kind::Subscription, "/lane", "/in");
    assert_eq!(line.received, taken_own, "{taken} taken, {line:?}");
    assert!(taken_own < taken, "{taken} taken, and none of what was kept");
}

/// What goes out between its listing and the next look was sent to it.
#[test]
fn a_node_that_comes_during_the_lead_in_by_the_clock_lacks_nothing_of_the_window() {
    let kept = LATCHED.replace("depth: 100", "depth: 1000");
    let scene = Scene::new();
    let _first = scene.start("standin_node", &["--name", "/first", "--sub", &queue("5000")]);
    let mut lane = None;
    let mut seen = |_: Progress| {
        let taken = |node| counts(&scene, Kind::Subscription, node, "/in").taken;
        if lane.is_none() && taken("/first") >= 200 {
            lane = Some(start_lane_of(&scene, &late_queue("1000"), &[]));
            eventually(|| taken("/lane") > 0);
        }
    };
    let drain = Duration::from_secs(2);
    // Long enough for a slow machine to start a node in.
    let ask = Ask { mode: Mode::Realtime, lead_in: 4000 * MS, drain, ..DEFAULT };
    let recording = recording_of(&strings(&kept), 5000, 60);
    let replayed = scene.play_while(&recording, &ask, &mut seen).unwrap();
    let line = line_of_lane(&replayed);
    assert_eq!((line.received, line.dropped), (1000, 0));
}
