//! How many messages of a recorded topic have come of those that were published by some moment.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// How many messages of a topic have come.
#[derive(Debug, Default)]
pub(crate) struct Arrivals {
    counts: Mutex<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    handed: u64,
    /// The moment that counts, in ns since 1970 by the sources' clock; none was marked yet.
    mark: Option<i64>,
    /// Messages that came since it was marked, and were published after it.
    later: u64,
    /// Messages that were waited for in vain: they are not waited for again.
    given_up: u64,
}

impl Arrivals {
    fn counts(&self) -> MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Messages that were handed to the sink.
    pub(crate) fn handed(&self) -> u64 {
        self.counts().handed
    }

    /// Those of them that were published by the moment that was marked last. What comes after it of a
    /// publisher that goes on makes up for nothing that was lost before.
    pub(crate) fn handed_by_mark(&self) -> u64 {
        let counts = self.counts();
        counts.handed - counts.later
    }

    /// From now on those count that are published by this moment, which is `now`, in ns since 1970:
    /// asked for in here, so that all that have come by it were published before.
    pub(crate) fn mark(&self, now: impl FnOnce() -> i64) {
        let mut counts = self.counts();
        (counts.mark, counts.later) = (Some(now()), 0);
    }

    /// How many of so many, which were published by the mark, have not come, without those that were
    /// waited for in vain.
    pub(crate) fn missing(&self, due: u64) -> u64 {
        let counts = self.counts();
        due.saturating_sub(counts.handed - counts.later + counts.given_up)
    }

    /// Takes in that so many were due and waited for.
    pub(crate) fn give_up(&self, due: u64) {
        let mut counts = self.counts();
        let missing = due.saturating_sub(counts.handed - counts.later);
        counts.given_up = counts.given_up.max(missing);
    }

    /// Takes in a message that was handed on, with its source's stamp in ns since 1970, at a moment
    /// `now`. One without a stamp (0), or with one of a clock that is ahead, is taken for one that was due.
    pub(crate) fn add(&self, stamp: i64, now: i64) {
        let mut counts = self.counts();
        counts.handed += 1;
        counts.later += u64::from(counts.mark.is_some_and(|mark| stamp > mark && stamp <= now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_waited_for_in_vain_is_not_waited_for_again_and_what_follows_is() {
        let arrivals = Arrivals::default();
        arrivals.add(1, 9);
        assert_eq!((arrivals.missing(1), arrivals.missing(3)), (0, 2));
        arrivals.give_up(3);
        assert_eq!((arrivals.missing(3), arrivals.missing(4)), (0, 1));
        // The next one comes after all, so that none lacks that was not given up.
        arrivals.add(2, 9);
        assert_eq!((arrivals.missing(4), arrivals.missing(5)), (0, 1));
        arrivals.give_up(4);
        assert_eq!(arrivals.missing(5), 1);
    }

    #[test]
    fn what_is_published_later_makes_up_for_nothing_that_was_due() {
        let arrivals = Arrivals::default();
        arrivals.add(5, 9);
        arrivals.mark(|| 10);
        // Of three that were published by then one is lost; a hundred follow.
        arrivals.add(10, 120);
        (11..111).for_each(|stamp| arrivals.add(stamp, 120));
        assert_eq!(
            (arrivals.handed(), arrivals.handed_by_mark(), arrivals.missing(3)),
            (102, 2, 1)
        );
        // One that has no stamp may be the one that lacks, and one of a clock that is ahead.
        arrivals.add(0, 120);
        assert_eq!((arrivals.handed_by_mark(), arrivals.missing(3)), (3, 0));
        arrivals.add(121, 120);
        assert_eq!(arrivals.handed_by_mark(), 4);
        // By another moment all of these count.
        arrivals.mark(|| 200);
        assert_eq!((arrivals.handed_by_mark(), arrivals.missing(105)), (104, 1));
    }
}
