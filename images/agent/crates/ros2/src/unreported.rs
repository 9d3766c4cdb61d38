//! For how long somebody is known that has not reported whom it has matched.

use std::time::{Duration, Instant};

use crate::absence::Absence;

/// Who has not reported for so long whom it knows is believed to know us: what only publishes, or computes
/// without end, never reports.
pub(crate) const UNREPORTED: Duration = Duration::from_secs(2);
/// So much of the time between two looks counts, which are every half a second at the most: a machine may have
/// stood still, and nobody could report.
const MOST: Duration = Duration::from_millis(500);

/// One that has not reported.
#[derive(Debug)]
pub(crate) struct Unreported(Absence);

impl Unreported {
    /// It is known from now on.
    pub(crate) fn begin(now: Instant) -> Unreported {
        Unreported(Absence::begin(now))
    }

    /// Takes in a look at this moment.
    pub(crate) fn look(&mut self, now: Instant) {
        self.0.look(now, MOST);
    }

    /// For how long it is known, as far as anybody looked.
    pub(crate) fn lasted(&self) -> Duration {
        self.0.lasted()
    }

    /// Whether it is believed to know us, as far as nothing else is against that.
    pub(crate) fn is_believed(&self) -> bool {
        self.lasted() >= UNREPORTED
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_does_not_report_is_believed_after_two_seconds_however_often_somebody_looks() {
        for every in [5, 10, 40, 250, 500] {
            let (begun, ms) = (Instant::now(), Duration::from_millis);
            let mut one = Unreported::begin(begun);
            let believed = (1..).map(|look| look * every).find(|at| {
                one.look(begun + ms(*at));
                one.is_believed()
            });
            assert_eq!(believed, Some(2_000), "{every}");
        }
    }

    #[test]
    fn a_machine_that_stands_still_is_no_time_to_report_in() {
        let (begun, ms) = (Instant::now(), Duration::from_millis);
        let mut one = Unreported::begin(begun);
        one.look(begun + ms(60_000));
        assert_eq!((one.lasted(), one.is_believed()), (ms(500), false));
    }
}
