//! Whether a node has taken all that the stack itself had published on a topic before we play it: what
//! of that still waits for it would be taken for ours later on.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{
    Counts, Durability, Endpoint, EndpointId, History, Ledger, LedgerError, Qos,
};

use super::look::Look;
use crate::link::Baseline;
use crate::qos::reaches;
use crate::stillness::counted;

/// How long a published message may be on its way to a queue.
const ON_ITS_WAY: Duration = Duration::from_millis(100);
/// At so many moments a queue was empty, with as much taken in between as was published, of which nothing
/// is believed to have been on its way at the last: a node that takes what comes at once is seen at a
/// moment at which something is on its way one time in a hundred, at 100 messages a second.
const MOMENTS: u32 = 3;
/// How long is looked for such moments, in time that counts.
const PATIENCE: Duration = Duration::from_secs(1);

/// A node of which it is not known yet that nothing waits for it.
#[derive(Default)]
pub(super) struct Backlog {
    looked: Option<Instant>,
    lasted: Duration,
    rest: Option<Rest>,
}

/// Moments at which nothing seemed to be left.
struct Rest {
    /// The last of them.
    at: Duration,
    moments: u32,
    /// What had been published and taken by the first.
    stand: Stand,
}

/// Messages at a moment at which no publish was under way.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stand {
    /// What all publishers had published.
    offered: u64,
    /// What each subscription had taken, and when it was seen that nothing was left for it, if nothing
    /// was taken or published since.
    taken: Vec<(u64, Option<Duration>)>,
}

impl Stand {
    /// Whether nothing was ever published, or each subscription has taken all of it.
    fn is_whole(&self) -> bool {
        self.offered == 0 || self.taken.iter().all(|(taken, _)| *taken == self.offered)
    }

    /// The first and the last moment at which a subscription was at rest; none if one of them is not.
    fn rest(&self) -> Option<(Duration, Duration)> {
        let rests = self.taken.iter().map(|(_, at)| *at).collect::<Option<Vec<Duration>>>()?;
        Some((*rests.iter().min()?, *rests.iter().max()?))
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
    /// At a moment at which a queue was empty a message may have been on its way to it. So it has to be
    /// so at several, as far apart as a message takes, with as much taken in between as published.
    pub(super) fn look(&mut self, now: Instant, stand: Option<Stand>) -> bool {
        let seen = self.looked.replace(now).unwrap_or(now);
        self.lasted += counted(now - seen);
        let Some(stand) = stand else { return false };
        if stand.is_whole() {
            return true;
        }
        let Some((first, last)) = stand.rest() else { return false };
        match &mut self.rest {
            Some(rest) if stand.has_come_with(&rest.stand) => {
                if first >= rest.at + ON_ITS_WAY {
                    (rest.at, rest.moments) = (last, rest.moments + 1);
                }
                rest.moments >= MOMENTS
            }
            _ => {
                self.rest = Some(Rest { at: last, moments: 1, stand });
                false
            }
        }
    }

    /// Whether it is not waited for any longer.
    pub(super) fn is_given_up(&self) -> bool {
        self.lasted >= PATIENCE
    }
}

/// What a publisher has offered, when it last returned from that, and whether nothing is under way.
type Offered = (u64, Duration, bool);

/// Messages that a subscription must have been given at least of publishers that are there, each with what it
/// has published: who comes late is given what they keep, which may be on its way for long.
fn kept<'q>(wanted: &Qos, publishers: impl Iterator<Item = (&'q Qos, u64)>) -> u64 {
    let depth = |qos: &Qos| match qos.history {
        History::KeepLast => qos.depth,
        History::KeepAll | History::Other(_) => u64::MAX,
    };
    let keeps = |qos: &Qos| qos.durability == Durability::TransientLocal;
    let each = publishers.filter(|(qos, _)| keeps(qos) && keeps(wanted) && reaches(qos, wanted));
    let all = each.fold(0_u64, |all, (qos, offered)| all.saturating_add(offered.min(depth(qos))));
    all.min(depth(wanted))
}

