//! Starts and ends of callbacks, of subscriptions and of what is none, in every order.
#![allow(clippy::unwrap_used)]

mod standin;

use bagpipe_ros2ledger::{Counts, Endpoint, Kind, Ledger, Process, Strength};
use standin::{Client, Node};

/// The only subscription on a topic.
fn subscription(ledger: &Ledger, topic: &str) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.topic == topic && one.kind == Kind::Subscription);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

fn publisher(ledger: &Ledger, topic: &str) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.topic == topic && one.kind == Kind::Publisher);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

fn only_process(ledger: &Ledger) -> Process {
    let processes = ledger.processes().unwrap();
    assert_eq!(processes.len(), 1, "{processes:?}");
    processes[0]
}

#[test]
fn a_callback_that_runs_is_known_however_it_was_introduced() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10 early", "pub /scan 1", "publish /scan 3", "spin / 1"]);
    let scan = subscription(&ledger, "/scan");
    assert_eq!((scan.strength, scan.counts.started, scan.counts.ended), (Strength::Called, 3, 3));
}

#[test]
fn messages_within_a_process_are_counted_beside_those_that_are_taken() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10 intra", "pub /scan 10", "hand /scan 6", "publish /scan 4"]);
    node.obey(&["spin / 1"]);
    let own = node.report("/scan");
    assert_eq!((own.intra, own.called), (6, 4));
    let scan = subscription(&ledger, "/scan");
    let expected = Counts {
        taken: 4,
        started: 4,
        ended: 4,
        intra_started: 6,
        intra_ended: 6,
        ..Counts::default()
    };
    assert_eq!((scan.counts, scan.strength), (expected, Strength::Called));
    assert!(scan.intra_process);
    assert_eq!((scan.counts.done(scan.strength), scan.counts.in_hand(scan.strength)), (10, 0));
}

#[test]
fn a_callback_that_spins_has_its_own_end_and_those_inside_have_theirs() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /outer 10", "sub /inner 10", "pub /outer 1", "pub /inner 1", "nest /"]);
    node.obey(&["publish /outer 3", "publish /inner 2", "spin / 1"]);
    for (topic, messages) in [("/outer", 3), ("/inner", 2)] {
        let counts = subscription(&ledger, topic).counts;
        assert_eq!((counts.taken, counts.started, counts.ended), (messages, messages, messages));
    }
}

#[test]
fn callbacks_of_timers_are_counted_for_their_process_alone() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    let others = || (only_process(&ledger).others_started, only_process(&ledger).others_ended);
    // Without an endpoint there is no process yet.
    node.obey(&["tick / 1", "sub /scan 10", "pub /scan 1"]);
    assert_eq!(others(), (0, 0));
    node.obey(&["tick /scan 3", "nest /", "tick / 1"]);
    assert_eq!(others(), (4, 4));
    // The timer's callback has waited and called inside of it.
    let counts = Counts { taken: 1, started: 1, ended: 1, ..Counts::default() };
    assert_eq!(subscription(&ledger, "/scan").counts, counts);
    assert_eq!(publisher(&ledger, "/scan").counts.published, 3);
    node.obey(&["stick /"]);
    assert_eq!(node.ask("tick / 1"), "stuck");
    assert_eq!(others(), (5, 4));
    node.kill();
    assert_eq!(others(), (5, 4));
    ledger.retire().unwrap();
    // Another process has its place, and begins from 0.
    let mut next = Node::start(Client::Rclcpp, &ledger);
    next.obey(&["sub /scan 10", "tick / 2"]);
    assert_eq!(others(), (2, 2));
}

#[test]
fn a_thread_of_the_middleware_is_none_that_takes_for_the_node() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 1", "publish /scan 2", "spin / 1"]);
        node.obey(&["discover / 1"]);
        assert_eq!(only_process(&ledger).spinners, 1, "{client:?}");
        node.obey(&["spin / 2"]);
        assert_eq!(only_process(&ledger).spinners, 2, "{client:?}");
    }
}

