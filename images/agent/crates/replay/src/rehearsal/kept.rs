//! Outlets in memory.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_graph::{Cancelled, Outlet, SendError, Share};

use crate::clock::BagClock;
use crate::time::ByHand;

/// A message that went out.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Sent {
    at: Duration,
    bag: u64,
    topic: String,
    frame: Vec<u8>,
}

/// What a subscriber does with a word when it gets it.
type Reader = Box<dyn Fn(&str) + Send + Sync>;

/// All that went out, in order.
#[derive(Clone)]
pub(super) struct Log {
    by_hand: Arc<ByHand>,
    clock: Arc<BagClock>,
    sent: Arc<Mutex<Vec<Sent>>>,
    reader: Arc<Mutex<Option<Reader>>>,
    /// Nobody takes the time.
    clock_waits: Arc<AtomicBool>,
}

impl Log {
    pub(super) fn new(by_hand: &Arc<ByHand>, clock: &Arc<BagClock>) -> Log {
        let (by_hand, clock) = (Arc::clone(by_hand), Arc::clone(clock));
        let clock_waits = Arc::default();
        Log { by_hand, clock, sent: Arc::default(), reader: Arc::default(), clock_waits }
    }

    /// From now on nobody takes the time, for which its sender waits.
    pub(super) fn let_clock_wait(&self) {
        self.clock_waits.store(true, Ordering::Relaxed);
    }

    /// Each word goes to `reader` before its sending is over.
    pub(super) fn read_by(&self, reader: impl Fn(&str) + Send + Sync + 'static) {
        *self.reader.lock().unwrap() = Some(Box::new(reader));
    }

    /// Where a topic's messages go.
    pub(super) fn outlet(&self, topic: &str) -> Arc<Kept> {
        Arc::new(Kept { topic: topic.to_owned(), log: self.clone() })
    }

    /// The words that went out, and when.
    pub(super) fn words(&self) -> Vec<(Duration, String)> {
        let sent = self.sent.lock().unwrap();
        let words = sent.iter().filter(|sent| sent.topic != "/clock");
        words.map(|sent| (sent.at, word(&sent.frame))).collect()
    }

    /// Bag time, in nanoseconds, by the player's clock, when each word went out.
    pub(super) fn bag_times(&self) -> Vec<u64> {
        let sent = self.sent.lock().unwrap();
        sent.iter().filter(|sent| sent.topic != "/clock").map(|sent| sent.bag).collect()
    }

    /// The times on /clock, in nanoseconds, and when they were sent.
    pub(super) fn ticks(&self) -> Vec<(Duration, u64)> {
        let sent = self.sent.lock().unwrap();
        let ticks = sent.iter().filter(|sent| sent.topic == "/clock");
        ticks.map(|sent| (sent.at, time(&sent.frame))).collect()
    }
}

/// A topic whose only subscriber reads at once, unless the log's reader takes its time.
pub(super) struct Kept {
    topic: String,
    log: Log,
}

impl Outlet for Kept {
    fn topic(&self) -> &str {
        &self.topic
    }

    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(&self, _: Share, frames: &[&[u8]], cancelled: Cancelled<'_>) -> Result<(), SendError> {
        while self.topic == "/clock" && self.log.clock_waits.load(Ordering::Relaxed) {
            if cancelled() {
                return Err(SendError::Cancelled);
            }
            self.log.by_hand.time().sleep(Duration::from_millis(10));
        }
        for frame in frames {
            let (at, bag) = (self.log.by_hand.passed(), self.log.clock.now());
            let sent = Sent { at, bag, topic: self.topic.clone(), frame: frame.to_vec() };
            self.log.sent.lock().unwrap().push(sent);
            let reader = self.log.reader.lock().unwrap();
            if let Some(reader) = reader.as_ref().filter(|_| self.topic != "/clock") {
                reader(&word(frame));
            }
        }
        Ok(())
    }

    fn await_unread(&self, _: u64, _: Cancelled<'_>) -> Result<(), SendError> {
        Ok(())
    }
}

/// The text in a frame of a std_msgs/String.
fn word(frame: &[u8]) -> String {
    String::from_utf8(frame[8..].to_vec()).unwrap()
}

/// The time in a frame of a rosgraph_msgs/Clock, in nanoseconds.
fn time(frame: &[u8]) -> u64 {
    let number = |at: usize| u64::from(u32::from_le_bytes(frame[at..at + 4].try_into().unwrap()));
    number(4) * 1_000_000_000 + number(8)
}
