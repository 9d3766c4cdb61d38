//! Which messages of the bag go out, what is counted, what is recorded.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros/tests/graph/mod.rs"]
mod graph;
mod scene;
#[path = "../../bag/tests/witness/mod.rs"]
mod witness;

use std::collections::BTreeMap;

use bagpipe_replay::{Mode, Window, replay_together};
use graph::{Graph, Process, wait_until};
use scene::{TMP, bag_of_words, node, pr2, read_back, request, run, words};
use witness::Witness;

const MS: u64 = 1_000_000;

fn heard(process: &Process) -> Vec<String> {
    let lines = process.lines();
    lines.iter().filter_map(|line| line.strip_prefix("word ").map(str::to_owned)).collect()
}

#[test]
fn the_lead_in_is_played_counted_apart_and_not_recorded() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = graph.python(&node("relay.py"), &["/joint_states", "/relayed", "0", "0"]);
    let mut request = request(&bag, &graph.uri);
    let (first, last) = bag.time_range().unwrap();
    let start = first + 4_000 * MS;
    let end = first + 8_000 * MS;
    assert!(end < last);
    request.window = Window { lead_in_start: first + 2_000 * MS, start, end };
    request.topics = vec!["/joint_states".to_owned()];
    request.record_topics = vec!["/relayed".to_owned()];
    let timeline = bag.timeline(|_| true).unwrap();
    let lead_in = timeline.between(first + 2_000 * MS, start).len() as u64;
    let counted = timeline.between(start, end).len() as u64;
    let replayed = run(&bag, &request).unwrap();
    let ledger = &replayed.ledger;
    eprintln!("{lead_in} lead-in, {counted} counted of 1598");
    assert!(lead_in > 100 && counted > 200);
    assert_eq!((ledger.lead_in, ledger.sent), (lead_in, counted));
    assert_eq!((ledger.received, ledger.dropped), (counted, 0));
    assert_eq!(relay.last_number("seen "), lead_in + counted);
    // An answer to the last lead-in messages may still arrive when counting has begun.
    let recorded = replayed.recorded.messages;
    assert!((counted..counted + lead_in).contains(&recorded), "{recorded}");
    let times: Vec<u64> = read_back(&replayed).iter().map(|(_, time, _)| *time).collect();
    assert!(times.iter().all(|time| (start..end).contains(time)));
}