#[test]
fn timers_are_counted_that_go_by_the_machine_s_clock() {
    for client in [Client::Rclcpp, Client::Component, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        // Without an endpoint there is no process yet.
        node.obey(&["fire / 5 steady", "sub /scan 10"]);
        let calls = || only_process(&ledger).machine_timers;
        for (fired, expected) in [
            ("fire / 7 steady", 7),
            ("fire / 4 system", 11),
            ("fire / 3 simulated", 11),
            ("fire / 2 cancelled", 11),
            // ROS' time, where nobody simulates it.
            ("fire / 6 ros", 17),
        ] {
            node.obey(&[fired]);
            assert_eq!(calls(), expected, "{client:?} {fired}");
        }
        node.kill();
        ledger.retire().unwrap();
        // Another process has its place, and begins from 0.
        let mut next = Node::start(client, &ledger);
        next.obey(&["sub /scan 10"]);
        assert_eq!(calls(), 0);
    }
}

#[test]
fn what_rclcpp_takes_and_throws_away_is_in_hand_until_the_thread_waits_again() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10 intra", "pub /scan 1", "publish /scan 5", "discard /scan 2"]);
    let scan = || subscription(&ledger, "/scan");
    assert_eq!((scan().strength, scan().counts.returned), (Strength::Called, 1));
    assert_eq!(scan().counts.in_hand(Strength::Called), 1);
    node.obey(&["spin / 1"]);
    let counts = Counts { taken: 5, started: 3, ended: 3, returned: 2, ..Counts::default() };
    assert_eq!(scan().counts, counts);
    assert_eq!((counts.done(Strength::Called), counts.in_hand(Strength::Called)), (5, 0));
}

#[test]
fn a_thread_that_ends_has_done_with_what_it_took() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 1", "publish /scan 2", "brief /scan"]);
        let counts = Counts { taken: 1, returned: 1, ..Counts::default() };
        assert_eq!(subscription(&ledger, "/scan").counts, counts);
        node.obey(&["brief /scan"]);
        assert_eq!(subscription(&ledger, "/scan").counts.returned, 2);
    }
}

#[test]
fn no_count_is_lost_between_threads_of_one_callback() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "storm /scan 1000000 4"]);
    let Counts { started, ended, .. } = subscription(&ledger, "/scan").counts;
    assert_eq!((started, ended, node.report("/scan").called), (4_000_000, 4_000_000, 4_000_000));
}

#[test]
fn the_address_of_a_destroyed_callback_stands_for_nothing() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /before 10", "destroy /before", "ghost /"]);
    let retired = ledger.retire().unwrap();
    assert_eq!((retired.len(), retired[0].counts), (1, Counts::default()));
    node.obey(&["sub /after 10", "ghost /"]);
    assert_eq!(subscription(&ledger, "/after").counts, Counts::default());
    // It has the slot of the one before, whose figures nobody gets by mistake.
    assert!(ledger.counts(retired[0].id).unwrap_err().to_string().contains("was retired"));
}

#[test]
fn a_subscription_that_is_destroyed_in_its_own_callback_is_kept_until_that_has_ended() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /once 10", "pub /once 1", "publish /once 1", "inside /", "spin / 1"]);
    let once = subscription(&ledger, "/once");
    let counts = Counts { taken: 1, started: 1, ended: 1, ..Counts::default() };
    assert_eq!((once.destroyed, once.counts), (true, counts));
    assert_eq!(ledger.retire().unwrap(), [once]);
    node.obey(&["sub /once 10", "publish /once 1", "inside /", "stick /"]);
    assert_eq!(node.ask("spin / 1"), "stuck");
    assert!(subscription(&ledger, "/once").destroyed);
    assert_eq!(ledger.retire().unwrap(), []);
    node.kill();
    let last = ledger.retire().unwrap();
    assert_eq!(last.iter().map(|one| one.counts.in_hand(one.strength)).max(), Some(1));
    assert_eq!((ledger.endpoints().unwrap(), ledger.processes().unwrap()), (vec![], vec![]));
}
