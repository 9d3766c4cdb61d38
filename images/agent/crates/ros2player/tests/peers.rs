//! The player over Cyclone DDS, and an endpoint over Fast DDS that shares no line with it: each reads
//! what the other writes, by the names, the types and the quality of service that ROS 2 has.
#![allow(clippy::unwrap_used)]

mod peer;
mod standin;

use std::time::{Duration, Instant};

use bagpipe_ros2player::{
    Durability, Player, PlayerOptions, PublisherId, Qos, Received, Reliability,
};
use peer::Peer;
use standin::{ALL, Graph, LONG, RELIABLE, eventually, message, number, publish};

const BYTES: &str = "std_msgs/msg/UInt8MultiArray";
const LATCHED: Qos = Qos { durability: Durability::TransientLocal, ..RELIABLE };
const WEAK: Qos = Qos { reliability: Reliability::BestEffort, ..RELIABLE };

/// So many messages of such a length, each of which its number decides.
const SHORT: (u64, usize) = (3000, 1 << 10);
const LONG_ONES: (u64, usize) = (50, 1 << 20);

/// That both know of each other, which each learns by itself.
fn met(player: &Player, publisher: PublisherId, reader: &mut Peer) {
    reader.until_matched(1);
    eventually(|| player.subscribers(publisher).unwrap() == 1);
}

fn send_all(player: &Player, publisher: PublisherId, messages: u64, length: usize) {
    for one in 0..messages {
        publish(player, publisher, &message(one, length)).unwrap();
    }
    assert!(player.flush(Instant::now() + LONG).unwrap());
}

/// That these are the messages of their numbers: DDS sends whole groups of 4 bytes.
fn assert_whole<'a>(received: impl Iterator<Item = &'a Vec<u8>>, length: usize) {
    for bytes in received {
        let expected = message(number(bytes), length);
        let (data, padding) = bytes.split_at(expected.len());
        assert!(data == expected && padding.len() < 4, "{}", number(bytes));
    }
}

fn numbers(messages: &[Vec<u8>]) -> Vec<u64> {
    messages.iter().map(|bytes| number(bytes)).collect()
}

/// What the player has taken until there are so many.
fn receive(player: &Player, count: usize) -> Vec<Vec<u8>> {
    let mut all = Vec::new();
    let late = Instant::now() + LONG;
    while all.len() < count {
        assert!(Instant::now() < late, "{} of {count}", all.len());
        let mut keep = |one: Received<'_>| all.push(one.data.to_vec());
        player.receive(Duration::from_millis(500), &mut keep).unwrap();
    }
    all
}

#[test]
fn all_that_is_played_comes_to_a_fast_dds_reader_byte_for_byte() {
    for (messages, length) in [SHORT, LONG_ONES] {
        let graph = Graph::untagged();
        let player = graph.player();
        let publisher = player.advertise("/in", BYTES, &ALL).unwrap();
        let mut reader = Peer::reader(&graph, &format!("/in {BYTES} all reliable volatile"));
        met(&player, publisher, &mut reader);
        send_all(&player, publisher, messages, length);
        reader.until_messages(messages as usize);
        reader.leave();
        assert_eq!(numbers(&reader.messages), (0..messages).collect::<Vec<_>>());
        assert_whole(reader.messages.iter(), length);
        assert_eq!(player.published(publisher), messages);
    }
}

/// Publishes until something arrives, and returns how many. Cyclone DDS throws away what a writer of
/// Fast DDS has sent by its first heartbeat, which may be later than both know of each other. A
/// greeting is so long that it is sent in pieces, with a heartbeat behind each: the one that arrives
/// had a heartbeat before it.
fn greet(player: &Player, writer: &mut Peer) -> i32 {
    let (late, mut published, mut arrived) = (Instant::now() + LONG, 0, 0);
    while arrived == 0 {
        assert!(Instant::now() < late, "{published} greetings");
        writer.publish(&message(GREETING, 1 << 17));
        published += 1;
        arrived = player.receive(Duration::from_millis(500), &mut |_| ()).unwrap();
    }
    // Each of the others is behind the one that arrived, and before the last.
    writer.publish(&message(LAST_GREETING, 0));
    while !receive(player, 1).iter().any(|one| number(one) == LAST_GREETING) {}
    published + 1
}

