//! Somebody who writes over the player's memory costs its case, and nothing else.
#![allow(clippy::unwrap_used)]

mod standin;

use std::fs::File;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use bagpipe_ros2player::{Player, PlayerError, PlayerOptions};
use standin::{ALL, Graph, LONG, eventually, match_own, message, publish, with_each_player};

const ROOM: u64 = 1 << 16;
const RINGS: u64 = 65536;
const OUT: u64 = 128;
const IN: u64 = 256;

/// The memory of a player, as any process of its user opens it.
fn opened(player: &Player) -> File {
    let maps = std::fs::read_to_string(format!("/proc/{}/maps", player.pid())).unwrap();
    let line = maps.lines().find(|line| line.contains("bagpipe-ros2-player")).unwrap();
    let inode: u64 = line.split_whitespace().nth(4).unwrap().parse().unwrap();
    let files = std::fs::read_dir("/proc/self/fd").unwrap().map(|file| file.unwrap().path());
    let its = |file: &PathBuf| {
        let name = std::fs::read_link(file).unwrap_or_default();
        name.to_string_lossy().contains("bagpipe-ros2-player")
            && file.metadata().is_ok_and(|data| data.ino() == inode)
    };
    let path = files.into_iter().find(its).unwrap();
    File::options().read(true).write(true).open(path).unwrap()
}

fn filled(graph: &Graph, deadline: Duration) -> (Player, File) {
    let options = PlayerOptions { room: ROOM, deadline, ..graph.options() };
    let player = Player::start(&options).unwrap();
    let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
    let subscription = player.subscribe("/in", "std_msgs/String", &ALL).unwrap();
    match_own(&player, publisher, subscription);
    publish(&player, publisher, &message(1, 20)).unwrap();
    eventually(|| player.taken(subscription) == 1);
    let file = opened(&player);
    (player, file)
}

#[test]
fn a_message_of_nobodys_subscription_is_damage() {
    with_each_player(|graph| {
        let (player, file) = filled(&graph, LONG);
        file.write_all_at(&9_u16.to_le_bytes(), RINGS + ROOM + 4).unwrap();
        match player.receive(Duration::ZERO, &mut |_| panic!("whose is it?")) {
            Err(PlayerError::Damaged { offset, what }) => {
                assert_eq!(
                    (offset as u64, what.as_str()),
                    (RINGS + ROOM, "a message of subscription 9")
                );
            }
            other => panic!("{other:?}"),
        }
    });
}

#[test]
fn the_program_ends_with_a_sentence_where_what_it_is_to_publish_can_not_be() {
    let wrong = [(1 << 30, 48), (49, 64), (0, 2 * ROOM)];
    for ((length, head), graph) in
        wrong.into_iter().flat_map(|one| Graph::of_each_player().map(|graph| (one, graph)))
    {
        let (player, file) = filled(&graph, LONG);
        let mut position = [0; 8];
        file.read_exact_at(&mut position, OUT).unwrap();
        let position = u64::from_le_bytes(position);
        file.write_all_at(&u32::to_le_bytes(length), RINGS + position).unwrap();
        file.write_all_at(&u64::to_le_bytes(position + head), OUT).unwrap();
        eventually(|| player.graph().is_err());
        let error = player.graph().unwrap_err().to_string();
        let sentence = "(exit status: 2); its last lines: ros2player: the ring of messages to \
                        publish is damaged";
        assert!(error.contains(sentence), "{length}: {error}");
    }
}

#[test]
fn its_length_is_sealed() {
    with_each_player(|graph| {
        let (_player, file) = filled(&graph, LONG);
        assert!(file.set_len(0).is_err() && file.set_len(RINGS + 2 * ROOM + 1).is_err());
    });
}

/// Calls everything, whose results may be anything, and counts errors.
fn use_all(player: &Player) -> usize {
    let publisher = player.advertise("/more", "std_msgs/String", &ALL);
    let subscription = player.subscribe("/more", "std_msgs/String", &ALL);
    let soon = Instant::now() + Duration::from_millis(5);
    let mut refused = usize::from(player.flush(soon).is_err());
    refused += usize::from(player.receive(Duration::from_millis(5), &mut |_| ()).is_err());
    if let Ok(publisher) = publisher {
        let late = Instant::now() + Duration::from_millis(50);
        let sent = player.publish(publisher, &[&[0; 8]], &mut || Instant::now() > late);
        refused += usize::from(sent.is_err());
        let _any = player.published(publisher);
    }
    if let Ok(subscription) = subscription {
        let _any = player.taken(subscription);
    }
    refused + usize::from(player.graph().is_err())
}

#[test]
fn any_bytes_are_an_answer_or_an_error_and_nothing_waits_beyond_its_limit() {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut refused = 0;
    for (round, graph) in
        (0..12).flat_map(|round| Graph::of_each_player().map(|graph| (round, graph)))
    {
        let (player, file) = filled(&graph, Duration::from_secs(6));
        let (from, length) = match round % 4 {
            0 => (OUT, 256),
            1 => (IN, 128),
            2 => (RINGS, 2 * ROOM),
            _ => (0, RINGS),
        };
        let bytes: Vec<u8> = (0..length).map(|_| random() as u8).collect();
        file.write_all_at(&bytes, from).unwrap();
        let begun = Instant::now();
        refused += use_all(&player);
        refused += use_all(&player);
        assert!(begun.elapsed() < Duration::from_secs(60));
        let begun = Instant::now();
        drop(player);
        assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
    }
    assert!(refused >= 24, "{refused}");
}
