//! How long somebody is away, as far as anybody looked.

use std::time::{Duration, Instant};

/// How long we may take to know a subscription in place of another of the same node, at which the
/// number that we know stays the same. Fast DDS was measured to take up to 0.24 s.
pub(crate) const RENEWED: Duration = Duration::from_millis(300);

/// How much of the time between two looks counts by the clock: less than is allowed, so that a single look
/// after a machine stood still is not enough.
pub(crate) const BY_THE_CLOCK: Duration = Duration::from_millis(250);

/// Of the time between two looks, which are every 20 ms, so much counts: we may have stood still.
pub(crate) const LOOK: Duration = Duration::from_millis(40);

/// What counts of the time between two looks for who waits for others: where the whole machine
/// stood still, none of them had the rest of it either.
pub(crate) fn counted(passed: Duration) -> Duration {
    passed.min(LOOK)
}

/// For how long somebody is away, at the looks that were taken.
#[derive(Debug)]
pub(crate) struct Absence {
    looked: Instant,
    lasted: Duration,
}

impl Absence {
    pub(crate) fn begin(now: Instant) -> Absence {
        Absence { looked: now, lasted: Duration::ZERO }
    }

    /// Takes in a look at this moment; of the time since the one before at `most` so much counts.
    pub(crate) fn look(&mut self, now: Instant, most: Duration) -> Duration {
        self.lasted += now.saturating_duration_since(self.looked).min(most);
        self.looked = now;
        self.lasted
    }

    /// For how long by the last look.
    pub(crate) fn lasted(&self) -> Duration {
        self.lasted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_absence_lasts_as_long_as_somebody_looked() {
        let mut absence = Absence::begin(Instant::now());
        let (begun, ms) = (absence.looked, Duration::from_millis);
        assert_eq!(absence.look(begun + ms(5), ms(40)), ms(5));
        assert_eq!(absence.look(begun + ms(30), ms(40)), ms(30));
        // A machine that stood still.
        assert_eq!(absence.look(begun + ms(5_000), ms(40)), ms(70));
        // Half a second is over at the second look.
        let mut absence = Absence::begin(Instant::now());
        let begun = absence.looked;
        assert!(absence.look(begun + ms(500), BY_THE_CLOCK) < RENEWED);
        assert!(absence.look(begun + ms(1_000), BY_THE_CLOCK) >= RENEWED);
    }
}
