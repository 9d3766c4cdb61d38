//! The same over a real middleware, Debian's Cyclone DDS on loopback, whose queues overwrite without
//! a word. Needs Debian's package cyclonedds-dev.
#![allow(clippy::unwrap_used)]

mod standin;

use std::ffi::OsString;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Counts, Endpoint, Event, Kind, Ledger, Mark, Quiet, Strength, Waited};
use standin::{Client, Middleware, Node, built_over};

/// Unicast on loopback, in a domain of this process.
const SETTINGS: &str = "<CycloneDDS><Domain><General><Interfaces>\
    <NetworkInterface name=\"lo\" multicast=\"false\"/></Interfaces><AllowMulticast>false\
    </AllowMulticast></General><Discovery><Tag>bagpipe-PID</Tag>\
    <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>119</MaxAutoParticipantIndex><Peers>\
    <Peer address=\"127.0.0.1\"/></Peers></Discovery></Domain></CycloneDDS>";

fn start(client: Client, ledger: &Ledger) -> Node {
    let folder = built_over(Middleware::Cyclone);
    let settings = SETTINGS.replace("PID", &std::process::id().to_string());
    let mut variables = ledger.environment(&folder.join("ledger.so"), None).to_vec();
    variables.push(("CYCLONEDDS_URI", OsString::from(settings)));
    Node::in_folder(folder, client, &variables)
}

/// A node that does not count, as a player's.
fn start_uncounted() -> Node {
    let folder = built_over(Middleware::Cyclone);
    let settings = SETTINGS.replace("PID", &std::process::id().to_string());
    Node::in_folder(folder, Client::Rclcpp, &[("CYCLONEDDS_URI", OsString::from(settings))])
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
    assert_eq!(Counts { rested: None, ..only(&ledger, Kind::Subscription).counts }, counts);
}

#[test]
fn a_publisher_has_the_guid_by_which_the_graph_has_it() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = start(client, &ledger);
        node.obey(&["sub /named 10", "pub /named 10"]);
        assert_eq!(only(&ledger, Kind::Publisher).gid, Some(node.gid("/named")));
        assert_eq!(only(&ledger, Kind::Subscription).gid, None);
    }
}

#[test]
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

#[test]
fn a_subscription_that_sleeps_without_end_reports_when_another_process_matches_it() {
    let ledger = Ledger::new().unwrap();
    ledger.watch_matches(true);
    let mut to = start(Client::Rclcpp, &ledger);
    to.obey(&["sub /matched 10 reliable", "sleep /matched"]);
    let matches = |wanted: u32| {
        let all = |ledger: &Ledger| {
            let endpoints = ledger.endpoints()?;
            let of = endpoints.iter().find(|one| one.kind == Kind::Subscription);
            Ok(of.is_some_and(|one| one.matched == Some(wanted)))
        };
        let deadline = Instant::now() + Duration::from_secs(20);
        assert_eq!(ledger.wait(&[Event::Matched], &[], deadline, all).unwrap(), Waited::Held);
    };
    matches(0);
    let mut from = start_uncounted();
    from.obey(&["pub /matched 10"]);
    matches(1);
    ledger.watch_matches(false);
    // Either side may be the first: what is published before the writer's match never comes.
    from.obey(&["match /matched 0 pub", "publish /matched 1"]);
    assert_eq!(to.answer(), "woke 0 1");
}

/// A node that takes from two others at once, of which one is the reader's own; the counts of its
/// subscription.
fn of_two(own: bool) -> Counts {
    let ledger = Ledger::new().unwrap();
    let (mut ours, mut theirs) = (start_uncounted(), start(Client::Rclcpp, &ledger));
    let mut to = start(Client::Rclcpp, &ledger);
    to.obey(&["sub /both 1000 reliable"]);
    for from in [&mut ours, &mut theirs] {
        from.obey(&["pub /both 1000", "match /both 0 pub"]);
    }
    let gid = ours.gid("/both");
    assert_ne!(gid, theirs.gid("/both"));
    if own {
        ledger.own(&gid).unwrap();
    }
    to.send("total /both 900");
    ours.send("publish /both 600");
    theirs.obey(&["publish /both 300"]);
    assert_eq!((ours.answer(), to.answer()), ("done".into(), "done".into()));
    let found = ledger.endpoints().unwrap();
    found.iter().find(|one| one.kind == Kind::Subscription).unwrap().counts
}

