//! The play waits for who is seen to start. A file of its own: it looks at all processes
//! below this one.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::sync::{Mutex, MutexGuard, PoisonError};

use bagpipe_replay::StartWhen;
use graph::Graph;
use scene::{TMP, bag_of_words, node, request, run, words};

/// Each test's processes are below this one, and would be seen to start by the other.
fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

// Promise: nothing-before-everybody
#[test]
fn a_node_that_is_seen_to_start_misses_nothing() {
    let _alone = alone();
    let texts: Vec<String> = (0..20).map(|number| format!("w{number}")).collect();
    let messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(word, at)| (0, at, word.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _quick = graph.python(&node("any.py"), &["/talk"]);
    let _slow = graph.python(&node("slow_start.py"), &["/talk", "0.3"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    request.start = StartWhen { at_rest_below: Some(std::process::id()), ..StartWhen::default() };
    let replayed = run(&bag, &request).unwrap();
    eprintln!("{:?} {:?}", replayed.ledger, replayed.timings);
    let lines = &replayed.ledger.topics[0].subscribers;
    let received: Vec<(&str, u64)> =
        lines.iter().map(|line| (line.node.as_str(), line.received)).collect();
    assert_eq!(received, [("/any", 20), ("/slow_start", 20)]);
}

#[test]
fn a_node_that_is_seen_to_start_is_shown_no_time() {
    let _alone = alone();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &[(0, 1_000, "a")]);
    let graph = Graph::start(TMP);
    let starts = graph.python(&node("begins_in_time_0.py"), &["/talk", "0.3"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    request.use_sim_time = true;
    request.start = StartWhen { at_rest_below: Some(std::process::id()), ..StartWhen::default() };
    let replayed = run(&bag, &request).unwrap();
    assert_eq!(replayed.ledger.received, 1);
    starts.wait_for("begun after");
    assert_eq!(starts.lines(), ["begun after 0 times"]);
}
