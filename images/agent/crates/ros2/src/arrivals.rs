//! How many messages of a recorded topic have come of those that were published by some moment, and of whom.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use crate::accounts::Due;
use crate::handed::{Gid, Handed};

/// Publishers of a topic that are distinguished; messages of more are nobody's known.
const MOST: usize = 4096;

/// How many messages of a topic have come.
#[derive(Debug, Default)]
pub(crate) struct Arrivals {
    counts: Mutex<Counts>,
}

#[derive(Debug, Default)]
struct Counts {
    all: Come,
    /// Of each whose messages have its GID.
    of: BTreeMap<Gid, Come>,
    /// The moment that counts, in ns since 1970 by the sources' clock; none was marked yet.
    mark: Option<i64>,
    /// Messages that were waited for in vain: they are not waited for again.
    given_up: u64,
}

#[derive(Clone, Copy, Debug, Default)]
struct Come {
    handed: u64,
    /// Those of them that came since the moment was marked, and were published after it.
    later: u64,
}

impl Come {
    fn by_mark(self) -> u64 {
        self.handed - self.later
    }
}

impl Counts {
    fn handed(&self, count: impl Fn(Come) -> u64) -> Handed {
        let of = self.of.iter().map(|(gid, come)| (*gid, count(*come)));
        Handed::new(count(self.all), of.collect())
    }

    fn missing(&self, due: &Due) -> u64 {
        due.missing(&self.handed(Come::by_mark))
    }
}

impl Arrivals {
    fn counts(&self) -> MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Messages that were handed to the sink.
    pub(crate) fn handed(&self) -> Handed {
        self.counts().handed(|come| come.handed)
    }

    /// Those of them that were published by the moment that was marked last. What comes after it of a
    /// publisher that goes on makes up for nothing that was lost before.
    pub(crate) fn handed_by_mark(&self) -> Handed {
        self.counts().handed(Come::by_mark)
    }

    /// From now on those count that are published by this moment, which is `now`, in ns since 1970:
    /// asked for in here, so that all that have come by it were published before.
    pub(crate) fn mark(&self, now: impl FnOnce() -> i64) {
        let mut counts = self.counts();
        counts.mark = Some(now());
        let Counts { all, of, .. } = &mut *counts;
        of.values_mut().chain([all]).for_each(|come| come.later = 0);
    }

    /// How many of those that were due by the mark have not come, without those that were waited for
    /// in vain.
    pub(crate) fn missing(&self, due: &Due) -> u64 {
        let counts = self.counts();
        counts.missing(due).saturating_sub(counts.given_up)
    }

    /// Takes in that so many were due and waited for.
    pub(crate) fn give_up(&self, due: &Due) {
        let mut counts = self.counts();
        counts.given_up = counts.given_up.max(counts.missing(due));
    }

    /// Takes in a message that was handed on, of this publisher, with its source's stamp in ns since 1970, at a
    /// moment `now`. One without a stamp (0), or with one of a clock that is ahead, is taken for one that was due.
    pub(crate) fn add(&self, publisher: Option<Gid>, stamp: i64, now: i64) {
        let mut counts = self.counts();
        let later = u64::from(counts.mark.is_some_and(|mark| stamp > mark && stamp <= now));
        let Counts { all, of, .. } = &mut *counts;
        let known = publisher.filter(|gid| of.len() < MOST || of.contains_key(gid));
        let of = known.map(|gid| of.entry(gid).or_default());
        for come in of.into_iter().chain([all]) {
            come.handed += 1;
            come.later += later;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Gid = [1; 16];
    const B: Gid = [2; 16];

    /// So many of all publishers together.
    fn due(all: u64) -> Due {
        Due::of_all(all)
    }

    #[test]
    fn what_was_waited_for_in_vain_is_not_waited_for_again_and_what_follows_is() {
        let arrivals = Arrivals::default();
        arrivals.add(None, 1, 9);
        assert_eq!((arrivals.missing(&due(1)), arrivals.missing(&due(3))), (0, 2));
        arrivals.give_up(&due(3));
        assert_eq!((arrivals.missing(&due(3)), arrivals.missing(&due(4))), (0, 1));
        // The next one comes after all, so that none lacks that was not given up.
        arrivals.add(None, 2, 9);
        assert_eq!((arrivals.missing(&due(4)), arrivals.missing(&due(5))), (0, 1));
        arrivals.give_up(&due(4));
        assert_eq!(arrivals.missing(&due(5)), 1);
    }

    #[test]
    fn what_is_published_later_makes_up_for_nothing_that_was_due() {
        let arrivals = Arrivals::default();
        arrivals.add(None, 5, 9);
        arrivals.mark(|| 10);
        // Of three that were published by then one is lost; a hundred follow.
        arrivals.add(None, 10, 120);
        (11..111).for_each(|stamp| arrivals.add(None, stamp, 120));
        let handed = || (arrivals.handed().all, arrivals.handed_by_mark().all);
        assert_eq!((handed(), arrivals.missing(&due(3))), ((102, 2), 1));
        // One that has no stamp may be the one that lacks, and one of a clock that is ahead.
        arrivals.add(None, 0, 120);
        assert_eq!((handed(), arrivals.missing(&due(3))), ((103, 3), 0));
        arrivals.add(None, 121, 120);
        assert_eq!(handed(), (104, 4));
        // By another moment all of these count.
        arrivals.mark(|| 200);
        assert_eq!((handed(), arrivals.missing(&due(105))), ((104, 104), 1));
    }

    #[test]
    fn what_comes_is_known_by_its_publisher_by_the_mark_and_in_all() {
        let arrivals = Arrivals::default();
        arrivals.mark(|| 10);
        for (gid, stamp) in [(Some(A), 9), (Some(A), 11), (Some(B), 12), (None, 13), (None, 1)] {
            arrivals.add(gid, stamp, 20);
        }
        let of = |handed: Handed| (handed.all, handed.of(&A), handed.of(&B), handed.of_nobody());
        assert_eq!(of(arrivals.handed()), (5, 2, 1, 2));
        assert_eq!(of(arrivals.handed_by_mark()), (2, 1, 0, 1));
        arrivals.mark(|| 20);
        assert_eq!(of(arrivals.handed_by_mark()), (5, 2, 1, 2));
    }

    #[test]
    fn of_more_publishers_than_are_distinguished_the_rest_are_nobody_s() {
        let arrivals = Arrivals::default();
        for number in (0..MOST as u128 + 2).chain([0, MOST as u128]) {
            arrivals.add(Some(number.to_le_bytes()), 1, 2);
        }
        let handed = arrivals.handed();
        assert_eq!((handed.of(&0_u128.to_le_bytes()), handed.of_nobody()), (2, 3));
    }
}
