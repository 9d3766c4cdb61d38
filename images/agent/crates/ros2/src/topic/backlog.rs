//! Whether a node has taken all that the stack itself had published on a topic before we play it: what
//! of that still waits for it would be taken for ours later on.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, EndpointId, Ledger, LedgerError};

use super::look::Look;
use crate::link::Baseline;
use crate::stillness::counted;

/// How long a published message may be on its way to a queue.
const ON_ITS_WAY: Duration = Duration::from_millis(100);
/// How long is looked for a moment at which nothing is left, in time that counts.
const PATIENCE: Duration = Duration::from_secs(1);

/// A node of which it is not known yet that nothing waits for it.
#[derive(Default)]
pub(super) struct Backlog {
    looked: Option<Instant>,
    lasted: Duration,
    /// When nothing seemed to be left, and what had been published and taken by then.
    rest: Option<(Instant, Stand)>,
}

/// Messages at a moment at which no publish was under way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stand {
    /// What all publishers had published.
    offered: u64,
    /// What each subscription had taken, and whether nothing was seen to be left for it since the
    /// look before.
    taken: Vec<(u64, bool)>,
}

impl Stand {
    /// Whether nothing was ever published, or each subscription has taken all of it.
    fn is_whole(&self) -> bool {
        self.offered == 0 || self.taken.iter().all(|(taken, _)| *taken == self.offered)
    }

    fn is_at_rest(&self) -> bool {
        self.taken.iter().all(|(_, rested)| *rested)
    }

    /// Whether each subscription took as much since an earlier moment as was published.
    fn has_come_with(&self, earlier: &Stand) -> bool {
        let published = self.offered.checked_sub(earlier.offered);
        let pairs = self.taken.iter().zip(&earlier.taken);
        self.taken.len() == earlier.taken.len()
            && pairs.into_iter().all(|(now, then)| now.0.checked_sub(then.0) == published)
    }
}

impl Backlog {
    /// Takes in a look, with how far all were if that is known; whether nothing is left.
    ///
    /// At a moment at which a queue was empty a message may have been on its way to it, and a node that
    /// has other work does not look. So it has to be so twice, as long after each other as a message
    /// takes, with as much taken in between as published.
    pub(super) fn look(&mut self, now: Instant, stand: Option<Stand>) -> bool {
        // Whoever is at rest was seen to be since then.
        let seen = self.looked.replace(now).unwrap_or(now);
        self.lasted += counted(now - seen);
        let Some(stand) = stand else { return false };
        if stand.is_whole() {
            return true;
        }
        if !stand.is_at_rest() {
            return false;
        }
        match &self.rest {
            Some((since, before)) if stand.has_come_with(before) => *since + ON_ITS_WAY <= seen,
            _ => {
                self.rest = Some((now, stand));
                false
            }
        }
    }

    /// Whether it is not waited for any longer.
    pub(super) fn is_given_up(&self) -> bool {
        self.lasted >= PATIENCE
    }
}

