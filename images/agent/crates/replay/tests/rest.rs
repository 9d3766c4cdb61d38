//! A lead-in ends, and a recording ends, by what real nodes do.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::time::Instant;

use bagpipe_replay::{Mode, ReplayRequest, Replayed, Strength, Window};
use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use graph::{Graph, PATIENCE, Process, compile, wait_until};
use scene::{TMP, bag_of_words, node, pr2, request, run, words};

const MS: u64 = 1_000_000;

fn received(process: &Process, first: char) -> u64 {
    let lines = process.lines();
    let words = lines.iter().filter_map(|line| line.strip_prefix("word "));
    words.filter(|word| word.starts_with(first)).count() as u64
}

/// 20 words of 48 letters warm up, and 40 of 6 are the window, 5 ms apart.
fn warm_up_and_window() -> Bag<MemoryChunkedFile> {
    let lead_in = "l".repeat(48);
    let counted: Vec<String> = (0..40).map(|number| format!("w{number:05}")).collect();
    let mut messages: Vec<(usize, u64, &str)> =
        (0..20).map(|number| (0, number, lead_in.as_str())).collect();
    messages.extend(counted.iter().zip(0..).map(|(word, at)| (0, 100 + 5 * at, word.as_str())));
    bag_of_words(&[words("/talk", "/t", false)], &messages)
}

// Promise: lead-in-hides-no-loss
#[test]
fn a_first_callback_that_blocks_for_long_hides_no_loss_of_the_window() {
    let bag = warm_up_and_window();
    let graph = Graph::start(TMP);
    // What it reads at once is one message of the lead-in, or four of the window: of those
    // it loses three where they wait.
    let arguments = ["/talk", "56", "1.2", "0.05"];
    let node = graph.python(&node("begins_late.py"), &arguments);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.window = Window { lead_in_start: 0, start: 100 * MS, end: 400 * MS };
    let replayed = run(&bag, &request).unwrap();
    wait_until("the last word has come", || node.lines().iter().any(|line| line == "word w00039"));
    let ledger = &replayed.ledger;
    eprintln!("{ledger:?} {:?}", replayed.timings);
    assert_eq!((received(&node, 'l'), ledger.lead_in, ledger.sent), (20, 20, 40));
    let called = received(&node, 'w');
    assert!(called < 30, "nothing was lost: the test shows nothing");
    assert_eq!((ledger.received, ledger.dropped), (called, 40 - called));
    assert_eq!(ledger.strength, Some(Strength::Called));
    assert_eq!(ledger.topics[0].subscribers[0].queue, Some(0));
}

fn first_messages(bag: &Bag<MemoryChunkedFile>, graph: &Graph, number: usize) -> ReplayRequest {
    let mut request = request(bag, &graph.uri);
    let timeline = bag.timeline(|_| true).unwrap();
    request.window.end = timeline.iter().nth(number).unwrap().time;
    request.topics = vec!["/joint_states".to_owned()];
    request.record_topics = vec!["/relayed".to_owned()];
    request
}

fn all_is_recorded(replayed: &Replayed, messages: u64) {
    let ledger = &replayed.ledger;
    eprintln!("{ledger:?} {:?} {:?}", replayed.timings, replayed.machine);
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (messages, messages, 0));
    assert_eq!(replayed.recorded.messages, messages);
}

// Promise: recording-ends-by-nodes
#[test]
fn a_last_callback_of_rospy_that_takes_its_time_is_recorded() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let _relay = graph.python(&node("relay.py"), &["/joint_states", "/relayed", "0", "1.5"]);
    let replayed = run(&bag, &first_messages(&bag, &graph, 2)).unwrap();
    all_is_recorded(&replayed, 2);
    assert_eq!(replayed.ledger.strength, Some(Strength::Called));
}

// Promise: recording-ends-by-nodes
#[test]
fn a_last_callback_of_roscpp_that_computes_or_sleeps_is_recorded() {
    let bag = pr2();
    let relay = compile(TMP, &node("relay.cpp"));
    for microseconds in ["-1500000", "1500000"] {
        let graph = Graph::start(TMP);
        let arguments = ["/joint_states", "/relayed", "10", microseconds];
        let _relay = graph.spawn(relay.to_str().unwrap(), &arguments);
        let replayed = run(&bag, &first_messages(&bag, &graph, 2)).unwrap();
        all_is_recorded(&replayed, 2);
        let line = &replayed.ledger.topics[0].subscribers[0];
        assert_eq!((line.strength, line.queue), (Strength::Received, None));
    }
}

#[test]
fn a_chain_of_nodes_is_recorded_to_its_end() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = compile(TMP, &node("relay.cpp"));
    let _first = graph.python(&node("relay.py"), &["/joint_states", "/between", "0", "0"]);
    let arguments = ["/between", "/relayed", "10", "1000000"];
    let _second = graph.spawn(relay.to_str().unwrap(), &arguments);
    wait_until("both have subscribed", || {
        let state = graph.client().get_system_state().unwrap();
        ["/joint_states", "/between"].iter().all(|topic| state.subscribers.contains_key(*topic))
    });
    let replayed = run(&bag, &first_messages(&bag, &graph, 2)).unwrap();
    all_is_recorded(&replayed, 2);
}

// Promise: nothing-before-everybody
#[test]
fn a_chain_is_played_to_once_its_links_stand() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = node("relay.py");
    let _first = graph.python(&relay, &["/joint_states", "/between", "0", "0"]);
    let _second = graph.python(&node("late_link.py"), &["/between", "/relayed", "0.5"]);
    wait_until("both have subscribed", || {
        let state = graph.client().get_system_state().unwrap();
        ["/joint_states", "/between"].iter().all(|topic| state.subscribers.contains_key(*topic))
    });
    let replayed = run(&bag, &first_messages(&bag, &graph, 2)).unwrap();
    all_is_recorded(&replayed, 2);
}

#[test]
fn a_quick_node_is_not_waited_for_longer_than_it_takes_to_see_that_it_rests() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = compile(TMP, &node("relay.cpp"));
    let _cpp = graph.spawn(relay.to_str().unwrap(), &["/joint_states", "/relayed", "10", "0"]);
    let _py = graph.python(&node("relay.py"), &["/joint_states", "/other", "0", "0"]);
    let mut request = first_messages(&bag, &graph, 2);
    request.start.nodes = vec!["/relay".to_owned(), "/relay_py".to_owned()];
    request.drain_deadline = PATIENCE;
    let mut took = Vec::new();
    for _ in 0..10 {
        let begun = Instant::now();
        let replayed = run(&bag, &request).unwrap();
        took.push(begun.elapsed().as_secs_f64());
        assert_eq!(replayed.recorded.messages, 2);
        // Its rest ended the recording, and not the deadline.
        let (drain, deadline) = (replayed.timings.drain, request.drain_deadline.as_secs_f64());
        assert!(drain < deadline, "{drain} s");
    }
    took.sort_by(f64::total_cmp);
    eprintln!("a case takes {:.3} s ({:.3} to {:.3})", took[5], took[0], took[9]);
}
