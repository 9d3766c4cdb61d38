//! A wait that is cut into slices is to the node what one wait is: by a clock that only waits move.
#![allow(clippy::unwrap_used)]

mod standin;

use bagpipe_ros2ledger::Ledger;
use standin::{Client, Middleware, Node, built_over};

const MILLISECOND: i64 = 1_000_000;
const SLICE: i64 = 20 * MILLISECOND;
/// As the node reports it.
const ENDLESS: i64 = -1;

/// A node that waits by a script, and whether it is watched.
fn start(watched: bool) -> (Ledger, Node) {
    let folder = built_over(Middleware::Script);
    let ledger = Ledger::new().unwrap();
    ledger.watch_matches(watched);
    let variables = ledger.environment(&folder.join("ledger.so"), None);
    let node = Node::in_folder(folder, Client::Rclcpp, &variables);
    (ledger, node)
}

/// One wait: its sets' sizes, and what becomes of it.
#[derive(Clone, Copy, Default)]
struct Wait {
    /// -1: no such set.
    sets: [i32; 5],
    timeout: i64,
    /// In which call which result comes, with which thing ready.
    act_at: u64,
    result: i32,
    ready: Option<(i32, u64)>,
    pause_at: u64,
    late: i64,
}

impl Wait {
    fn line(&self) -> String {
        let sets = self.sets.map(|set| set.to_string()).join(" ");
        let Wait { timeout, act_at, result, pause_at, late, .. } = self;
        let (set, index) = self.ready.unwrap_or((-1, 0));
        format!("{sets} {timeout} {act_at} {result} {set} {index} {pause_at} {late}")
    }
}

#[derive(Debug, PartialEq, Eq)]
struct Seen {
    result: i64,
    calls: i64,
    spoilt: i64,
    longest: i64,
    last: i64,
    passed: i64,
    samples: i64,
    ready: Vec<String>,
}

fn seen_in(answer: &str) -> Seen {
    let words: Vec<&str> = answer.split(' ').collect();
    let at = |name: &str| words.iter().position(|word| *word == name).unwrap();
    let figure = |name: &str| words[at(name) + 1].parse().unwrap();
    Seen {
        result: figure("result"),
        calls: figure("calls"),
        spoilt: figure("spoilt"),
        longest: figure("longest"),
        last: figure("last"),
        passed: figure("passed"),
        samples: figure("samples"),
        ready: words[at("ready") + 1..].iter().map(|word| (*word).to_owned()).collect(),
    }
}

const TIMEOUT: i32 = 2;
const SOME: Wait = Wait {
    sets: [3, 2, 0, 1, 1],
    timeout: 5 * SLICE,
    act_at: 0,
    result: TIMEOUT,
    ready: None,
    pause_at: 0,
    late: 0,
};

#[test]
fn what_is_ready_in_the_third_slice_is_all_that_is_left_and_the_rest_was_restored_before() {
    let (_ledger, mut node) = start(true);
    for ready in [(0, 2), (1, 0), (3, 0), (4, 0)] {
        let wait = Wait { act_at: 3, result: 0, ready: Some(ready), ..SOME };
        let seen = seen_in(&node.ask(&wait.line()));
        let expected = Seen {
            result: 0,
            calls: 3,
            spoilt: 0,
            longest: SLICE,
            last: SLICE,
            passed: 2 * SLICE,
            samples: 3,
            ready: vec![format!("{}:{}", ready.0, ready.1)],
        };
        assert_eq!(seen, expected);
    }
}

#[test]
fn sets_of_any_size_and_none_at_all_are_kept_whole() {
    let (_ledger, mut node) = start(true);
    for sets in
        [[-1; 5], [0; 5], [1000; 5], [64, 0, -1, 0, 0], [65, 0, -1, 0, 0], [-1, -1, 3, -1, 65_533]]
    {
        let seen = seen_in(&node.ask(&Wait { sets, ..SOME }.line()));
        assert_eq!((seen.result, seen.calls, seen.spoilt), (2, 5, 0), "{sets:?}");
        assert_eq!((seen.passed, seen.ready), (5 * SLICE, vec![]), "{sets:?}");
    }
    // More than is kept: one call.
    let seen = seen_in(&node.ask(&Wait { sets: [65_536, 1, -1, -1, -1], ..SOME }.line()));
    assert_eq!((seen.result, seen.calls, seen.longest, seen.samples), (2, 1, 5 * SLICE, 1));
}