/// Numbers that no other message has.
const GREETING: u64 = u64::MAX;
const LAST_GREETING: u64 = u64::MAX - 1;

#[test]
fn all_that_fast_dds_publishes_is_recorded_byte_for_byte() {
    for (messages, length) in [SHORT, LONG_ONES] {
        let graph = Graph::untagged();
        let player = graph.player();
        let subscription = player.subscribe("/out", BYTES, &ALL).unwrap();
        let mut writer = Peer::writer(&graph, &format!("/out {BYTES} all reliable volatile"));
        writer.until_matched(1);
        eventually(|| player.publishers(subscription).unwrap() == 1);
        let greetings = greet(&player, &mut writer);
        let taken = std::thread::scope(|scope| {
            let taken = scope.spawn(|| receive(&player, messages as usize));
            (0..messages).for_each(|one| writer.publish(&message(one, length)));
            taken.join().unwrap()
        });
        writer.acknowledged(greetings + i32::try_from(messages).unwrap());
        assert_eq!(numbers(&taken), (0..messages).collect::<Vec<_>>());
        assert_whole(taken.iter(), length);
        assert_eq!(player.receive(Duration::ZERO, &mut |_| panic!("one too many")).unwrap(), 0);
    }
}

#[test]
fn a_queue_of_ten_keeps_the_last_ten_of_what_its_reader_did_not_take() {
    let graph = Graph::untagged();
    let player = graph.player();
    let publisher = player.advertise("/in", BYTES, &ALL).unwrap();
    let mut reader = Peer::start(&graph, &format!("read /in {BYTES} 10 reliable volatile"));
    met(&player, publisher, &mut reader);
    send_all(&player, publisher, 200, 100);
    reader.until_newest(199);
    reader.take();
    reader.until_messages(10);
    reader.leave();
    assert_eq!(numbers(&reader.messages), (190..200).collect::<Vec<_>>());
}

#[test]
fn who_records_at_depth_ten_and_is_not_read_from_ends_with_the_last_ten() {
    let graph = Graph::untagged();
    let player = Player::start(&PlayerOptions { room: 1 << 16, ..graph.options() }).unwrap();
    let subscription = player.subscribe("/out", BYTES, &RELIABLE).unwrap();
    let mut writer = Peer::writer(&graph, &format!("/out {BYTES} all reliable volatile"));
    writer.until_matched(1);
    eventually(|| player.publishers(subscription).unwrap() == 1);
    (0..500).for_each(|one| writer.publish(&message(one, 1000)));
    // Its queue overwrites, so that it acknowledges all.
    writer.acknowledged(500);
    let mut all = Vec::new();
    eventually(|| {
        let mut keep = |one: Received<'_>| all.push(number(one.data));
        player.receive(Duration::from_millis(10), &mut keep).unwrap();
        all.last() == Some(&499)
    });
    // What its ring had room for, and its queue.
    assert!(all.is_sorted_by(|one, next| one < next) && all.len() < 66 + 10, "{all:?}");
    assert_eq!(all[all.len() - 10..], (490..500).collect::<Vec<_>>());
}

#[test]
fn what_is_latched_comes_to_late_readers_as_deep_as_it_is_kept() {
    let graph = Graph::untagged();
    let player = graph.player();
    let kept = player.advertise("/tf_static", "tf2_msgs/msg/TFMessage", &LATCHED).unwrap();
    let lost = player.advertise("/tf", "tf2_msgs/msg/TFMessage", &RELIABLE).unwrap();
    send_all(&player, kept, 15, 10);
    send_all(&player, lost, 15, 10);
    let mut late =
        Peer::reader(&graph, "/tf_static tf2_msgs/msg/TFMessage 100 reliable transient_local");
    late.until_messages(10);
    let mut volatile = Peer::reader(&graph, "/tf tf2_msgs/msg/TFMessage 100 reliable volatile");
    met(&player, lost, &mut volatile);
    publish(&player, lost, &message(99, 10)).unwrap();
    volatile.until_messages(1);
    late.leave();
    volatile.leave();
    assert_eq!(numbers(&late.messages), (5..15).collect::<Vec<_>>());
    assert_eq!(numbers(&volatile.messages), [99]);

    let mut writer = Peer::writer(&graph, &format!("/map {BYTES} 3 reliable transient_local"));
    (0..7).for_each(|one| writer.publish(&message(one, 10)));
    writer.acknowledged(7);
    let all = Qos { durability: Durability::TransientLocal, ..ALL };
    player.subscribe("/map", BYTES, &all).unwrap();
    assert_eq!(numbers(&receive(&player, 3)), [4, 5, 6]);
}

