//! A wait that is cut into slices is to the node what one wait is: by a clock that only waits move.
#![allow(clippy::unwrap_used)]

mod standin;

use bagpipe_ros2ledger::Ledger;
use standin::{Client, Middleware, Node, built_over};

const MILLISECOND: i64 = 1_000_000;
const SLICE: i64 = 20 * MILLISECOND;
/// The first call of a wait only looks.
const LOOK: i64 = 1;
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
    /// From which question for matches on they are refused.
    refuse: u64,
}

impl Wait {
    fn line(&self) -> String {
        let sets = self.sets.map(|set| set.to_string()).join(" ");
        let Wait { timeout, act_at, result, pause_at, late, refuse, .. } = self;
        let (set, index) = self.ready.unwrap_or((-1, 0));
        format!("{sets} {timeout} {act_at} {result} {set} {index} {pause_at} {late} {refuse}")
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
    refuse: 0,
};

#[test]
fn what_is_ready_in_the_third_slice_is_all_that_is_left_and_the_rest_was_restored_before() {
    let (_ledger, mut node) = start(true);
    for ready in [(0, 2), (1, 0), (3, 0), (4, 0)] {
        let wait = Wait { act_at: 4, result: 0, ready: Some(ready), ..SOME };
        let seen = seen_in(&node.ask(&wait.line()));
        let expected = Seen {
            result: 0,
            calls: LOOK + 3,
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
        assert_eq!((seen.result, seen.calls, seen.spoilt), (2, LOOK + 5, 0), "{sets:?}");
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
        (1, 0, LOOK + 1, 1, 1),
        (SLICE, 0, LOOK + 1, SLICE, SLICE),
        (SLICE + 1, 0, LOOK + 2, 1, SLICE + 1),
        (1_050 * MILLISECOND, 0, LOOK + 53, 10 * MILLISECOND, 1_050 * MILLISECOND),
        // After slices that ended late there is less to wait for, or only to look.
        (100 * MILLISECOND, 30 * MILLISECOND, LOOK + 2, SLICE, 130 * MILLISECOND),
        (91 * MILLISECOND, 25 * MILLISECOND, LOOK + 3, 0, 140 * MILLISECOND),
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
    for (act_at, result) in [(1, 1), (3, 1), (3, 10), (6, 11)] {
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
    let seen = seen_in(&node.ask(&Wait { act_at: 6, ..wait }.line()));
    assert_eq!((seen.result, seen.calls, seen.ready), (2, 6, vec!["1:1".to_owned()]));
}

#[test]
fn a_subscription_whose_middleware_refuses_is_asked_no_more_and_waits_on() {
    let (ledger, mut node) = start(true);
    let matched = || ledger.endpoints().unwrap()[0].matched;
    let seen = seen_in(&node.ask(&Wait { refuse: 3, ..SOME }.line()));
    assert_eq!((seen.result, seen.calls, seen.samples), (2, LOOK + 5, 3));
    assert_eq!(matched(), None);
    let seen = seen_in(&node.ask(&SOME.line()));
    assert_eq!((seen.result, seen.calls, seen.samples, matched()), (2, LOOK + 5, 0, None));
}

#[test]
fn a_wait_without_end_is_one_again_when_the_watch_ends() {
    let (ledger, mut node) = start(true);
    let wait = Wait { timeout: ENDLESS, act_at: 500, result: 0, ready: Some((0, 0)), ..SOME };
    let seen = seen_in(&node.ask(&wait.line()));
    assert_eq!((seen.calls, seen.samples, seen.passed), (500, 499, 498 * SLICE));
    assert_eq!(node.ask(&Wait { pause_at: 3, ..wait }.line()), "paused");
    ledger.watch_matches(false);
    let seen = seen_in(&node.ask("go"));
    assert_eq!((seen.result, seen.calls, seen.last), (0, LOOK + 3, ENDLESS));
    assert_eq!((seen.spoilt, seen.ready), (0, vec!["0:0".to_owned()]));
    // A limited one gets what is left of its time.
    ledger.watch_matches(true);
    assert_eq!(node.ask(&Wait { pause_at: 3, ..SOME }.line()), "paused");
    ledger.watch_matches(false);
    let seen = seen_in(&node.ask("go"));
    assert_eq!(
        (seen.result, seen.calls, seen.last, seen.passed),
        (2, LOOK + 3, 3 * SLICE, 5 * SLICE)
    );
}

#[test]
fn of_a_node_that_slept_before_the_watch_nothing_is_known_until_it_waits_again() {
    let (ledger, mut node) = start(false);
    let matched = || ledger.endpoints().unwrap()[0].matched;
    let wait = Wait { timeout: ENDLESS, result: 0, ready: Some((0, 1)), pause_at: 1, ..SOME };
    assert_eq!(node.ask(&wait.line()), "paused");
    ledger.watch_matches(true);
    assert_eq!(matched(), None);
    let seen = seen_in(&node.ask("go"));
    assert_eq!((seen.result, seen.calls, seen.last, seen.samples), (0, 1, ENDLESS, 0));
    assert_eq!(matched(), None);
    let seen = seen_in(&node.ask(&SOME.line()));
    assert_eq!((seen.samples, matched()), (5, Some(5)));
}

#[test]
fn only_who_had_nothing_to_take_at_a_wait_is_seen_at_rest() {
    let (ledger, mut node) = start(true);
    let rested = || ledger.endpoints().unwrap()[0].counts.rested;
    let at_once = Wait { act_at: 1, result: 0, ..SOME };
    // It is the first subscription; and nothing is known after an error.
    node.ask(&Wait { ready: Some((0, 0)), ..at_once }.line());
    node.ask(&Wait { result: 1, ..at_once }.line());
    node.ask(&Wait { sets: [0, 1, 0, 0, 0], ..at_once }.line());
    assert_eq!(rested(), None);
    // Another one was ready.
    node.ask(&Wait { ready: Some((0, 1)), ..at_once }.line());
    assert_eq!(rested(), Some(0));
}

#[test]
fn of_who_is_not_watched_no_wait_is_looked_at() {
    let (ledger, mut node) = start(false);
    node.ask(&SOME.line());
    assert_eq!(ledger.endpoints().unwrap()[0].counts.rested, None);
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