#[test]
fn what_a_node_takes_of_the_reader_is_counted_apart_from_what_it_takes_of_others() {
    let counts = of_two(true);
    assert_eq!((counts.taken, counts.taken_own, counts.taken_unknown), (900, 600, 0));
    let counts = of_two(false);
    assert_eq!((counts.taken, counts.taken_own, counts.taken_unknown), (900, 0, 0));
}

#[test]
fn of_a_publisher_that_has_left_it_stays_known() {
    let ledger = Ledger::new().unwrap();
    let (mut from, mut to) = pair(Client::Rclcpp, &ledger, "/left", 10);
    ledger.own(&from.gid("/left")).unwrap();
    from.obey(&["publish /left 2"]);
    to.obey(&["total /left 2"]);
    from.obey(&["publish /left 3"]);
    // One that was asked for before is known on.
    from.kill();
    to.obey(&["total /left 5"]);
    let counts = only(&ledger, Kind::Subscription).counts;
    assert_eq!((counts.taken, counts.taken_own, counts.taken_unknown), (5, 5, 0));
}

#[test]
fn who_takes_a_place_takes_that_of_the_one_that_went_last_and_counts_from_there() {
    let ledger = Ledger::new().unwrap();
    // Within a process all match at once.
    let mut node = start(Client::Rclcpp, &ledger);
    node.obey(&["sub /place 10 reliable", "sub /place 10 reliable", "pub /place 10"]);
    ledger.own(&node.gid("/place")).unwrap();
    // The second goes, then the first, which has taken one more.
    node.obey(&["publish /place 2", "total /place 2", "destroy /place"]);
    node.obey(&["publish /place 1", "total /place 3", "destroy /place", "sub /place 10 reliable"]);
    let mut all = ledger.endpoints().unwrap();
    all.retain(|one| one.kind == Kind::Subscription);
    let latest = |at: usize| ledger.latest(all[at].id).unwrap();
    assert!(latest(0) > latest(1) && latest(1) > 0);
    assert_eq!((all[2].after, all[2].late), (latest(0), false));
}

/// A chain of processes in steps: whenever it is still, its end has what was put in.
#[test]
fn a_chain_of_processes_is_still_only_when_its_end_has_called() {
    let ledger = Ledger::new().unwrap();
    let (mut player, mut middle) = (start_uncounted(), start(Client::Rclcpp, &ledger));
    let mut end = start(Client::Rclcpp, &ledger);
    end.obey(&["sub /end 10 reliable"]);
    middle.obey(&["sub /begin 10 reliable", "pub /end 10", "relay /begin 0 /end"]);
    player.obey(&["pub /begin 10", "match /begin 0 pub"]);
    middle.obey(&["match /end 0 pub", "match /begin 0 sub"]);
    end.obey(&["match /end 0 sub"]);
    middle.send("total /begin 900");
    end.send("total /end 900");
    let last = ledger
        .endpoints()
        .unwrap()
        .into_iter()
        .find(|one| (one.kind, one.topic.as_str()) == (Kind::Subscription, "/end"));
    let last = last.unwrap().id;
    let Quiet::Still(mut mark) = ledger.quiet(&Mark::default(), &[]).unwrap() else { panic!() };
    for step in 1..=300 {
        player.obey(&["publish /begin 3"]);
        let mut next = None;
        let still = |ledger: &Ledger| {
            if let Quiet::Still(mark) = ledger.quiet(&mark, &[("/begin", 3)])? {
                next = Some(mark);
            }
            Ok(next.is_some())
        };
        let deadline = Instant::now() + Duration::from_secs(20);
        let waited = ledger.wait(&[Event::Ended], &[], deadline, still).unwrap();
        assert_eq!(waited, Waited::Held, "{step}");
        assert_eq!(ledger.counts(last).unwrap().ended, 3 * step);
        mark = next.unwrap();
    }
    assert_eq!((middle.answer(), end.answer()), ("done".into(), "done".into()));
}
