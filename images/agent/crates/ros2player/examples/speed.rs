//! How fast messages go through the player to a node of the stand-in with a queue of 10, which loses
//! none: the ledger gives credit.
//!
//! Usage: `cargo run --release -p bagpipe-ros2player --example speed [ROUNDS]`.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../tests/standin/mod.rs"]
mod standin;

use std::time::Instant;

use bagpipe_ros2ledger::{Event, Ledger, Waited};
use bagpipe_ros2player::{Player, PlayerOptions, PublisherId};
use standin::{ALL, Graph, LONG, message};

/// Bytes of each message, how many of them, and how many may be in flight: about a mebibyte.
const SIZES: [(usize, u64, u64); 2] = [(1000, 50_000, 10), (1_000_000, 500, 1)];
const NODE: [&str; 2] = ["--sub", "/in:std_msgs/msg/UInt8MultiArray:10:reliable"];

/// Publishes so many messages, each when its credit allows; the seconds until all were called.
fn play(
    graph: &Graph,
    player: &Player,
    publisher: PublisherId,
    (size, count, credit): (usize, u64, u64),
) -> f64 {
    let reader = graph.met("/in", player, publisher);
    graph.ledger.watch_matches(false);
    let bytes = message(1, size);
    let wait = |event: Event, holds: &dyn Fn(u64, u64) -> bool| {
        let holds = |ledger: &Ledger| {
            let counts = ledger.counts(reader.id)?;
            Ok(holds(counts.taken, counts.ended))
        };
        let late = Instant::now() + LONG;
        let waited = graph.ledger.wait(&[event], &[reader.process], late, holds).unwrap();
        assert_eq!(waited, Waited::Held);
    };
    let begun = Instant::now();
    for sent in 0..count {
        wait(Event::Taken, &|taken, _| sent - taken < credit);
        player.publish(publisher, &[&bytes], &mut || false).unwrap();
    }
    wait(Event::Ended, &|_, ended| ended == count);
    let seconds = begun.elapsed().as_secs_f64();
    assert_eq!(graph.ledger.counts(reader.id).unwrap().taken, count);
    seconds
}

fn main() {
    let rounds: usize = std::env::args().nth(1).map_or(5, |text| text.parse().unwrap());
    for size in SIZES {
        let mut rates: Vec<f64> = (0..rounds)
            .map(|_| {
                let graph = Graph::new();
                let _node = graph.node(&NODE);
                let options = PlayerOptions { room: 16 << 20, ..graph.options() };
                let player = Player::start(&options).unwrap();
                let publisher = player.advertise("/in", "std_msgs/UInt8MultiArray", &ALL).unwrap();
                size.1 as f64 / play(&graph, &player, publisher, size)
            })
            .collect();
        rates.sort_by(f64::total_cmp);
        let (bytes, count, credit) = size;
        println!(
            "{bytes} bytes, {credit} in flight: {:.0} messages/s ({:.0} to {:.0}; {count} in each of \
             {rounds} rounds, none lost)",
            rates[rounds / 2],
            rates[0],
            rates[rounds - 1]
        );
    }
}
