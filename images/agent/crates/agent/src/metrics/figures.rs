//! What a slot's process counts.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_replay::{Ledger, Meter, Reading};
use serde::{Deserialize, Serialize};

use crate::case::failure::Failure;

/// A slot's figures at a moment, since its process began.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Figures {
    /// A case runs.
    pub busy: bool,
    /// Size of the pipe that cases come through; 0 before the first one.
    pub pipe_bytes: u64,
    /// Cases whose worker got a result.
    pub answered: u64,
    /// Cases whose worker got a reason instead.
    pub aborted: u64,
    /// Cases whose worker got nothing.
    pub abandoned: u64,
    /// Bytes of DATA that came through the pipe.
    pub received_bytes: u64,
    /// The ledgers' sums.
    pub ledger: [u64; 3],
    /// Of the replays.
    pub replay: Reading,
}

impl Figures {
    /// What is left of a process's figures when it has ended.
    pub fn concluded(mut self) -> Self {
        self.abandoned += u64::from(self.busy);
        self.busy = false;
        self.replay.held_bytes = 0;
        self
    }

    /// Adds those of another process; of pipes the smaller one counts, of marks the higher one.
    pub fn add(&mut self, other: &Self) {
        self.busy |= other.busy;
        let pipes = [self.pipe_bytes, other.pipe_bytes];
        self.pipe_bytes = pipes.into_iter().filter(|bytes| *bytes > 0).min().unwrap_or(0);
        self.answered += other.answered;
        self.aborted += other.aborted;
        self.abandoned += other.abandoned;
        self.received_bytes += other.received_bytes;
        add_each(&mut self.ledger, &other.ledger);
        let (sum, more) = (&mut self.replay, &other.replay);
        sum.played_messages += more.played_messages;
        sum.recorded_messages += more.recorded_messages;
        sum.recorded_bytes += more.recorded_bytes;
        sum.held_bytes += more.held_bytes;
        sum.high_water_bytes = sum.high_water_bytes.max(more.high_water_bytes);
        sum.realtime_nanoseconds += more.realtime_nanoseconds;
        sum.due_nanoseconds += more.due_nanoseconds;
        sum.unpaced_nanoseconds += more.unpaced_nanoseconds;
        add_each(&mut sum.waits, &more.waits);
        sum.waited_nanoseconds += more.waited_nanoseconds;
        sum.unanswered += more.unanswered;
    }
}

fn add_each(sums: &mut [u64], more: &[u64]) {
    sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += more);
}

/// The counters of a slot's process. Cases count at their seams, replays by their [`Meter`].
#[derive(Debug, Default)]
pub struct SlotFigures {
    /// The pipe counts into it.
    pub received_bytes: Arc<AtomicU64>,
    /// Replays tell it how far they are.
    pub meter: Arc<Meter>,
    busy: AtomicBool,
    pipe_bytes: AtomicU64,
    answered: AtomicU64,
    aborted: AtomicU64,
    abandoned: AtomicU64,
    ledger: [AtomicU64; 3],
    /// Whether a case has begun or ended since somebody looked.
    stirred: Mutex<bool>,
    stir: Condvar,
}

impl SlotFigures {
    /// A case has come, through a pipe of this size.
    pub fn begin(&self, pipe_bytes: u64) {
        self.pipe_bytes.store(pipe_bytes, Ordering::Relaxed);
        self.busy.store(true, Ordering::Relaxed);
        self.wake();
    }

    /// A case has a ledger.
    pub fn proved(&self, ledger: &Ledger) {
        let sums = [ledger.sent, ledger.received, ledger.dropped];
        for (figure, more) in self.ledger.iter().zip(sums) {
            figure.fetch_add(more, Ordering::Relaxed);
        }
    }

    /// A session has ended; it counts if a case had begun in it.
    pub fn end(&self, ended: &Result<(), Failure>) {
        if self.busy.swap(false, Ordering::Relaxed) {
            let figure = match ended {
                Ok(()) => &self.answered,
                Err(Failure::Abort(_)) => &self.aborted,
                Err(Failure::Silent(_)) => &self.abandoned,
            };
            figure.fetch_add(1, Ordering::Relaxed);
            self.wake();
        }
    }

    /// All figures.
    pub fn read(&self) -> Figures {
        let value = |figure: &AtomicU64| figure.load(Ordering::Relaxed);
        Figures {
            busy: self.busy.load(Ordering::Relaxed),
            pipe_bytes: value(&self.pipe_bytes),
            answered: value(&self.answered),
            aborted: value(&self.aborted),
            abandoned: value(&self.abandoned),
            received_bytes: value(&self.received_bytes),
            ledger: std::array::from_fn(|place| value(&self.ledger[place])),
            replay: self.meter.read(),
        }
    }

    /// Waits until a case begins or ends, at most for `limit` if there is one.
    pub fn await_stir(&self, limit: Option<Duration>) {
        // The flag is whole whatever happened to the thread that held it.
        let stirred = self.stirred.lock().unwrap_or_else(PoisonError::into_inner);
        let still = |stirred: &mut bool| !*stirred;
        let mut stirred = match limit {
            Some(limit) => {
                let waited = self.stir.wait_timeout_while(stirred, limit, still);
                waited.unwrap_or_else(PoisonError::into_inner).0
            }
            None => {
                let waited = self.stir.wait_while(stirred, still);
                waited.unwrap_or_else(PoisonError::into_inner)
            }
        };
        *stirred = false;
    }

    fn wake(&self) {
        *self.stirred.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.stir.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_counts_once_by_its_end_and_a_session_without_one_does_not() {
        let slot = SlotFigures::default();
        let silent = || Err(Failure::Silent("gone".to_owned()));
        slot.end(&silent());
        for ended in [Ok(()), Ok(()), Err(Failure::new("Internal", "x")), silent()] {
            slot.begin(65_536);
            assert!(slot.read().busy);
            slot.end(&ended);
            slot.end(&ended);
        }
        let ledger = Ledger { sent: 10, received: 8, dropped: 2, ..Ledger::default() };
        slot.proved(&ledger);
        slot.proved(&ledger);
        let read = slot.read();
        assert_eq!((read.answered, read.aborted, read.abandoned, read.busy), (2, 1, 1, false));
        assert_eq!((read.ledger, read.pipe_bytes), ([20, 16, 4], 65_536));
    }

    #[test]
    fn slots_add_up_but_for_what_has_no_sum() {
        let figures = |pipe_bytes, mark| Figures {
            pipe_bytes,
            busy: mark == 7,
            answered: 1,
            ledger: [1, 2, 3],
            replay: Reading {
                high_water_bytes: mark,
                held_bytes: mark,
                waits: [1; 14],
                ..Reading::default()
            },
            ..Figures::default()
        };
        let mut sum = Figures::default();
        [figures(0, 3), figures(4096, 7), figures(65_536, 5)].iter().for_each(|f| sum.add(f));
        assert_eq!((sum.pipe_bytes, sum.replay.high_water_bytes), (4096, 7));
        assert_eq!((sum.answered, sum.ledger, sum.replay.held_bytes), (3, [3, 6, 9], 15));
        assert_eq!(sum.replay.waits, [3; 14]);
        let ended = figures(4096, 7).concluded();
        assert_eq!((ended.busy, ended.abandoned, ended.replay.held_bytes), (false, 1, 0));
        assert_eq!((ended.answered, ended.replay.high_water_bytes), (1, 7));
    }
}
