//! What a hand-off costs on this machine, of which a step of lock-step has seven:
//! `cargo run --release -p bagpipe-ros2 --example handoff` prints medians with their middle half, of
//! a wake of a thread that sleeps, and of a datagram of 1 KB to one that sleeps in its socket.
#![allow(clippy::unwrap_used)]

use std::net::UdpSocket;
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const TIMES: usize = 20_000;

fn main() {
    show("a thread wakes another", there_and_back(by_turns()));
    show("a datagram of 1 KB wakes a thread", there_and_back(by_datagrams()));
}

/// One side's half of a round, and the thread of the other side.
type Sides = (Box<dyn FnMut(usize)>, JoinHandle<()>);

/// Half of what each round takes, sorted.
fn there_and_back((mut round, other): Sides) -> Vec<Duration> {
    let mut all: Vec<Duration> = (0..TIMES)
        .map(|number| {
            let begun = Instant::now();
            round(number);
            begun.elapsed() / 2
        })
        .collect();
    other.join().unwrap();
    all.sort();
    all
}

/// A number that each side makes one more, once the other has.
fn by_turns() -> Sides {
    let shared = Arc::new((Mutex::new(0), Condvar::new()));
    let await_turn = |shared: &(Mutex<usize>, Condvar), turn| {
        drop(shared.1.wait_while(shared.0.lock().unwrap(), |now| *now != turn).unwrap());
    };
    let step = |shared: &(Mutex<usize>, Condvar)| {
        *shared.0.lock().unwrap() += 1;
        shared.1.notify_one();
    };
    let of_other = Arc::clone(&shared);
    let other = std::thread::spawn(move || {
        for number in 0..TIMES {
            await_turn(&of_other, 2 * number + 1);
            step(&of_other);
        }
    });
    let round = move |number| {
        step(&shared);
        await_turn(&shared, 2 * number + 2);
    };
    (Box::new(round), other)
}

fn by_datagrams() -> Sides {
    let bound = || UdpSocket::bind("127.0.0.1:0").unwrap();
    let (here, there) = (bound(), bound());
    here.connect(there.local_addr().unwrap()).unwrap();
    there.connect(here.local_addr().unwrap()).unwrap();
    let mut bytes = [0; 1000];
    let other = std::thread::spawn(move || {
        for _ in 0..TIMES {
            there.recv(&mut bytes).unwrap();
            there.send(&bytes).unwrap();
        }
    });
    let round = move |_| {
        here.send(&bytes).unwrap();
        here.recv(&mut bytes).unwrap();
    };
    (Box::new(round), other)
}

fn show(what: &str, all: Vec<Duration>) {
    let at = |part: usize| all[TIMES * part / 4].as_nanos() as f64 / 1000.0;
    println!("{what}: {:.1} µs ({:.1} to {:.1})", at(2), at(1), at(3));
}
