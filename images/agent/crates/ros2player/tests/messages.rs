//! What is published arrives as it was, in its order, and nothing is lost that one waits for.
#![allow(clippy::unwrap_used)]

mod standin;

use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Event, Waited};
use bagpipe_ros2player::{Durability, Player, PlayerError, PlayerOptions, Qos, Received};
use standin::{
    ALL, CDR, LONG, RELIABLE, eventually, match_own, message, number, publish, threads_are,
    with_each_player,
};

/// Receives until there are so many messages, as the pair of their subscription and their bytes.
fn receive(player: &Player, count: usize) -> Vec<(bagpipe_ros2player::SubscriptionId, Vec<u8>)> {
    let mut all = Vec::new();
    let late = Instant::now() + LONG;
    while all.len() < count {
        assert!(Instant::now() < late, "{} of {count}", all.len());
        let mut keep = |one: Received<'_>| all.push((one.subscription, one.data.to_vec()));
        player.receive(Duration::from_millis(500), &mut keep).unwrap();
    }
    all
}

#[test]
fn bytes_of_any_length_arrive_as_they_were_around_the_rings_end() {
    with_each_player(|graph| {
        let options = PlayerOptions { room: 10 << 20, ..graph.options() };
        let player = Player::start(&options).unwrap();
        let publisher = player.advertise("/bytes", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        let subscription =
            player.subscribe("/bytes", "std_msgs/msg/UInt8MultiArray", &ALL).unwrap();
        match_own(&player, publisher, subscription);
        let lengths = [1, 2, 3, 4, 5, 100, 1000, 65_535, 65_536, 1 << 20, (4 << 20) - 3, 4 << 20];
        let mut sent = 0;
        for round in 0..6 {
            for length in lengths {
                let bytes = message(round, length);
                let (head, rest) = bytes.split_at(1 + length / 3);
                player.publish(publisher, &[head, &[], rest], &mut || false).unwrap();
                sent += 1;
                let all = receive(&player, 1);
                assert_eq!(all.len(), 1);
                assert_eq!(all[0].0, subscription);
                // DDS sends whole groups of 4 bytes.
                let (data, padding) = all[0].1.split_at(bytes.len());
                assert!(data == bytes && padding.len() < 4, "{length} in round {round}");
            }
        }
        eventually(|| player.taken(subscription) == sent);
        assert!(player.flush(Instant::now() + LONG).unwrap());
        assert_eq!(player.published(publisher), sent);
    });
}

#[test]
fn the_order_over_many_topics_is_that_of_publishing() {
    with_each_player(|graph| {
        let player = graph.player();
        let mut topics = Vec::new();
        for one in 0..100 {
            let topic = format!("/many/topic_{one}");
            let publisher = player.advertise(&topic, "sensor_msgs/msg/Imu", &ALL).unwrap();
            let subscription = player.subscribe(&topic, "sensor_msgs/msg/Imu", &ALL).unwrap();
            topics.push((publisher, subscription));
        }
        for (publisher, subscription) in &topics {
            match_own(&player, *publisher, *subscription);
        }
        for one in 0..10_000 {
            let (publisher, _) = topics[one * 37 % topics.len()];
            publish(&player, publisher, &message(one as u64, one % 300)).unwrap();
        }
        let all = receive(&player, 10_000);
        assert!(player.flush(Instant::now() + LONG).unwrap());
        for (publisher, subscription) in &topics {
            let numbers: Vec<u64> =
                all.iter().filter(|one| one.0 == *subscription).map(|one| number(&one.1)).collect();
            assert!(numbers.is_sorted());
            assert_eq!((numbers.len(), player.published(*publisher)), (100, 100));
            eventually(|| player.taken(*subscription) == 100);
        }
    });
}

#[test]
fn one_who_waits_for_the_ledger_loses_nothing_at_depth_ten() {
    with_each_player(|graph| {
        let node = graph.node(&["--name", "/sink", "--sub", "/in:std_msgs/msg/String:10:reliable"]);
        let player = graph.player();
        let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
        let reader = graph.met("/in", &player, publisher);
        assert_eq!(reader.process.pid, node.pid());
        for sent in 0..20_000 {
            let room = |ledger: &bagpipe_ros2ledger::Ledger| {
                Ok(sent - ledger.counts(reader.id)?.taken < 10)
            };
            let waited =
                graph.ledger.wait(&[Event::Taken], &[reader.process], Instant::now() + LONG, room);
            assert_eq!(waited.unwrap(), Waited::Held, "{sent}");
            publish(&player, publisher, &message(sent, 1000)).unwrap();
        }
        let all =
            |ledger: &bagpipe_ros2ledger::Ledger| Ok(ledger.counts(reader.id)?.ended == 20_000);
        let deadline = Instant::now() + LONG;
        let waited = graph.ledger.wait(&[Event::Ended], &[reader.process], deadline, all).unwrap();
        assert_eq!(waited, Waited::Held, "{:?}", graph.ledger.counts(reader.id));
        assert!(node.end());
    });
}

#[test]
fn transient_local_reaches_who_comes_late_and_volatile_does_not() {
    with_each_player(|graph| {
        let (from, to) = (graph.player(), graph.player());
        let late = Qos { durability: Durability::TransientLocal, ..RELIABLE };
        let kept = from.advertise("/tf_static", "tf2_msgs/TFMessage", &late).unwrap();
        let lost = from.advertise("/tf", "tf2_msgs/TFMessage", &RELIABLE).unwrap();
        for one in 0..15 {
            publish(&from, kept, &message(one, 10)).unwrap();
            publish(&from, lost, &message(one, 10)).unwrap();
        }
        assert!(from.flush(Instant::now() + LONG).unwrap());
        let volatile = to.subscribe("/tf", "tf2_msgs/TFMessage", &ALL).unwrap();
        let transient = Qos { durability: Durability::TransientLocal, ..ALL };
        let subscription = to.subscribe("/tf_static", "tf2_msgs/TFMessage", &transient).unwrap();
        let all = receive(&to, 10);
        assert!(all.iter().all(|one| one.0 == subscription));
        let numbers: Vec<u64> = all.iter().map(|one| number(&one.1)).collect();
        assert_eq!(numbers, (5..15).collect::<Vec<u64>>());
        eventually(|| to.publishers(volatile).unwrap() == 1);
        eventually(|| from.subscribers(lost).unwrap() == 1);
        assert_eq!(to.taken(volatile), 0);
        publish(&from, lost, &message(99, 10)).unwrap();
        assert_eq!(number(&receive(&to, 1)[0].1), 99);
    });
}

#[test]
fn a_fast_publisher_loses_nothing_to_a_subscription_that_keeps_all() {
    with_each_player(|graph| {
        let options = PlayerOptions { room: 1 << 16, ..graph.options() };
        let (from, to) = (graph.player(), Player::start(&options).unwrap());
        let publisher = from.advertise("/fast", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        let subscription = to.subscribe("/fast", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        eventually(|| to.publishers(subscription).unwrap() == 1);
        eventually(|| from.subscribers(publisher).unwrap() == 1);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for one in 0..100_000 {
                    publish(&from, publisher, &message(one, 20)).unwrap();
                }
            });
            let mut next = 0;
            let late = Instant::now() + 2 * LONG;
            while next < 100_000 {
                assert!(Instant::now() < late, "{next}");
                let mut compare = |one: Received<'_>| {
                    assert_eq!(one.data, message(next, 20));
                    assert!(one.source_timestamp > 1_600_000_000_000_000_000);
                    next += 1;
                };
                to.receive(Duration::from_millis(100), &mut compare).unwrap();
            }
        });
        eventually(|| to.taken(subscription) == 100_000);
        assert!(from.flush(Instant::now() + LONG).unwrap());
        assert_eq!(from.published(publisher), 100_000);
        assert_eq!(to.receive(Duration::ZERO, &mut |_| panic!("one too many")).unwrap(), 0);
    });
}