/// When nothing was left for a subscription to take, if nothing was taken since, or published, which was
/// so far for the last time at the other moment.
fn rest(counts: &Counts, published: Duration) -> Option<Duration> {
    let rests = counts.rested == Some(counts.taken) && counts.seen_at > published;
    rests.then_some(counts.seen_at)
}

/// How far these are now, to count from; and the same as far as it holds for one moment.
pub(super) fn stand(
    ledger: &Ledger,
    look: &Look,
    subscriptions: &[&Endpoint],
    publishers: &[&Endpoint],
) -> Result<(Baseline, Option<Stand>), LedgerError> {
    let offered = || -> Result<BTreeMap<EndpointId, Offered>, LedgerError> {
        let of = |one: &&Endpoint| {
            let counts = ledger.counts(one.id)?;
            // Of a process that has ended nothing is under way.
            let rests = counts.published == counts.offered || !look.running.contains(&one.process);
            Ok((one.id, (counts.offered, counts.seen_at, rests)))
        };
        publishers.iter().map(of).collect()
    };
    let before = offered()?;
    let last = before.values().map(|(_, returned, _)| *returned).max().unwrap_or_default();
    let mut taken = Vec::new();
    for one in subscriptions {
        let counts = ledger.counts(one.id)?;
        let there = publishers.iter().filter(|from| look.is_there(from));
        let offered = there.map(|from| (&from.qos, before.get(&from.id).map_or(0, |all| all.0)));
        let has_kept = counts.taken >= kept(&one.qos, offered);
        taken.push((one.id, counts.taken, rest(&counts, last).filter(|_| has_kept)));
    }
    let after = offered()?;
    let still = before == after
        && after.values().all(|(_, _, rests)| *rests)
        // Another publisher may be there that the look does not have.
        && ledger.listed() == look.listed;
    let stand = still.then(|| Stand {
        offered: after.values().map(|(offered, ..)| offered).sum(),
        taken: taken.iter().map(|(_, taken, rests)| (*taken, *rests)).collect(),
    });
    let baseline = Baseline {
        taken: taken.into_iter().map(|(id, taken, _)| (id, taken)).collect(),
        others: after.into_iter().map(|(id, (offered, ..))| (id, offered)).collect(),
        mixed: false,
        unmet: false,
    };
    Ok((baseline, stand))
}

#[cfg(test)]
mod tests {
    use bagpipe_ros2ledger::Reliability;

    use super::*;

    const MS: Duration = Duration::from_millis(1);

    #[test]
    fn a_queue_was_empty_only_if_nothing_was_taken_or_published_since() {
        let at = |published: u32, taken, rested| {
            let counts = Counts { taken, rested, seen_at: 8 * MS, ..Counts::default() };
            rest(&counts, published * MS)
        };
        assert_eq!(at(7, 3, Some(3)), Some(8 * MS));
        assert_eq!(at(0, 0, Some(0)), Some(8 * MS));
        // It may have come just behind that moment.
        assert_eq!(at(8, 3, Some(3)), None);
        assert_eq!(at(9, 3, Some(3)), None);
        assert_eq!(at(7, 4, Some(3)), None);
        assert_eq!(at(7, 0, None), None);
    }

    #[test]
    fn who_comes_late_is_given_what_its_queue_holds_of_what_is_kept() {
        let qos = |history, depth, durability| {
            let reliability = Reliability::Reliable;
            Qos { history, depth, reliability, durability }
        };
        let latched = |depth| qos(History::KeepLast, depth, Durability::TransientLocal);
        let volatile = qos(History::KeepLast, 100, Durability::Volatile);
        let all = qos(History::KeepAll, 0, Durability::TransientLocal);
        let of = |wanted: &Qos, from: &[(Qos, u64)]| {
            kept(wanted, from.iter().map(|(qos, offered)| (qos, *offered)))
        };
        assert_eq!(of(&latched(100), &[(latched(10), 7), (latched(10), 30)]), 17);
        assert_eq!(of(&latched(12), &[(latched(10), 7), (latched(10), 30)]), 12);
        assert_eq!(of(&all, &[(all, 1000), (latched(1), 3), (volatile, 50)]), 1001);
        assert_eq!(of(&volatile, &[(latched(10), 30)]), 0);
        assert_eq!(of(&all, &[]), 0);
    }

