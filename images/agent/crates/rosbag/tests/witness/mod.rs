//! Whether this machine stood still while something was timed: only then may that be late.
#![allow(dead_code)] // each test file uses its own part

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

const STEP: Duration = Duration::from_millis(10);
/// On an idle machine a thread wakes late by a millisecond at most; less explains no lateness.
const STALL: Duration = Duration::from_millis(50);
/// The share of the time in which some task waited for a processor, a disk or memory.
const WANT: f64 = 0.1;

/// Looks at the machine until it is asked.
pub struct Witness {
    over: Arc<AtomicBool>,
    sleeper: JoinHandle<Duration>,
    begun: Instant,
    waited: Duration,
}

impl Witness {
    pub fn start() -> Witness {
        let over = Arc::new(AtomicBool::new(false));
        let sleeper = {
            let over = Arc::clone(&over);
            std::thread::spawn(move || longest_stall(&over))
        };
        Witness { over, sleeper, begun: Instant::now(), waited: waited() }
    }

    /// Why what was timed may be late, if the machine is to blame.
    pub fn excuse(self) -> Option<String> {
        let took = self.begun.elapsed();
        let waited = waited().saturating_sub(self.waited);
        self.over.store(true, Ordering::Relaxed);
        let stall = self.sleeper.join().unwrap();
        let busy = stall >= STALL || waited >= STALL.max(took.mul_f64(WANT));
        busy.then(|| {
            format!("in {took:?} a thread woke {stall:?} late and tasks waited {waited:?}")
        })
    }
}

/// The most that a thread wakes late.
fn longest_stall(over: &AtomicBool) -> Duration {
    let mut longest = Duration::ZERO;
    while !over.load(Ordering::Relaxed) {
        let begun = Instant::now();
        std::thread::park_timeout(STEP);
        longest = longest.max(begun.elapsed().saturating_sub(STEP));
    }
    longest
}

/// How long tasks of this machine have waited for what it lacks; nothing where it does not say.
fn waited() -> Duration {
    let total = |resource: &str| {
        let text = std::fs::read_to_string(format!("/proc/pressure/{resource}")).ok()?;
        let some = text.lines().find(|line| line.starts_with("some "))?;
        some.rsplit_once("total=")?.1.parse().ok()
    };
    ["cpu", "io", "memory"].into_iter().filter_map(total).map(Duration::from_micros).sum()
}
