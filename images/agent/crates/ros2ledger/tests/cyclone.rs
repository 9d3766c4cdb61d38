//! The same over a real middleware, Debian's Cyclone DDS on loopback, whose queues overwrite without
//! a word. Needs the package cyclonedds-dev: `cargo test -p bagpipe-ros2ledger -- --ignored`.
#![allow(clippy::unwrap_used)]

mod standin;

use std::ffi::OsString;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Counts, Endpoint, Event, Kind, Ledger, Strength, Waited};
use standin::{Client, Middleware, Node, built_over};

/// Unicast on loopback, in a domain of this process.
const SETTINGS: &str = "<CycloneDDS><Domain><General><Interfaces>\
    <NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces><AllowMulticast>false\
    </AllowMulticast></General><Discovery><Tag>bagpipe-PID</Tag>\
    <ParticipantIndex>auto</ParticipantIndex><Peers>\
    <Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

fn start(client: Client, ledger: &Ledger) -> Node {
    let folder = built_over(Middleware::Cyclone);
    let settings = SETTINGS.replace("PID", &std::process::id().to_string());
    let mut variables = ledger.environment(&folder.join("ledger.so"), None).to_vec();
    variables.push(("CYCLONEDDS_URI", OsString::from(settings)));
    Node::in_folder(folder, client, &variables)
}

fn only(ledger: &Ledger, kind: Kind) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.kind == kind);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

/// A node that publishes and one that takes, which know each other.
fn pair(client: Client, ledger: &Ledger, topic: &str, depth: u32) -> (Node, Node) {
    let mut from = start(Client::Rclcpp, ledger);
    let mut to = start(client, ledger);
    to.obey(&[&format!("sub {topic} {depth} reliable")]);
    from.obey(&[&format!("pub {topic} {depth}"), &format!("match {topic} 0 pub")]);
    to.obey(&[&format!("match {topic} 0 sub")]);
    (from, to)
}

#[test]
#[ignore = "needs Debian's cyclonedds-dev"]
fn what_cyclone_overwrote_is_what_was_published_and_not_taken() {
    for (client, strength) in [(Client::Rclcpp, Strength::Called), (Client::Rclpy, Strength::Taken)]
    {
        let ledger = Ledger::new().unwrap();
        let mut node = start(client, &ledger);
        node.obey(&["sub /own 10", "pub /own 10", "publish /own 1000", "spin / 1"]);
        let own = only(&ledger, Kind::Subscription);
        assert_eq!((own.counts.taken, own.strength), (10, strength));
        assert_eq!((own.counts.done(strength), node.report("/own").called), (10, 10));
        assert_eq!(only(&ledger, Kind::Publisher).counts.published, 1000);
    }
}

#[test]
#[ignore = "needs Debian's cyclonedds-dev"]
fn between_processes_under_overload_every_take_is_a_call_and_the_node_agrees() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let topic = format!("/overload_{client:?}");
        let (mut from, mut to) = pair(client, &ledger, &topic, 10);
        to.send(&format!("last {topic}"));
        from.obey(&[&format!("publish {topic} 50000")]);
        assert_eq!(to.answer(), "done");
        // Only who waits again has done with what it took last, where no callback is reported.
        to.obey(&["spin / 1"]);
        let own = to.report(&topic);
        let Endpoint { counts, strength, .. } = only(&ledger, Kind::Subscription);
        assert_eq!((counts.taken, counts.done(strength)), (own.taken, own.called));
        assert_eq!((own.taken, counts.in_hand(strength)), (own.called, 0));
        let published = only(&ledger, Kind::Publisher).counts.published;
        assert_eq!(published, 50_000);
        assert!(own.taken < published, "{client:?} lost nothing, so that this shows nothing");
    }
}

#[test]
#[ignore = "needs Debian's cyclonedds-dev"]
fn who_waits_for_the_ledger_before_each_queue_full_loses_nothing() {
    let ledger = Ledger::new().unwrap();
    let (mut from, mut to) = pair(Client::Rclcpp, &ledger, "/credit", 10);
    let scan = only(&ledger, Kind::Subscription);
    to.send("total /credit 2000");
    for step in 1..=200 {
        from.obey(&["publish /credit 10"]);
        let deadline = Instant::now() + Duration::from_secs(20);
        let ended = |ledger: &Ledger| Ok(ledger.counts(scan.id)?.ended == 10 * step);
        let waited = ledger.wait(&[Event::Ended], &[scan.process], deadline, ended).unwrap();
        assert_eq!(waited, Waited::Held, "{step}");
    }
    assert_eq!(to.answer(), "done");
    let counts = Counts { taken: 2000, started: 2000, ended: 2000, ..Counts::default() };
    assert_eq!(Counts { empty: 0, ..only(&ledger, Kind::Subscription).counts }, counts);
}

#[test]
#[ignore = "needs Debian's cyclonedds-dev"]
fn killed_in_a_callback_there_is_one_start_more() {
    let ledger = Ledger::new().unwrap();
    let (mut from, mut to) = pair(Client::Rclcpp, &ledger, "/killed", 10);
    from.obey(&["publish /killed 3"]);
    to.obey(&["total /killed 3", "stick /"]);
    from.obey(&["publish /killed 1"]);
    assert_eq!(to.ask("total /killed 4"), "stuck");
    to.kill();
    let counts = only(&ledger, Kind::Subscription).counts;
    assert_eq!((counts.taken, counts.started, counts.ended), (4, 4, 3));
}
