//! The player's /clock.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros/tests/graph/mod.rs"]
mod graph;
mod scene;

use bagpipe_replay::Mode;
use graph::{Graph, Process, wait_until};
use scene::{TMP, bag_of_words, node, request, run, words};

const MS: u64 = 1_000_000;

fn clocks(process: &Process) -> Vec<u64> {
    let lines = process.lines();
    lines.iter().filter_map(|line| line.strip_prefix("clock ")?.parse().ok()).collect()
}

#[test]
fn in_max_the_clock_steps_with_each_message() {
    let bag = bag_of_words(
        &[words("/words", "/t", false)],
        &[(0, 1_000, "a"), (0, 1_700, "b"), (0, 3_000, "c")],
    );
    let graph = Graph::start(TMP);
    let reader = graph.python(&node("clock.py"), &[]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/words".to_owned()];
    request.use_sim_time = true;
    let replayed = run(&bag, &request).unwrap();
    wait_until("the last clock is read", || clocks(&reader).contains(&(3_000 * MS)));
    let mut seen = clocks(&reader);
    seen.dedup();
    eprintln!("{seen:?}");
    assert_eq!(seen, [1_000 * MS, 1_700 * MS, 3_000 * MS]);
    // The clock is no part of the ledger.
    assert_eq!(replayed.ledger.topics.len(), 1);
    assert_eq!((replayed.ledger.sent, replayed.ledger.received), (3, 3));
}

/// The times that /clock showed, without repetitions, in a realtime play of 2 s.
fn ticks(clock_rate: f64) -> Vec<u64> {
    let bag = bag_of_words(
        &[words("/words", "/t", false)],
        &[(0, 1_000, "a"), (0, 1_995, "b"), (0, 3_000, "c")],
    );
    let graph = Graph::start(TMP);
    let reader = graph.python(&node("clock.py"), &[]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/words".to_owned()];
    request.use_sim_time = true;
    request.mode = Mode::Realtime;
    request.rate = 4.0;
    request.clock_rate = clock_rate;
    run(&bag, &request).unwrap();
    wait_until("the last clock is read", || clocks(&reader).contains(&(3_000 * MS)));
    let mut seen = clocks(&reader);
    seen.dedup();
    seen
}

#[test]
fn in_realtime_the_clock_has_its_own_rate_or_steps_with_each_message() {
    assert_eq!(ticks(0.0), [1_000 * MS, 1_995 * MS, 3_000 * MS]);
    let mut window = ticks(2.5);
    window.retain(|time| *time <= 3_000 * MS);
    // Every 400 ms after the last one, and with each message.
    let expected = [1_000, 1_400, 1_800, 1_995, 2_395, 2_795, 3_000];
    assert_eq!(window, expected.map(|time| time * MS));
}

#[test]
fn in_realtime_the_clock_ticks_at_100_hz_of_bag_time_and_never_goes_back() {
    let seen = ticks(bagpipe_replay::CLOCK_RATE);
    assert!(seen.is_sorted(), "{seen:?}");
    let window: Vec<u64> = seen.into_iter().filter(|time| *time <= 3_000 * MS).collect();
    let gap = window.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap();
    eprintln!("{} ticks in 2 s of bag time, the largest gap {} ms", window.len(), gap / MS);
    assert!(window.len() >= 200 && gap <= 10 * MS);
    assert!([1_000, 1_995, 3_000].iter().all(|time| window.contains(&(time * MS))));
}
