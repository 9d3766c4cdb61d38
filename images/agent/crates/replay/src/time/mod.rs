//! Where the player's time comes from: the machine's clock or, in tests, one that stands until
//! somebody sleeps.
//!
//! Whatever decides goes by it: schedules, distances, pauses, deadlines, quiet. On the machine's
//! clock stay those that measure the machine ([`crate::machine`], [`crate::processes`]), the
//! threads beside the play, which wait for sockets (their waits are not the player's to skip), and
//! the recording of a live graph ([`crate::record()`]), whose stamps are the wall clock's.

#[cfg(test)]
mod by_hand;

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

#[cfg(test)]
pub(crate) use by_hand::ByHand;

/// A source of time. Its clones are the same one.
#[derive(Clone, Debug, Default)]
pub(crate) enum Time {
    /// The machine's monotonic clock.
    #[default]
    Machine,
    /// One that a test moves.
    #[cfg(test)]
    ByHand(std::sync::Arc<ByHand>),
}

impl Time {
    /// The present moment.
    pub(crate) fn now(&self) -> Instant {
        match self {
            Time::Machine => Instant::now(),
            #[cfg(test)]
            Time::ByHand(time) => time.now(),
        }
    }

    /// Returns when so much time has passed.
    pub(crate) fn sleep(&self, time: Duration) {
        match self {
            Time::Machine => std::thread::sleep(time),
            #[cfg(test)]
            Time::ByHand(by_hand) => by_hand.sleep(time),
        }
    }

    /// Returns when `waits` no longer says so of what is locked, asked at once and after each
    /// notification, or when `limit` has passed; the last question comes after that.
    pub(crate) fn wait_while<T>(
        &self,
        locked: &Mutex<T>,
        notified: &Condvar,
        limit: Duration,
        mut waits: impl FnMut(&mut T) -> bool,
    ) {
        match self {
            Time::Machine => {
                let guard = locked.lock().unwrap_or_else(PoisonError::into_inner);
                // A poisoned lock is as good as another: the asker has seen what it wanted.
                drop(notified.wait_timeout_while(guard, limit, |locked| waits(locked)));
            }
            #[cfg(test)]
            Time::ByHand(time) => time.wait_while(limit, || {
                waits(&mut locked.lock().unwrap_or_else(PoisonError::into_inner))
            }),
        }
    }
}

/// Seconds of consecutive parts.
pub(crate) struct Stopwatch(Instant);

impl Stopwatch {
    pub(crate) fn start(now: Instant) -> Self {
        Self(now)
    }

    /// Seconds since the last lap.
    pub(crate) fn lap(&mut self, now: Instant) -> f64 {
        let lap = now.duration_since(self.0).as_secs_f64();
        self.0 = now;
        lap
    }
}
