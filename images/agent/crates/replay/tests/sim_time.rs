//! The player's /clock.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
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

#[test]
fn in_realtime_the_clock_ticks_at_100_hz_of_bag_time_and_with_each_message() {
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
    run(&bag, &request).unwrap();
    wait_until("the last clock is read", || clocks(&reader).contains(&(3_000 * MS)));
    let mut seen = clocks(&reader);
    seen.dedup();
    assert!(seen.is_sorted(), "{seen:?}");
    // When each is due is known without a real clock (src/rehearsal).
    seen.retain(|time| *time <= 3_000 * MS);
    let ticks = (1_000..1_995).step_by(10).chain((1_995..3_000).step_by(10)).chain([3_000]);
    assert_eq!(seen, ticks.map(|time| time * MS).collect::<Vec<u64>>());
}
