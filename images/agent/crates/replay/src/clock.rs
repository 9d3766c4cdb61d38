//! Bag time: what the recorder stamps with and what /clock says.

use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::time::Time;

/// Bag time as it passes. Stands until it is set; shared by player and recorder.
#[derive(Debug)]
pub(crate) struct BagClock {
    /// What it passes by, and the whole replay goes by.
    pub(crate) time: Time,
    state: Mutex<State>,
    /// Bag time never goes beyond this.
    limit: u64,
}

#[derive(Clone, Copy, Debug)]
enum State {
    Standing(u64),
    Running { epoch: Instant, bag: u64, rate: f64 },
}

impl BagClock {
    /// A clock that stands at `start` and never goes beyond `limit`, in nanoseconds.
    pub(crate) fn new(time: Time, start: u64, limit: u64) -> BagClock {
        BagClock { time, state: Mutex::new(State::Standing(start)), limit }
    }

    /// Bag time now, in nanoseconds.
    pub(crate) fn now(&self) -> u64 {
        let state = *self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let now = match state {
            State::Standing(bag) => bag,
            State::Running { epoch, bag, rate } => {
                let passed = self.time.now().saturating_duration_since(epoch);
                bag.saturating_add((passed.as_secs_f64() * rate * 1e9) as u64)
            }
        };
        now.min(self.limit)
    }

    /// Stops at a time.
    pub(crate) fn stand(&self, bag: u64) {
        self.set(State::Standing(bag));
    }

    /// Runs: it is `bag` at `epoch`.
    pub(crate) fn run(&self, epoch: Instant, bag: u64, rate: f64) {
        self.set(State::Running { epoch, bag, rate });
    }

    fn set(&self, state: State) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }
}

/// When a bag time is due.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Schedule {
    /// When `bag` is due.
    pub(crate) epoch: Instant,
    /// The bag time at the epoch, in nanoseconds.
    pub(crate) bag: u64,
    /// Bag seconds per second.
    pub(crate) rate: f64,
}

impl Schedule {
    /// When `time` is due; earlier times are due at the epoch.
    pub(crate) fn due(&self, time: u64) -> Instant {
        let bag = time.saturating_sub(self.bag) as f64 / 1e9;
        self.epoch + Duration::try_from_secs_f64(bag / self.rate).unwrap_or(Duration::MAX / 4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::ByHand;

    #[test]
    fn due_times_follow_the_rate_and_do_not_drift() {
        let epoch = Instant::now();
        let schedule = Schedule { epoch, bag: 5_000_000_000, rate: 4.0 };
        assert_eq!(schedule.due(9_000_000_000) - epoch, Duration::from_secs(1));
        assert_eq!(schedule.due(1_000_000_000), epoch);
    }

    #[test]
    fn a_running_clock_advances_at_its_rate_and_stops_at_its_limit() {
        let by_hand = ByHand::new();
        let clock = BagClock::new(by_hand.time(), 7, 2_000_000_000);
        assert_eq!(clock.now(), 7);
        clock.run(by_hand.moment(Duration::from_secs(1)), 1_000_000_000, 2.0);
        assert_eq!(clock.now(), 1_000_000_000);
        by_hand.sleep(Duration::from_secs(1));
        assert_eq!(clock.now(), 1_000_000_000);
        by_hand.sleep(Duration::from_millis(250));
        assert_eq!(clock.now(), 1_500_000_000);
        by_hand.sleep(Duration::from_millis(250));
        assert_eq!(clock.now(), 2_000_000_000);
        by_hand.sleep(Duration::from_millis(250));
        assert_eq!(clock.now(), 2_000_000_000);
        clock.stand(3);
        assert_eq!(clock.now(), 3);
    }
}
