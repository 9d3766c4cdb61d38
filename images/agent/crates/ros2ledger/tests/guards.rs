//! Whoever triggers a guard condition gives work to who waits for it: counted from the trigger until
//! it is waited for again, as a timer's callback is.
#![allow(clippy::unwrap_used)]

mod standin;

use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Event, Ledger, Quiet};
use standin::{Client, Node};

fn start() -> (Ledger, Node) {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    // Who has no endpoint does not count.
    node.obey(&["pub /scan 10"]);
    (ledger, node)
}

/// Waits until so many have begun and ended.
fn await_others(ledger: &Ledger, started: u64, ended: u64) {
    let counted = |ledger: &Ledger| {
        let all = ledger.processes()?;
        Ok((all[0].others_started, all[0].others_ended) == (started, ended))
    };
    let until = Instant::now() + Duration::from_secs(20);
    ledger.wait(&[Event::Started, Event::Ended], &[], until, counted).unwrap();
    let found = ledger.processes().unwrap()[0];
    assert_eq!((found.others_started, found.others_ended), (started, ended));
}

/// Once the node's thread waits for its guard, which was woken twice before: it is met by its first
/// wait, and what is triggered between two waits is work once it is waited for.
fn await_waiting(ledger: &Ledger, node: &mut Node) {
    node.obey(&["trigger / 3", "guard / 1", "woken / 1"]);
    await_others(ledger, 0, 0);
    node.obey(&["trigger / 3"]);
    await_others(ledger, 0, 0);
    node.obey(&["guard / 1", "woken / 2"]);
    await_others(ledger, 1, 0);
    node.obey(&["guard / 1"]);
    await_others(ledger, 1, 1);
}

#[test]
fn what_wakes_a_thread_is_work_until_it_waits_again() {
    let (ledger, mut node) = start();
    let mark = ledger.mark().unwrap();
    await_waiting(&ledger, &mut node);
    node.obey(&["trigger / 1"]);
    await_others(&ledger, 2, 1);
    node.obey(&["woken / 3"]);
    await_others(&ledger, 2, 1);
    assert!(
        matches!(ledger.quiet(&mark, &[]).unwrap(), Quiet::Working(busy, _) if busy.len() == 1)
    );
    node.obey(&["guard / 1"]);
    await_others(&ledger, 2, 2);
    assert!(matches!(ledger.quiet(&mark, &[]).unwrap(), Quiet::Still(_)));
}

#[test]
fn as_many_end_as_began_however_triggers_and_waits_meet() {
    let (ledger, mut node) = start();
    await_waiting(&ledger, &mut node);
    node.obey(&["guard / 3000", "trigger / 2000"]);
    let found = || ledger.processes().unwrap()[0];
    let until = Instant::now() + Duration::from_secs(20);
    while found().others_started == 1 || found().others_started != found().others_ended {
        assert!(Instant::now() < until, "{:?}", found());
        std::thread::yield_now();
    }
    assert!(found().others_started <= 2001);
}

#[test]
fn what_is_destroyed_in_somebodys_hand_is_over() {
    let (ledger, mut node) = start();
    await_waiting(&ledger, &mut node);
    node.obey(&["trigger / 1", "woken / 3"]);
    await_others(&ledger, 2, 1);
    node.obey(&["unguard"]);
    await_others(&ledger, 2, 2);
}