#[test]
fn who_asks_for_more_than_is_offered_or_for_another_type_is_sent_nothing() {
    let graph = Graph::untagged();
    let player = graph.player();
    let weak = player.advertise("/weak", BYTES, &WEAK).unwrap();
    let text = player.advertise("/weak", "std_msgs/msg/String", &WEAK).unwrap();
    let reader = |what: &str| Peer::reader(&graph, &format!("/weak {what}"));
    let mut takes = reader(&format!("{BYTES} 100 best_effort volatile"));
    let mut other = reader("std_msgs/msg/String 100 best_effort volatile");
    let mut strict = ["reliable volatile", "best_effort transient_local"]
        .map(|asked| reader(&format!("{BYTES} 100 {asked}")));
    met(&player, weak, &mut takes);
    met(&player, text, &mut other);
    strict.iter_mut().for_each(Peer::until_refused);
    for one in 0..100 {
        publish(&player, weak, &message(one, 100)).unwrap();
        // What is best effort may be lost, but not where each waits for the one before it.
        takes.until_messages(one as usize + 1);
    }
    publish(&player, text, &message(100, 100)).unwrap();
    other.until_messages(1);
    takes.leave();
    other.leave();
    assert_eq!(numbers(&takes.messages), (0..100).collect::<Vec<_>>());
    assert_whole(takes.messages.iter(), 100);
    assert_eq!(numbers(&other.messages), [100]);
    for peer in &mut strict {
        peer.leave();
        assert_eq!((peer.matched, peer.messages.len()), (None, 0));
    }
}

#[test]
fn each_is_seen_to_come_and_to_go_by_the_other() {
    let graph = Graph::untagged();
    let player = graph.player();
    let publisher = player.advertise("/in", BYTES, &RELIABLE).unwrap();
    let mut reader = Peer::reader(&graph, &format!("/in {BYTES} 10 reliable volatile"));
    met(&player, publisher, &mut reader);
    let seen = player.graph().unwrap();
    let found = seen.iter().find(|node| node.name == "/fastdds").unwrap();
    assert_eq!(found.subscribes, [("/in".to_owned(), BYTES.to_owned())]);
    reader.leave();
    eventually(|| player.subscribers(publisher).unwrap() == 0);
    let mut again = Peer::reader(&graph, &format!("/in {BYTES} 10 reliable volatile"));
    met(&player, publisher, &mut again);
}

#[test]
fn a_reader_of_another_domain_receives_nothing() {
    let (graph, other) = (Graph::untagged(), Graph::untagged());
    let what = format!("/in {BYTES} 100 reliable volatile");
    let (player, stranger) = (graph.player(), other.player());
    let publisher = player.advertise("/in", BYTES, &ALL).unwrap();
    let own = stranger.advertise("/in", BYTES, &ALL).unwrap();
    let mut here = Peer::reader(&graph, &what);
    let mut there = Peer::reader(&other, &what);
    met(&player, publisher, &mut here);
    met(&stranger, own, &mut there);
    send_all(&player, publisher, 100, 100);
    here.until_messages(100);
    // What it was sent before this one would be before it.
    publish(&stranger, own, &message(777, 100)).unwrap();
    there.until_messages(1);
    here.leave();
    there.leave();
    assert_eq!(numbers(&there.messages), [777]);
    assert_eq!(numbers(&here.messages), (0..100).collect::<Vec<_>>());
}
