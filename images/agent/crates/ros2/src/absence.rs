//! How long somebody is away, as far as anybody looked.

use std::time::{Duration, Instant};

use crate::stillness::counted;

/// How long we may take to know a subscription in place of another of the same node, at which the
/// number that we know stays the same. Fast DDS was measured to take up to 0.24 s.
pub(crate) const RENEWED: Duration = Duration::from_millis(300);

/// For how long somebody is away, at the looks that were taken.
#[derive(Debug)]
pub(crate) struct Absence {
    looked: Instant,
    lasted: Duration,
}

impl Absence {
    pub(crate) fn begin() -> Absence {
        Absence { looked: Instant::now(), lasted: Duration::ZERO }
    }

    /// Takes in a look at this moment.
    pub(crate) fn look(&mut self, now: Instant) -> Duration {
        self.lasted += counted(now.saturating_duration_since(self.looked));
        self.looked = now;
        self.lasted
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_absence_lasts_as_long_as_somebody_looked() {
        let mut absence = Absence::begin();
        let (begun, ms) = (absence.looked, Duration::from_millis);
        assert_eq!(absence.look(begun + ms(5)), ms(5));
        assert_eq!(absence.look(begun + ms(30)), ms(30));
        // A machine that stood still.
        assert_eq!(absence.look(begun + ms(5_000)), ms(70));
    }
}
