//! The last resort when a case outlives its deadline: the slot's process ends, and with it
//! everything that the case started.

use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::stack::processes::{descendants, signal};

/// Barks unless it is dropped in time.
#[derive(Debug)]
pub struct Watchdog {
    _awake: Sender<()>,
}

/// What the process ends with; serve starts a new one.
const BITTEN: i32 = 70;

impl Watchdog {
    /// Ends this process `grace` after `deadline`. The ordinary ways to end a case have all
    /// failed by then, so nothing is asked of them.
    pub fn start(slot: u32, deadline: Instant, grace: Duration) -> Self {
        let (awake, asleep) = channel();
        let left = deadline.saturating_duration_since(Instant::now()) + grace;
        std::thread::spawn(move || {
            if asleep.recv_timeout(left) == Err(RecvTimeoutError::Timeout) {
                eprintln!("[slot {slot}] the case outlived its deadline by {grace:?}; ending it");
                for pid in descendants(std::process::id(), &[]) {
                    signal(pid, Signal::KILL);
                }
                std::process::exit(BITTEN);
            }
        });
        Self { _awake: awake }
    }
}