#[test]
fn latched_messages_in_force_are_carried_per_publisher_and_come_first() {
    let connections = [
        words("/map", "/mapper", true),
        words("/map", "/patcher", true),
        words("/talk", "/talker", false),
    ];
    let bag = bag_of_words(
        &connections,
        &[
            (0, 10, "old map"),
            (2, 15, "unheard"),
            (0, 20, "map"),
            (1, 30, "patch"),
            (2, 100, "warm"),
            (2, 200, "one"),
            (2, 300, "two"),
            (2, 400, "late"),
        ],
    );
    let graph = Graph::start(TMP);
    let node = graph.python(&node("words.py"), &["/map", "/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.window = Window { lead_in_start: 90 * MS, start: 200 * MS, end: 400 * MS };
    request.record_topics = vec!["/answer".to_owned(), "/state".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    wait_until("four messages are heard", || heard(&node).len() >= 5);
    let mut latched = heard(&node);
    let played = latched.split_off(2);
    latched.sort();
    assert_eq!(latched, ["map", "patch"]);
    assert_eq!(played, ["warm", "one", "two"]);
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.lead_in, ledger.received, ledger.dropped), (2, 3, 2, 0));
    // The stack's own latched message came before the window and is written at its start.
    let recorded = read_back(&replayed);
    assert_eq!((recorded[0].0.as_str(), recorded[0].1), ("/state", 200 * MS));
    assert_eq!(&recorded[0].2[4..], b"ready");
}

#[test]
fn a_remapped_topic_goes_out_under_the_stacks_name_and_nothing_of_ours_is_recorded() {
    let bag = bag_of_words(
        &[words("front/talk", "/t", false), words("/other", "/t", false)],
        &[(0, 1, "a"), (1, 2, "x"), (0, 3, "b")],
    );
    let graph = Graph::start(TMP);
    let node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.remap = BTreeMap::from([("/talk".to_owned(), "/front/talk".to_owned())]);
    request.record_topics = vec![".*".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    assert_eq!(heard(&node), ["a", "b"]);
    let lines: Vec<(&str, u64, usize)> = replayed
        .ledger
        .topics
        .iter()
        .map(|topic| (topic.topic.as_str(), topic.sent, topic.subscribers.len()))
        .collect();
    // Nobody listens to /other, so nothing was sent on it.
    assert_eq!(lines, [("/talk", 2, 1), ("/other", 0, 0)]);
    let mut topics: Vec<&str> =
        replayed.recorded.topics.iter().map(|topic| topic.topic.as_str()).collect();
    topics.retain(|topic| *topic != "/rosout");
    assert_eq!(topics, ["/answer", "/state"]);
    assert_eq!(replayed.ledger.dropped, 0);
}

#[test]
fn a_queue_shorter_than_the_window_is_reported_with_its_figure() {
    let texts: Vec<String> = (0..500).map(|number| format!("{number}")).collect();
    let messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(text, at)| (0, at, text.as_str())).collect();
    let bag = bag_of_words(&[words("/words", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let slow = graph.python(&node("slow.py"), &["/words", "3", "0.002"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/words".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    let ledger = &replayed.ledger;
    wait_until("the last callback has run", || slow.last_number("seen ") >= ledger.received);
    let lost = 500 - slow.last_number("seen ");
    assert!(lost > 0, "nothing was lost: the test shows nothing");
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (500, 500 - lost, lost));
    let expected = format!(
        "/slow lost {lost} of 500 messages of /words: its queue is shorter than what arrives \
         while its callback runs; play in lockstep or realtime, or give it a longer queue"
    );
    assert_eq!(replayed.playback.warnings, [expected]);
}

#[test]
fn several_bags_are_one_timeline_after_the_delay() {
    // Each bag counts its own connections, and both say what is latched on /map.
    let front = bag_of_words(
        &[words("/a", "/t", false), words("/map", "/front", true)],
        &[(1, 500, "front map"), (0, 1_000, "a0"), (0, 1_002, "a2"), (0, 1_004, "a4")],
    );
    let rear = bag_of_words(
        &[words("/map", "/rear", true), words("/a", "/t", false)],
        &[(0, 600, "rear map"), (1, 1_001, "b1"), (1, 1_002, "b2"), (1, 1_003, "b3")],
    );
    let graph = Graph::start(TMP);
    let listener = graph.python(&node("words.py"), &["/a", "/map"]);
    let mut request = request(&front, &graph.uri);
    request.window = Window { lead_in_start: 900 * MS, start: 900 * MS, end: 2_000 * MS };
    request.topics = vec!["/a".to_owned(), "/map".to_owned()];
    request.start.delay = std::time::Duration::from_millis(700);
    let bags = [front, rear];
    let replayed = replay_together(&bags, &request, &mut |_| (), &|| None).unwrap();
    wait_until("all are heard", || heard(&listener).len() == 8);
    let mut latched = heard(&listener);
    let played = latched.split_off(2);
    latched.sort();
    assert_eq!(latched, ["front map", "rear map"]);
    assert_eq!(played, ["a0", "b1", "a2", "b2", "b3", "a4"]);
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (6, 6, 0));
    assert_eq!(ledger.lead_in, 2);
    assert!(replayed.timings.subscribe >= 0.7, "{:?}", replayed.timings);
}

#[test]
fn a_window_without_messages_is_an_empty_valid_bag_at_once() {
    let bag = bag_of_words(&[words("/talk", "/t", false)], &[(0, 1, "a")]);
    let mut request = request(&bag, "http://127.0.0.1:9/");
    request.window = Window { lead_in_start: 50 * MS, start: 50 * MS, end: 60 * MS };
    let replayed = run(&bag, &request).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.recorded.messages), (0, 0));
    assert!(read_back(&replayed).is_empty());
    request.window = Window { lead_in_start: 0, start: 0, end: 60 * MS };
    request.topics = vec!["/absent".to_owned()];
    assert_eq!(run(&bag, &request).unwrap().ledger.sent, 0);
}

/// Plays until nothing was late: a machine that stands still makes any player late, and one play
/// in time shows that ours keeps the times. What is wrong in any play is asserted in it.
fn once_in_time(mut play: impl FnMut() -> Result<(), String>) {
    let late: Vec<String> = (0..10).map_while(|_| play().err()).collect();
    assert!(late.len() < 10, "late in each of ten plays: {late:?}");
}

#[test]
fn realtime_keeps_the_bags_times_at_the_asked_rate() {
    let texts: Vec<String> = (0..50).map(|number| format!("{number}")).collect();
    let messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(text, at)| (0, 1_000 + at * 20, text.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.rate = 2.0;
    request.record_topics = vec!["/answer".to_owned()];
    once_in_time(|| {
        let witness = Witness::start();
        let replayed = run(&bag, &request).unwrap();
        let excuse = witness.excuse();
        // 49 intervals of 20 ms at twice the speed: 0.49 s.
        let playback = &replayed.playback;
        eprintln!("{playback:?}");
        assert!(playback.played_seconds >= 0.49, "{playback:?}");
        assert!(playback.achieved_rate <= 2.0, "{playback:?}");
        assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (50, 0));
        // An answer's stamp is bag time at receipt: after its input, by less than 0.4 s.
        let mut latest = 0;
        for ((_, time, _), (_, sent, _)) in read_back(&replayed).iter().zip(&messages) {
            let after = *time as i64 - (sent * MS) as i64;
            assert!(after >= 0, "{after} ns after its input");
            latest = latest.max(after);
        }
        let kept = playback.played_seconds < 0.9
            && playback.achieved_rate > 1.1
            && playback.late_max_seconds < 0.4;
        // The player itself may only be late where the machine was; a node may take its time.
        assert!(kept || excuse.is_some(), "{playback:?}");
        let kept = kept && latest < 400 * MS as i64;
        kept.then_some(()).ok_or_else(|| format!("{playback:?}, answers {latest} ns: {excuse:?}"))
    });
}

#[test]
fn the_time_between_the_last_warm_up_message_and_the_window_passes_too() {
    let bag =
        bag_of_words(&[words("/talk", "/t", false)], &[(0, 1_000, "warm"), (0, 2_100, "one")]);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.rate = 2.0;
    request.window = Window { lead_in_start: 1_000 * MS, start: 2_000 * MS, end: 3_000 * MS };
    once_in_time(|| {
        let witness = Witness::start();
        let replayed = run(&bag, &request).unwrap();
        let excuse = witness.excuse();
        // A second of lead-in and 0.1 s of window, twice as fast.
        let timings = replayed.timings;
        assert!(timings.lead_in >= 0.5 && timings.play >= 0.05, "{timings:?}");
        assert_eq!((replayed.ledger.lead_in, replayed.ledger.received), (1, 1));
        let kept = timings.lead_in < 0.9 && timings.play < 0.45;
        assert!(kept || excuse.is_some(), "{timings:?}");
        kept.then_some(()).ok_or_else(|| format!("{timings:?}: {excuse:?}"))
    });
}

#[test]
fn a_pause_at_a_topic_stops_bag_time_until_it_is_over() {
    let bag = bag_of_words(
        &[words("/a", "/t", false), words("/b", "/t", false)],
        &[(0, 1_000, "a1"), (1, 1_100, "b1"), (0, 1_200, "a2"), (1, 1_300, "b2")],
    );
    let graph = Graph::start(TMP);
    let _words = graph.python(&node("words.py"), &["/a", "/b"]);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.topics = vec!["/a".to_owned(), "/b".to_owned()];
    request.record_topics = vec!["/answer".to_owned()];
    let asked = std::sync::Arc::new(std::sync::Mutex::new(Vec::new()));
    let resumed = {
        let asked = std::sync::Arc::clone(&asked);
        move |topic: &str| {
            let mut asked = asked.lock().unwrap();
            asked.push(topic.to_owned());
            // Each pause is over when it has been asked 100 times.
            asked.len() % 100 == 0
        }
    };
    let resumed = std::sync::Arc::new(resumed);
    request.pause = Some(bagpipe_replay::Pause { topics: vec!["b".to_owned()], resumed });
    once_in_time(|| {
        asked.lock().unwrap().clear();
        let began = std::time::Instant::now();
        let replayed = run(&bag, &request).unwrap();
        assert!(began.elapsed() > std::time::Duration::from_millis(2 * 99 * 10));
        assert_eq!(asked.lock().unwrap().len(), 200);
        assert!(asked.lock().unwrap().iter().all(|topic| topic == "/b"));
        assert_eq!((replayed.ledger.sent, replayed.ledger.received), (4, 4));
        // The answers come right after their inputs in bag time, however long the pause was: a
        // second.
        let answers = read_back(&replayed);
        let times = answers.iter().map(|(_, time, _)| time / MS);
        let late: Vec<u64> = times.zip([1_000, 1_100, 1_200, 1_300]).map(|(t, d)| t - d).collect();
        late.iter().all(|ms| *ms < 800).then_some(()).ok_or_else(|| format!("{late:?} ms"))
    });
}
