//! Whom subscriptions and publishers have matched, as their middleware sees it, while that is watched.
#![allow(clippy::unwrap_used)]

mod standin;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, Event, Kind, Ledger, Waited};
use standin::{Client, Node};

const SOON: Duration = Duration::from_secs(30);

fn of(ledger: &Ledger, kind: Kind, topic: &str) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.kind == kind && one.topic == topic);
    found.remove(0)
}

fn matched(ledger: &Ledger, topic: &str) -> Option<u32> {
    of(ledger, Kind::Subscription, topic).matched
}

/// Subscriptions that a topic's first publisher has matched.
fn known(ledger: &Ledger, topic: &str) -> Option<u32> {
    of(ledger, Kind::Publisher, topic).matched
}

/// How often the nodes woke the reader.
fn changes(ledger: &Ledger) -> u32 {
    let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
    let mut word = [0; 4];
    File::open(path).unwrap().read_exact_at(&mut word, 64).unwrap();
    u32::from_le_bytes(word)
}

#[test]
fn a_watch_has_figures_of_its_own_time() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 1", "sub /alone 1", "pub /scan 1", "spin / 1"]);
        assert_eq!(matched(&ledger, "/scan"), None);
        for _ in 1..=2 {
            ledger.watch_matches(true);
            assert_eq!(matched(&ledger, "/scan"), None);
            node.obey(&["spin / 1"]);
            assert_eq!((matched(&ledger, "/scan"), matched(&ledger, "/alone")), (Some(1), Some(0)));
            assert_eq!(known(&ledger, "/scan"), Some(1));
            ledger.watch_matches(true);
            assert_eq!(matched(&ledger, "/scan"), Some(1));
            node.obey(&["pub /scan 1", "sub /scan 1", "spin / 1"]);
            assert_eq!((matched(&ledger, "/scan"), known(&ledger, "/scan")), (Some(2), Some(2)));
            ledger.watch_matches(false);
            assert_eq!((matched(&ledger, "/scan"), known(&ledger, "/scan")), (None, None));
            node.obey(&["unpublish /scan", "destroy /scan", "pub /other 1", "spin / 1"]);
        }
    }
}

#[test]
fn a_node_that_sleeps_without_end_reports_too_and_sleeps_on() {
    let ledger = Ledger::new().unwrap();
    ledger.watch_matches(true);
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 1", "sleep /scan"]);
    for publishers in [1, 2] {
        node.send("pub /scan 1");
        let all = |ledger: &Ledger| Ok(matched(ledger, "/scan") == Some(publishers));
        let waited = ledger.wait(&[Event::Matched], &[], Instant::now() + SOON, all);
        assert_eq!(waited.unwrap(), Waited::Held);
        assert_eq!(node.answer(), "done");
    }
    // Somebody who slept for such an event was woken, and for no other.
    let woken = |ledger: &Ledger| Ok(changes(ledger) > 0);
    let waited = ledger.wait(&[], &[], Instant::now() + SOON, woken);
    assert_eq!(waited.unwrap(), Waited::Held);
    // It wakes for what it waits for, and has it, though its waits were many.
    node.send("publish /scan 1");
    let mut answers = [node.answer(), node.answer()];
    answers.sort();
    assert_eq!(answers, ["done", "woke 0 1"]);
}

#[test]
fn a_watch_ends_with_its_ledger() {
    let ledger = Ledger::new().unwrap();
    ledger.watch_matches(true);
    let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
    let memory = File::open(path).unwrap();
    let watch = || {
        let mut word = [0; 4];
        memory.read_exact_at(&mut word, 92).unwrap();
        u32::from_le_bytes(word)
    };
    assert_eq!(watch(), 1);
    drop(ledger);
    assert_eq!(watch(), 0);
}

#[test]
fn a_child_and_a_slot_that_is_used_again_begin_without_figures() {
    let ledger = Ledger::new().unwrap();
    ledger.watch_matches(true);
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 1", "pub /scan 1", "pub /of_the_child 1", "spin / 1"]);
    // A child that asked its parent's subscription would find this one.
    node.obey(&["pub /scan 1"]);
    node.ask("fork");
    // The child's middleware has its parent's publishers too.
    assert_eq!((matched(&ledger, "/scan"), matched(&ledger, "/of_the_child")), (Some(1), Some(2)));
    node.obey(&["destroy /scan"]);
    ledger.retire().unwrap();
    node.obey(&["sub /scan 1"]);
    assert_eq!(matched(&ledger, "/scan"), None);
}
