//! What the preload costs a node for each message: published, waited for, taken and called; and what
//! a look at whether the nodes are at rest costs its reader.
//!
//! Usage: `cargo run --release --example cost [ROUNDS]`. Each round has the ways in turn.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

#[path = "../tests/standin/mod.rs"]
mod standin;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Event, Ledger, Mark, Quiet};
use standin::{Client, Node, built};

const MESSAGES: u32 = 200_000;
const LOOKS: u32 = 2_000;
const WAYS: [&str; 4] =
    ["without the preload", "preload, no ledger", "preload and ledger", "and somebody waits"];

/// Nanoseconds of one message.
fn measure(way: usize, client: Client) -> f64 {
    let ledger = Ledger::new().unwrap();
    let library = built().join("ledger.so");
    let mut variables = vec![];
    if way > 0 {
        variables.push(("LD_PRELOAD", library.into_os_string()));
    }
    if way > 1 {
        variables = ledger.environment(&built().join("ledger.so"), None).to_vec();
    }
    let mut node = Node::with(client, &variables);
    node.obey(&["sub /scan 10", "pub /scan 10"]);
    let line = format!("cost /scan {MESSAGES}");
    if way < 3 {
        return node.ask(&line).parse().unwrap();
    }
    let finished = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let deadline = Instant::now() + Duration::from_secs(60);
            let done = |_: &Ledger| Ok(finished.load(Ordering::SeqCst));
            ledger.wait(&[Event::Ended], &[], deadline, done).unwrap();
        });
        let cost = node.ask(&line).parse().unwrap();
        finished.store(true, Ordering::SeqCst);
        cost
    })
}

/// Microseconds of one look at so many nodes, each a process with two subscriptions and two
/// publishers.
fn look(processes: usize) -> f64 {
    let ledger = Ledger::new().unwrap();
    let nodes: Vec<Node> = (0..processes)
        .map(|_| {
            let mut node = Node::start(Client::Rclcpp, &ledger);
            node.obey(&["sub /scan 10", "sub /map 10", "pub /scan 10", "pub /map 10"]);
            node
        })
        .collect();
    let Quiet::Still(mark) = ledger.quiet(&Mark::default(), &[]).unwrap() else { panic!() };
    let began = Instant::now();
    for _ in 0..LOOKS {
        assert!(matches!(ledger.quiet(&mark, &[]).unwrap(), Quiet::Still(_)));
    }
    drop(nodes);
    began.elapsed().as_secs_f64() * 1e6 / f64::from(LOOKS)
}

fn main() {
    let rounds: usize = std::env::args().nth(1).map_or(9, |word| word.parse().unwrap());
    for client in [Client::Rclcpp, Client::Rclpy] {
        let mut all = WAYS.map(|_| Vec::new());
        for _ in 0..rounds {
            for (way, figures) in all.iter_mut().enumerate() {
                figures.push(measure(way, client));
            }
        }
        println!("{client:?}, ns a message: median (least to most) of {rounds} rounds");
        for (way, figures) in WAYS.iter().zip(&mut all) {
            figures.sort_by(f64::total_cmp);
            let (least, most) = (figures[0], figures[rounds - 1]);
            println!("  {way:<20} {:7.1} ({least:.1} to {most:.1})", figures[rounds / 2]);
        }
    }
    for processes in [1, 5, 25] {
        println!("a look at {processes:2} nodes that are at rest, µs: {:.1}", look(processes));
    }
}