/// What half of these waits took at the most: a busy machine makes some of them late. Each has an end
/// of its own, 20 ms or more: were nobody woken before, all of them would take that long.
fn assert_woken(mut times: Vec<Duration>) {
    times.sort();
    let half = times[times.len() / 2];
    assert!(half < Duration::from_millis(15), "{half:?} of {}", times.len());
}

#[test]
fn who_waits_is_woken() {
    with_each_player(|graph| {
        let small = PlayerOptions { room: 1 << 16, ..graph.options() };
        let player = Player::start(&small).unwrap();
        let publisher = player.advertise("/step", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        let subscription = player.subscribe("/step", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        match_own(&player, publisher, subscription);
        // For a message that comes: the program's publishing thread, and who receives.
        let step = |one| {
            let begun = Instant::now();
            publish(&player, publisher, &message(one, 20)).unwrap();
            assert_eq!(number(&receive(&player, 1)[0].1), one);
            begun.elapsed()
        };
        assert_woken((0..500).map(step).collect());
        // For room: two of these fill the ring, and each takes a while, since it goes to another process.
        let _sink = graph.node(&["--sub", "/far:std_msgs/msg/UInt8MultiArray:1:best_effort"]);
        let far = player.advertise("/far", "std_msgs/UInt8MultiArray", &RELIABLE).unwrap();
        graph.met("/far", &player, far);
        let step = |one| {
            let (begun, mut waits) = (Instant::now(), false);
            let mut asked = || {
                waits = true;
                false
            };
            player.publish(far, &[&message(one, 32_000)], &mut asked).unwrap();
            waits.then(|| begun.elapsed())
        };
        // How many of them find room at once, the machine decides.
        let (late, mut waits) = (Instant::now() + LONG, Vec::new());
        for one in 0.. {
            assert!(Instant::now() < late, "{} waits for {one} messages", waits.len());
            waits.extend(step(one));
            if waits.len() >= 15 {
                break;
            }
        }
        assert_woken(waits);
        assert!(player.flush(Instant::now() + LONG).unwrap());
    });
}

#[test]
fn a_subscription_that_is_added_is_taken_from_at_once() {
    with_each_player(|graph| {
        let (from, to) = (graph.player(), graph.player());
        let late = Qos { durability: Durability::TransientLocal, ..RELIABLE };
        let publisher = from.advertise("/late", "std_msgs/String", &late).unwrap();
        publish(&from, publisher, &message(7, 7)).unwrap();
        let took = |_| {
            eventually(|| threads_are(to.pid(), 'S'));
            let begun = Instant::now();
            to.subscribe("/late", "std_msgs/String", &late).unwrap();
            assert_eq!(number(&receive(&to, 1)[0].1), 7);
            begun.elapsed()
        };
        // Its thread looks by itself twice a second.
        let fastest = (0..10).map(took).min().unwrap();
        assert!(fastest < Duration::from_millis(350), "{fastest:?}");
    });
}

#[test]
fn while_nobody_receives_nothing_is_dropped_and_a_message_too_large_is_an_error() {
    with_each_player(|graph| {
        let small = PlayerOptions { room: 1 << 16, ..graph.options() };
        let (from, to) = (graph.player(), Player::start(&small).unwrap());
        let publisher = from.advertise("/small", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        let subscription = to.subscribe("/small", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        eventually(|| to.publishers(subscription).unwrap() == 1);
        eventually(|| from.subscribers(publisher).unwrap() == 1);
        for one in 0..200 {
            let length = if one == 100 { 40_000 } else { 1000 };
            publish(&from, publisher, &message(one, length)).unwrap();
        }
        assert!(from.flush(Instant::now() + LONG).unwrap());
        let (mut numbers, mut refused) = (Vec::new(), Vec::new());
        eventually(|| {
            let mut keep = |one: Received<'_>| numbers.push(number(one.data));
            if let Err(error) = to.receive(Duration::from_millis(10), &mut keep) {
                refused.push(error.to_string());
            }
            numbers.len() == 199
        });
        let expected: Vec<u64> = (0..200).filter(|one| *one != 100).collect();
        assert_eq!(numbers, expected);
        assert_eq!(refused.len(), 1);
        assert!(refused[0].contains("40012 bytes on /small") && refused[0].contains("32736"));
        let most = [0; 32_736];
        let own = to.advertise("/own", "std_msgs/String", &RELIABLE).unwrap();
        publish(&to, own, &most).unwrap();
        let error = to.publish(own, &[&most, &[0]], &mut || false).unwrap_err();
        assert!(
            matches!(error, PlayerError::TooLarge { length: 32_737, most: 32_736, .. }),
            "{error}"
        );
    });
}

#[test]
fn what_the_middleware_refuses_is_counted_and_reported_once_with_its_reason() {
    with_each_player(|graph| {
        let player = graph.player();
        let publisher = player.advertise("/short", "std_msgs/String", &RELIABLE).unwrap();
        let other = player.advertise("/other", "std_msgs/String", &RELIABLE).unwrap();
        publish(&player, other, &CDR).unwrap();
        let mut refused = 0;
        for bytes in [&CDR[..3], &CDR[..2]] {
            publish(&player, publisher, bytes).unwrap();
            let error = player.flush(Instant::now() + LONG).unwrap_err();
            let sentence = error.to_string();
            let PlayerError::Refused { topic, count, .. } = error else { panic!("{sentence}") };
            refused += count;
            assert_eq!(topic, "/short");
            let reason = format!("the last since: {} bytes are no serialised message", bytes.len());
            assert!(sentence.contains(&reason), "{sentence}");
        }
        assert_eq!(refused, 2);
        assert!(player.flush(Instant::now() + LONG).unwrap());
        publish(&player, publisher, &CDR).unwrap();
        assert!(player.flush(Instant::now() + LONG).unwrap());
        assert_eq!((player.published(publisher), player.published(other)), (1, 1));
    });
}

#[test]
fn who_listens_gets_what_others_publish_and_nothing_of_its_own() {
    with_each_player(|graph| {
        let (player, other) = (graph.player(), graph.player());
        let own = player.advertise("/both", "std_msgs/String", &ALL).unwrap();
        let theirs = other.advertise("/both", "std_msgs/String", &ALL).unwrap();
        let listening = player.listen("/both", "std_msgs/String", &ALL).unwrap();
        let all = player.subscribe("/both", "std_msgs/String", &ALL).unwrap();
        eventually(|| player.publishers(all).unwrap() == 2);
        eventually(|| player.publishers(listening).unwrap() == 1);
        eventually(|| player.subscribers(own).unwrap() == 1);
        eventually(|| other.subscribers(theirs).unwrap() == 2);
        publish(&player, own, &message(1, 10)).unwrap();
        publish(&other, theirs, &message(2, 10)).unwrap();
        let mut found: Vec<(bool, u64)> =
            receive(&player, 3).iter().map(|one| (one.0 == listening, number(&one.1))).collect();
        found.sort_unstable();
        assert_eq!(found, [(false, 1), (false, 2), (true, 2)]);
    });
}
