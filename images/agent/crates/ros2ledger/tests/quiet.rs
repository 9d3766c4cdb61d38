//! Whether nodes are at rest: of chains in the stand-in that go on one step at a time.
#![allow(clippy::unwrap_used)]

mod standin;

use bagpipe_ros2ledger::{Doubt, Ledger, Mark, Quiet, Why};
use standin::{Client, Node};

/// The topics that somebody works on, each with what it has in hand and what it has not taken.
fn work(ledger: &Ledger, since: &Mark, sent: &[(&str, u64)]) -> Vec<(String, u64, u64)> {
    match ledger.quiet(since, sent).unwrap() {
        Quiet::Still(_) => vec![],
        Quiet::Working(busy, doubts) => {
            assert_eq!(doubts, []);
            let of = busy.into_iter();
            of.map(|one| (one.topic.unwrap_or_default(), one.in_hand, one.untaken)).collect()
        }
        Quiet::Unknown(doubts) => panic!("{doubts:?}"),
    }
}

fn one(topic: &str, in_hand: u64, untaken: u64) -> Vec<(String, u64, u64)> {
    vec![(topic.into(), in_hand, untaken)]
}

fn doubts(ledger: &Ledger, since: &Mark) -> Vec<(String, u64, Why)> {
    match ledger.quiet(since, &[]).unwrap() {
        Quiet::Unknown(doubts) => {
            doubts.into_iter().map(|one| (one.topic, one.missing, one.why)).collect()
        }
        other => panic!("{other:?}"),
    }
}

fn still(ledger: &Ledger, since: &Mark) -> Mark {
    match ledger.quiet(since, &[]).unwrap() {
        Quiet::Still(mark) => mark,
        other => panic!("{other:?}"),
    }
}

/// /a -> /b -> /c, all in one process.
fn chain(ledger: &Ledger) -> Node {
    let mut node = Node::start(Client::Rclcpp, ledger);
    for topic in ["/a", "/b", "/c"] {
        node.obey(&[&format!("sub {topic} 10 reliable"), &format!("pub {topic} 10")]);
    }
    node.obey(&["relay /a 0 /b", "relay /b 0 /c"]);
    node
}

#[test]
fn the_work_goes_down_a_chain_and_ends_with_its_last_callback() {
    let ledger = Ledger::new().unwrap();
    let mut node = chain(&ledger);
    let mut mark = still(&ledger, &Mark::default());
    for step in 1..=20 {
        node.obey(&["publish /a 1"]);
        assert_eq!(work(&ledger, &mark, &[]), one("/a", 0, 1));
        node.obey(&[&format!("total /a {step}")]);
        assert_eq!(work(&ledger, &mark, &[]), one("/b", 0, 1));
        node.obey(&[&format!("total /b {step}")]);
        assert_eq!(work(&ledger, &mark, &[]), one("/c", 0, 1));
        node.obey(&[&format!("total /c {step}")]);
        mark = still(&ledger, &mark);
    }
    // What a player would have sent beside is work too.
    assert_eq!(work(&ledger, &mark, &[("/c", 2)]), one("/c", 0, 2));
}

#[test]
fn a_callback_that_runs_is_work_until_it_or_its_process_ends() {
    let ledger = Ledger::new().unwrap();
    let mut node = chain(&ledger);
    let mark = still(&ledger, &Mark::default());
    node.obey(&["publish /c 1", "stick /"]);
    assert_eq!(node.ask("total /c 1"), "stuck");
    assert_eq!(work(&ledger, &mark, &[]), one("/c", 1, 0));
    node.kill();
    still(&ledger, &mark);
    let mut node = chain(&ledger);
    let mark = ledger.mark().unwrap();
    node.obey(&["tick /c 1"]);
    assert_eq!(work(&ledger, &mark, &[]), one("/c", 0, 1));
    node.obey(&["spin / 1", "stick /"]);
    still(&ledger, &mark);
    assert_eq!(node.ask("tick / 1"), "stuck");
    assert_eq!(work(&ledger, &mark, &[]), one("", 1, 0));
}

#[test]
fn what_a_queue_overwrote_is_a_doubt_until_the_next_mark() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /a 2 reliable", "pub /a 10"]);
    let mark = still(&ledger, &Mark::default());
    node.obey(&["publish /a 5"]);
    let why = Why::Overwritten { depth: 2 };
    assert_eq!(doubts(&ledger, &mark), [("/a".into(), 5, why)]);
    node.obey(&["spin / 1"]);
    assert_eq!(doubts(&ledger, &mark), [("/a".into(), 3, why)]);
    let mark = ledger.mark().unwrap();
    node.obey(&["publish /a 2"]);
    assert_eq!(work(&ledger, &mark, &[]), one("/a", 0, 2));
    node.obey(&["spin / 1"]);
    still(&ledger, &mark);
}

#[test]
fn what_a_mark_can_not_know_is_a_doubt() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /a 10 reliable", "pub /a 10", "publish /a 1"]);
    // Taken for granted, though one waits: more is taken than was published since.
    let granted = ledger.mark().unwrap();
    node.obey(&["spin / 1"]);
    assert_eq!(doubts(&ledger, &granted), [("/a".into(), 0, Why::Uncounted)]);
    let mark = ledger.mark().unwrap();
    node.obey(&["sub /b 10 reliable", "pub /b 10", "publish /b 1"]);
    assert_eq!(doubts(&ledger, &mark), [("/b".into(), 1, Why::Late)]);
    node.obey(&["spin / 1"]);
    let mark = still(&ledger, &mark);
    node.obey(&["publish /b 1", "unpublish /b"]);
    assert_eq!(doubts(&ledger, &mark), [("/b".into(), 1, Why::PublisherGone)]);
    node.obey(&["spin / 1"]);
    still(&ledger, &mark);
    ledger.retire().unwrap();
    assert_eq!(doubts(&ledger, &mark), [("/b".into(), 0, Why::Retired)]);
    still(&ledger, &ledger.mark().unwrap());
    let long = format!("sub /{} 1", "x".repeat(300));
    node.obey(&[&long]);
    assert_eq!(doubts(&ledger, &ledger.mark().unwrap()), [(String::new(), 0, Why::Unlisted)]);
}

#[test]
fn an_endpoint_in_the_slot_of_one_of_the_mark_has_its_own_names() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["be /robot 0 first", "sub /a 10 reliable", "pub /a 10"]);
    let mark = still(&ledger, &Mark::default());
    node.obey(&["destroy /a"]);
    let slot = ledger.retire().unwrap()[0].id;
    node.obey(&["be /robot 0 second", "sub /b 10 reliable", "pub /b 10", "publish /b 1"]);
    assert!(ledger.counts(slot).is_err() && ledger.endpoints().unwrap().len() == 3);
    let Quiet::Unknown(doubts) = ledger.quiet(&mark, &[]).unwrap() else { panic!() };
    let (node, topic) = ("/robot/second".into(), "/b".into());
    assert_eq!(doubts, [Doubt { node, topic, missing: 1, why: Why::Late }]);
}
