//! For how long nobody was seen to do anything, and yet not all had come.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::Awake;

use crate::absence::counted;

/// What was seen since something is in doubt.
#[derive(Default)]
pub(super) struct Doubt {
    looked: Option<Instant>,
    asleep: Duration,
    /// How long each thread that is awake had run when it was first seen so, of those that were at each look since.
    awake: BTreeMap<u32, Duration>,
}

/// For how long nothing came.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct InVain {
    /// While all slept.
    pub(super) asleep: Duration,
    /// While nobody slept that is awake now: each of them has run for so long at least. Who waits for a processor
    /// has not.
    pub(super) ran: Duration,
}

impl InVain {
    /// Whether it is as much as that in one of both.
    pub(super) fn is_over(self, limit: InVain) -> bool {
        self.asleep >= limit.asleep || self.ran >= limit.ran
    }
}

impl Doubt {
    /// Takes in a look at a moment, and who was awake then.
    pub(super) fn look(&mut self, now: Instant, awake: &[Awake]) -> InVain {
        let passed = self.looked.replace(now).map_or(Duration::ZERO, |before| now - before);
        if awake.is_empty() {
            self.asleep += counted(passed);
        }
        let first = |one: &Awake| self.awake.get(&one.thread).copied().unwrap_or(one.ran);
        let since: BTreeMap<u32, Duration> =
            awake.iter().map(|one| (one.thread, first(one))).collect();
        let ran = awake.iter().map(|one| one.ran.saturating_sub(since[&one.thread])).min();
        self.awake = since;
        InVain { asleep: self.asleep, ran: ran.unwrap_or_default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    /// Threads that are awake, and for how many ms they have run.
    fn awake<const N: usize>(threads: [(u32, u32); N]) -> Vec<Awake> {
        threads.map(|(thread, ran)| Awake { thread, ran: ran * MS }).into()
    }

    #[test]
    fn only_time_in_which_all_slept_and_we_looked_makes_a_doubt() {
        let (begun, somebody) = (Instant::now(), awake([(1, 7)]));
        let mut doubt = Doubt::default();
        let mut asleep = |at: u32, awake: &[Awake]| doubt.look(begun + at * MS, awake).asleep;
        assert_eq!(asleep(0, &[]), Duration::ZERO);
        assert_eq!(asleep(20, &[]), 20 * MS);
        assert_eq!(asleep(40, &somebody), 20 * MS);
        assert_eq!(asleep(55, &[]), 35 * MS);
        // A machine that stood still.
        assert_eq!(asleep(5_000, &[]), 75 * MS);
    }

    #[test]
    fn who_never_sleeps_has_run_since_it_was_first_seen_and_who_slept_begins_again() {
        let begun = Instant::now();
        let mut doubt = Doubt::default();
        let mut ran = |at: u32, awake: &[Awake]| doubt.look(begun + at * MS, awake).ran;
        assert_eq!(ran(0, &awake([(1, 5_000)])), Duration::ZERO);
        assert_eq!(ran(20, &awake([(1, 5_020)])), 20 * MS);
        // Another one begins, and the one that has run the least counts.
        assert_eq!(ran(40, &awake([(1, 5_040), (2, 0)])), Duration::ZERO);
        assert_eq!(ran(60, &awake([(1, 5_060), (2, 15)])), 15 * MS);
        assert_eq!(ran(80, &awake([(1, 5_080)])), 80 * MS);
        assert_eq!(ran(100, &[]), Duration::ZERO);
        assert_eq!(ran(120, &awake([(1, 5_100)])), Duration::ZERO);
    }

    #[test]
    fn who_waits_for_a_processor_beside_one_that_never_sleeps_has_not_run() {
        let begun = Instant::now();
        let mut doubt = Doubt::default();
        for at in 0..500 {
            let looked = doubt.look(begun + 20 * at * MS, &awake([(1, 20 * at), (2, 3)]));
            assert_eq!(looked, InVain { asleep: Duration::ZERO, ran: Duration::ZERO });
        }
    }
}