/// How far these are now, to count from; and the same as far as it holds for one moment.
pub(super) fn stand(
    ledger: &Ledger,
    look: &Look,
    subscriptions: &[&Endpoint],
    publishers: &[&Endpoint],
) -> Result<(Baseline, Option<Stand>), LedgerError> {
    let offered = || -> Result<BTreeMap<EndpointId, (u64, bool)>, LedgerError> {
        let of = |one: &&Endpoint| {
            let counts = ledger.counts(one.id)?;
            // Of a process that has ended nothing is under way.
            let rests = counts.published == counts.offered || !look.running.contains(&one.process);
            Ok((one.id, (counts.offered, rests)))
        };
        publishers.iter().map(of).collect()
    };
    let before = offered()?;
    let mut taken = Vec::new();
    for one in subscriptions {
        let counts = ledger.counts(one.id)?;
        ledger.forget_rest(one.id)?;
        taken.push((one.id, counts.taken, counts.rested == Some(counts.taken)));
    }
    let after = offered()?;
    let still = before == after && after.values().all(|(_, rests)| *rests);
    let stand = still.then(|| Stand {
        offered: after.values().map(|(offered, _)| offered).sum(),
        taken: taken.iter().map(|(_, taken, rested)| (*taken, *rested)).collect(),
    });
    let baseline = Baseline {
        taken: taken.into_iter().map(|(id, taken, _)| (id, taken)).collect(),
        others: after.into_iter().map(|(id, (offered, _))| (id, offered)).collect(),
        mixed: false,
    };
    Ok((baseline, stand))
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: Duration = Duration::from_millis(1);

    fn stand(offered: u64, taken: u64, rested: bool) -> Option<Stand> {
        Some(Stand { offered, taken: vec![(taken, rested)] })
    }

    /// Whether nothing is left after looks, each so many milliseconds after the beginning.
    fn after(looks: &[(u32, Option<Stand>)]) -> bool {
        let (begun, mut backlog) = (Instant::now(), Backlog::default());
        let mut found = false;
        for (at, stand) in looks {
            found = backlog.look(begun + *at * MS, stand.clone());
        }
        found
    }

    #[test]
    fn who_has_taken_all_there_was_has_nothing_left() {
        assert!(after(&[(0, stand(0, 0, false))]));
        assert!(after(&[(0, stand(0, 9, false))]));
        assert!(after(&[(0, stand(7, 7, false))]));
        assert!(!after(&[(0, stand(7, 6, false))]));
        assert!(!after(&[(0, None)]));
    }

    #[test]
    fn who_came_late_has_nothing_left_after_two_moments_of_rest_with_nothing_lost_between() {
        let first = (0, stand(100, 3, true));
        assert!(!after(std::slice::from_ref(&first)));
        // What is seen at a look may have been so since the one before.
        let seen = |at, stand| after(&[first.clone(), (at, None), (900, stand)]);
        assert!(!after(&[first.clone(), (900, stand(100, 3, true))]));
        assert!(!seen(99, stand(100, 3, true)));
        assert!(seen(100, stand(100, 3, true)));
        assert!(seen(100, stand(120, 23, true)));
        // One was on its way, and has come.
        assert!(!seen(100, stand(100, 4, true)));
        assert!(!seen(100, stand(101, 3, true)));
        assert!(!seen(100, stand(100, 3, false)));
        // From there on it counts again.
        let then = [first, (100, None), (200, stand(100, 4, true)), (299, None)];
        assert!(!after(&[&then[..], &[(900, stand(100, 4, true))]].concat()));
        let then = [&then[..3], &[(300, None), (900, stand(100, 4, true))]].concat();
        assert!(after(&then));
    }

    #[test]
    fn more_than_was_published_comes_from_somebody_who_does_not_count() {
        assert!(!after(&[(0, stand(7, 8, false))]));
        assert!(after(&[(0, stand(7, 8, true)), (100, None), (120, stand(7, 8, true))]));
    }

    #[test]
    fn each_of_several_subscriptions_counts() {
        let both = |first: (u64, bool), second: (u64, bool)| {
            Some(Stand { offered: 9, taken: vec![first, second] })
        };
        assert!(after(&[(0, both((9, false), (9, true)))]));
        assert!(!after(&[(0, both((9, false), (8, true)))]));
        let apart = |second| after(&[(0, both((1, true), (2, true))), (100, None), (200, second)]);
        assert!(apart(both((1, true), (2, true))));
        assert!(!apart(both((1, true), (3, true))));
        assert!(!apart(both((1, true), (2, false))));
    }

    #[test]
    fn it_is_waited_for_as_long_as_somebody_looked() {
        let (begun, mut backlog) = (Instant::now(), Backlog::default());
        backlog.look(begun, None);
        // A machine that stood still.
        backlog.look(begun + 5000 * MS, None);
        assert!(!backlog.is_given_up());
        for look in 1..=48 {
            backlog.look(begun + (5000 + 20 * look) * MS, None);
            assert_eq!(backlog.is_given_up(), look == 48, "{look}");
        }
    }
}