    /// Of one subscription, which was at rest so many milliseconds after a boot, if it was.
    fn stand(offered: u64, taken: u64, rests: Option<u64>) -> Stand {
        Stand { offered, taken: vec![(taken, rests.map(Duration::from_millis))] }
    }

    /// Whether nothing is left at the last of some looks.
    fn after(looks: &[Option<Stand>]) -> bool {
        let (now, mut backlog) = (Instant::now(), Backlog::default());
        looks.iter().fold(false, |_, stand| backlog.look(now, stand.clone()))
    }

    /// The same of three looks.
    fn after_three(looks: [(u64, u64, u64); 3]) -> bool {
        after(&looks.map(|(offered, taken, at)| Some(stand(offered, taken, Some(at)))))
    }

    #[test]
    fn who_has_taken_all_there_was_has_nothing_left() {
        assert!(after(&[Some(stand(0, 0, None))]));
        assert!(after(&[Some(stand(0, 9, None))]));
        assert!(after(&[Some(stand(7, 7, None))]));
        assert!(!after(&[Some(stand(7, 6, None))]));
        assert!(!after(&[None]));
    }

    #[test]
    fn who_came_late_has_nothing_left_after_three_moments_of_rest_with_nothing_lost_between() {
        assert!(after_three([(100, 3, 0), (100, 3, 100), (100, 3, 200)]));
        assert!(after_three([(100, 3, 0), (120, 23, 150), (130, 33, 250)]));
        assert!(!after_three([(100, 3, 0), (100, 3, 99), (100, 3, 199)]));
        assert!(!after_three([(100, 3, 0), (100, 3, 100), (100, 3, 199)]));
        // A node that has not looked since.
        assert!(!after_three([(100, 3, 0), (100, 3, 100), (100, 3, 100)]));
        // One was on its way, and has come; or one was lost, or is left.
        assert!(!after_three([(100, 3, 0), (100, 4, 100), (100, 4, 200)]));
        assert!(!after_three([(100, 3, 0), (101, 3, 100), (101, 3, 200)]));
        assert!(!after_three([(100, 3, 0), (100, 3, 100), (101, 3, 200)]));
        let rests = |at| Some(stand(100, 3, at));
        assert!(!after(&[rests(Some(0)), rests(Some(100)), rests(None)]));
        assert!(!after(&[rests(Some(0)), rests(Some(100)), None]));
        assert!(after(&[rests(Some(0)), None, rests(Some(100)), rests(None), rests(Some(200))]));
        // From where it came it counts again.
        let come = [0, 100, 200].map(|at| Some(stand(100, 4, Some(300 + at))));
        assert!(!after(&[&[rests(Some(0))], &come[..2]].concat()));
        assert!(after(&[&[rests(Some(0))], &come[..]].concat()));
    }

    #[test]
    fn more_than_was_published_comes_from_somebody_who_does_not_count() {
        assert!(!after(&[Some(stand(7, 8, None))]));
        assert!(after_three([(7, 8, 0), (7, 8, 100), (7, 8, 200)]));
    }

    #[test]
    fn each_of_several_subscriptions_counts() {
        let both = |first: (u64, Option<u64>), second: (u64, Option<u64>)| {
            let at = |(taken, at): (u64, Option<u64>)| (taken, at.map(Duration::from_millis));
            Some(Stand { offered: 9, taken: vec![at(first), at(second)] })
        };
        assert!(after(&[both((9, None), (9, Some(0)))]));
        assert!(!after(&[both((9, None), (8, Some(0)))]));
        let twice = [both((1, Some(0)), (2, Some(5))), both((1, Some(105)), (2, Some(110)))];
        let then = |third| after(&[&twice[..], &[third]].concat());
        assert!(then(both((1, Some(210)), (2, Some(210)))));
        // Each of them has to be as late.
        assert!(!then(both((1, Some(209)), (2, Some(300)))));
        assert!(!then(both((1, Some(210)), (3, Some(210)))));
        assert!(!then(both((1, Some(210)), (2, None))));
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