#[test]
fn a_wait_lasts_as_long_as_it_should_and_no_slice_longer_than_20_ms() {
    let (_ledger, mut node) = start(true);
    for (timeout, late, calls, last, passed) in [
        (0, 0, 1, 0, 0),
        (1, 0, 1, 1, 1),
        (SLICE, 0, 1, SLICE, SLICE),
        (SLICE + 1, 0, 2, 1, SLICE + 1),
        (1_050 * MILLISECOND, 0, 53, 10 * MILLISECOND, 1_050 * MILLISECOND),
        // After slices that ended late there is less to wait for, or only to look.
        (100 * MILLISECOND, 30 * MILLISECOND, 3, 0, 130 * MILLISECOND),
        (91 * MILLISECOND, 25 * MILLISECOND, 3, MILLISECOND, 116 * MILLISECOND),
    ] {
        let seen = seen_in(&node.ask(&Wait { timeout, late, ..SOME }.line()));
        assert_eq!((seen.result, seen.calls, seen.last), (2, calls, last), "{timeout} {late}");
        assert_eq!((seen.passed, seen.spoilt), (passed, 0), "{timeout} {late}");
        assert!(seen.longest <= SLICE);
    }
}

#[test]
fn an_error_ends_the_wait_in_any_slice() {
    let (_ledger, mut node) = start(true);
    for (act_at, result) in [(1, 1), (3, 1), (3, 10), (5, 11)] {
        let seen = seen_in(&node.ask(&Wait { act_at, result, ..SOME }.line()));
        assert_eq!((seen.result, seen.calls), (i64::from(result), act_at as i64));
    }
}

#[test]
fn what_became_ready_as_its_slice_timed_out_is_not_lost() {
    let (_ledger, mut node) = start(true);
    let wait = Wait { act_at: 2, result: TIMEOUT, ready: Some((1, 1)), ..SOME };
    let seen = seen_in(&node.ask(&wait.line()));
    assert_eq!((seen.result, seen.calls, seen.ready), (0, 2, vec!["1:1".to_owned()]));
    // In the last slice it is what one call would give.
    let seen = seen_in(&node.ask(&Wait { act_at: 5, ..wait }.line()));
    assert_eq!((seen.result, seen.calls, seen.ready), (2, 5, vec!["1:1".to_owned()]));
}

#[test]
fn a_wait_without_end_is_one_again_when_the_watch_ends() {
    let (ledger, mut node) = start(true);
    let wait = Wait { timeout: ENDLESS, act_at: 500, result: 0, ready: Some((0, 0)), ..SOME };
    let seen = seen_in(&node.ask(&wait.line()));
    assert_eq!((seen.calls, seen.samples, seen.passed), (500, 500, 499 * SLICE));
    assert_eq!(node.ask(&Wait { pause_at: 2, ..wait }.line()), "paused");
    ledger.watch_matches(false);
    let seen = seen_in(&node.ask("go"));
    assert_eq!((seen.result, seen.calls, seen.last), (0, 3, ENDLESS));
    assert_eq!((seen.spoilt, seen.ready), (0, vec!["0:0".to_owned()]));
    // A limited one gets what is left of its time.
    ledger.watch_matches(true);
    assert_eq!(node.ask(&Wait { pause_at: 2, ..SOME }.line()), "paused");
    ledger.watch_matches(false);
    let seen = seen_in(&node.ask("go"));
    assert_eq!((seen.result, seen.calls, seen.last, seen.passed), (2, 3, 3 * SLICE, 5 * SLICE));
}

#[test]
fn who_is_not_watched_waits_in_one_call() {
    let (_ledger, mut node) = start(false);
    let seen = seen_in(&node.ask(&SOME.line()));
    assert_eq!((seen.result, seen.calls, seen.last, seen.samples), (2, 1, 5 * SLICE, 0));
    let wait = Wait { timeout: ENDLESS, result: 0, ready: Some((0, 1)), ..SOME };
    let seen = seen_in(&node.ask(&wait.line()));
    assert_eq!((seen.calls, seen.last, seen.samples), (1, ENDLESS, 0));
}
