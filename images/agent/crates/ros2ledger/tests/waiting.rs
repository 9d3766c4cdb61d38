//! Waiting: woken by what it waits for, asleep between, and never beyond the deadline.
#![allow(clippy::unwrap_used)]

mod standin;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, Event, Kind, Ledger, Waited};
use standin::{Client, Node};

const SOON: Duration = Duration::from_secs(30);

fn subscription(ledger: &Ledger) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.kind == Kind::Subscription);
    found.remove(0)
}

#[test]
fn a_step_ends_as_soon_as_its_callback_has() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 1", "pub /scan 1"]);
        let scan = subscription(&ledger);
        let mut times = Vec::new();
        for step in 1..=200 {
            let began = Instant::now();
            node.send("publish /scan 1");
            node.send("spin / 1");
            let waited = ledger.wait(&[Event::Ended], &[scan.process], began + SOON, |ledger| {
                let counts = ledger.counts(scan.id)?;
                Ok(counts.ended + counts.returned >= step)
            });
            assert_eq!(waited.unwrap(), Waited::Held);
            times.push(began.elapsed());
            assert_eq!((node.answer(), node.answer()), ("done".into(), "done".into()));
        }
        times.sort();
        // Without a wake each lasts until the next look, 20 ms later; on a busy machine some do.
        assert!(times[50] < Duration::from_millis(15), "{:?}", times[50]);
        let counts = subscription(&ledger).counts;
        assert_eq!((counts.taken, counts.ended + counts.returned), (200, 200));
    }
}

#[test]
fn who_waits_sleeps_until_a_look_or_an_event_of_its_kind() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 5000", "pub /scan 1", "publish /scan 5000"]);
    node.send("spin / 1");
    let limit = Duration::from_millis(200);
    let mut asked = 0;
    let began = Instant::now();
    let waited = ledger.wait(&[Event::Published], &[], began + limit, |_| {
        asked += 1;
        Ok(false)
    });
    assert_eq!(waited.unwrap(), Waited::Late);
    assert!(began.elapsed() >= limit);
    assert!((2..=12).contains(&asked), "{asked}");
    assert_eq!(node.answer(), "done");
    assert_eq!(subscription(&ledger).counts.taken, 5000);
}

#[test]
fn what_holds_already_is_not_waited_for_even_when_it_is_late() {
    let ledger = Ledger::new().unwrap();
    let past = Instant::now();
    assert_eq!(ledger.wait(&[], &[], past, |_| Ok(true)).unwrap(), Waited::Held);
    assert_eq!(ledger.wait(&[], &[], past, |_| Ok(false)).unwrap(), Waited::Late);
}

/// How often the nodes woke the reader.
fn changes(ledger: &Ledger) -> u32 {
    let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
    let mut word = [0; 4];
    File::open(path).unwrap().read_exact_at(&mut word, 64).unwrap();
    u32::from_le_bytes(word)
}

#[test]
fn a_timer_s_callback_wakes_once_who_waits_for_its_start_or_end_and_nobody_else() {
    for (event, wakes) in
        [(Event::Started, 1), (Event::Ended, 1), (Event::Taken, 0), (Event::Published, 0)]
    {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(Client::Rclcpp, &ledger);
        node.obey(&["sub /scan 1", "tick / 1"]);
        let waited = ledger.wait(&[event], &[], Instant::now(), |_| Ok(false)).unwrap();
        assert_eq!((waited, changes(&ledger)), (Waited::Late, 0));
        node.obey(&["tick / 3"]);
        assert_eq!(changes(&ledger), wakes, "{event:?}");
    }
}

#[test]
fn where_it_holds_already_no_node_wakes_anybody() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 1", "publish /scan 1"]);
    let events = [Event::Taken, Event::Ended, Event::Published];
    let waited = ledger.wait(&events, &[], Instant::now() + SOON, |_| Ok(true)).unwrap();
    node.obey(&["spin / 1", "publish /scan 1"]);
    assert_eq!((waited, changes(&ledger)), (Waited::Held, 0));
}

#[test]
fn takes_wake_nobody_before_there_are_as_many_as_somebody_waits_for() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 1"]);
    let scan = subscription(&ledger);
    ledger.wake_from(scan.id, 5).unwrap();
    let late = ledger.wait(&[Event::Taken], &[], Instant::now(), |_| Ok(false));
    assert_eq!(late.unwrap(), Waited::Late);
    for (takes, wakes) in [(4, 0), (1, 1), (4, 1)] {
        node.obey(&[&format!("publish /scan {takes}"), "spin / 1"]);
        assert_eq!(changes(&ledger), wakes);
    }
    // Another use of the slot has no such limit.
    node.obey(&["destroy /scan"]);
    ledger.retire().unwrap();
    node.obey(&["sub /scan 10", "publish /scan 1"]);
    let late = ledger.wait(&[Event::Taken], &[], Instant::now(), |_| Ok(false));
    assert_eq!(late.unwrap(), Waited::Late);
    node.obey(&["spin / 1"]);
    assert_eq!(changes(&ledger), 2);
    assert!(ledger.wake_from(scan.id, 5).unwrap_err().to_string().contains("was retired"));
}

/// A node may end between taking a wish and waking who has it.
#[test]
fn a_wish_that_was_taken_without_a_wake_is_there_again_at_the_next_look() {
    let ledger = Ledger::new().unwrap();
    let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
    let file = File::options().read(true).write(true).open(path).unwrap();
    let (place, mut seen) = (68 + 4 * Event::Ended as u64, Vec::new());
    let waited = ledger.wait(&[Event::Ended], &[], Instant::now() + SOON, |_| {
        let mut word = [0; 4];
        file.read_exact_at(&mut word, place).unwrap();
        seen.push(u32::from_le_bytes(word));
        file.write_all_at(&[0; 4], place).unwrap();
        Ok(seen.len() == 4)
    });
    assert_eq!((waited.unwrap(), seen), (Waited::Held, vec![0, 1, 1, 1]));
}

#[test]
fn an_endpoint_that_appears_wakes() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    for expected in 1..=3 {
        node.send("sub /scan 1");
        let listed = |ledger: &Ledger| Ok(ledger.endpoints()?.len() == expected);
        let waited = ledger.wait(&[Event::Listed], &[], Instant::now() + SOON, listed);
        assert_eq!(waited.unwrap(), Waited::Held);
        assert_eq!(node.answer(), "done");
    }
}

#[test]
fn a_process_that_is_killed_is_noticed_also_while_nobody_collects_it() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 1", "publish /scan 1", "stick /"]);
    let scan = subscription(&ledger);
    assert_eq!(node.ask("spin / 1"), "stuck");
    node.kill_only();
    let began = Instant::now();
    let ends = |ledger: &Ledger| Ok(ledger.counts(scan.id)?.ended == 1);
    let waited = ledger.wait(&[Event::Ended], &[scan.process], began + SOON, ends);
    assert_eq!(waited.unwrap(), Waited::Ended(scan.process));
    assert!(began.elapsed() < SOON / 2);
    // What it had done when it ended is held against it no more.
    let taken = |ledger: &Ledger| Ok(ledger.counts(scan.id)?.taken == 1);
    let waited = ledger.wait(&[Event::Taken], &[scan.process], began + SOON, taken);
    assert_eq!(waited.unwrap(), Waited::Held);
}

#[test]
fn an_error_of_the_condition_ends_the_wait() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "destroy /scan"]);
    let retired = ledger.retire().unwrap().remove(0);
    let ends = |ledger: &Ledger| Ok(ledger.counts(retired.id)?.ended == 1);
    let waited = ledger.wait(&[Event::Ended], &[], Instant::now() + SOON, ends);
    assert!(waited.unwrap_err().to_string().contains("was retired"));
}
