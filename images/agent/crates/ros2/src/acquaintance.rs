//! Whether the stack's publishers of a recorded topic know us: what they publish before never comes.
//! Fast DDS was measured to take up to 0.24 s longer than we to know them.

use std::collections::BTreeMap;
use std::time::Instant;

use bagpipe_ros2ledger::EndpointId;

use crate::unreported::Unreported;

/// The publishers of one topic.
#[derive(Debug)]
pub(crate) struct Acquaintance<P = EndpointId> {
    /// `None` of one that has reported.
    publishers: BTreeMap<P, Option<Unreported>>,
    /// Of those that were there at the last look.
    strangers: Option<usize>,
}

impl<P> Default for Acquaintance<P> {
    fn default() -> Self {
        Acquaintance { publishers: BTreeMap::new(), strangers: None }
    }
}

impl<P: Ord> Acquaintance<P> {
    /// Takes in who is there, each with how many subscriptions it knows as far as it reports, and how many of the stack's
    /// it can match. Nodes report until the play has begun, and once is enough.
    pub(crate) fn look(
        &mut self,
        now: Instant,
        there: impl Iterator<Item = (P, Option<u32>, usize)>,
    ) {
        let is_stranger = |(publisher, matched, subscribed): (P, Option<u32>, usize)| {
            let begin = || Some(Unreported::begin(now));
            let one = self.publishers.entry(publisher).or_insert_with(begin);
            if matched.is_some_and(|known| known as usize > subscribed) {
                *one = None;
            }
            one.as_mut().is_some_and(|one| {
                one.look(now);
                !one.is_believed()
            })
        };
        self.strangers = Some(there.map(is_stranger).filter(|stranger| *stranger).count());
    }

    /// How many of `matched` publishers know us for certain, or are believed to.
    pub(crate) fn among(&self, matched: u64) -> usize {
        let Some(strangers) = self.strangers else { return 0 };
        usize::try_from(matched).unwrap_or(usize::MAX).saturating_sub(strangers)
    }

    /// Whether a publisher has reported that it knows us.
    pub(crate) fn has_reported(&self, publisher: P) -> bool {
        self.publishers.get(&publisher).is_some_and(Option::is_none)
    }

    /// Whether all that were there know us.
    pub(crate) fn is_whole(&self) -> bool {
        self.strangers == Some(0)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn look(of: &mut Acquaintance<u32>, now: Instant, there: &[(u32, Option<u32>)]) -> usize {
        of.look(now, there.iter().map(|(one, matched)| (*one, *matched, 1)));
        of.strangers.unwrap()
    }

    #[test]
    fn nobody_is_known_before_a_look() {
        assert_eq!(Acquaintance::<u32>::default().among(7), 0);
        assert!(!Acquaintance::<u32>::default().is_whole());
    }

    #[test]
    fn who_knows_more_than_the_stacks_subscriptions_knows_us_from_then_on() {
        let (mut all, begun) = (Acquaintance::default(), Instant::now());
        assert_eq!(look(&mut all, begun, &[(1, Some(1)), (2, Some(2)), (3, None)]), 2);
        assert_eq!(all.among(3), 1);
        assert_eq!(look(&mut all, begun, &[(1, Some(2)), (2, Some(2)), (3, Some(2))]), 0);
        assert!(all.is_whole());
        // The play has begun, and nobody reports any more.
        assert_eq!(look(&mut all, begun, &[(1, None), (2, None), (3, None)]), 0);
        assert_eq!(look(&mut all, begun, &[(1, None), (4, None)]), 1);
        assert_eq!(all.among(0), 0);
    }

    #[test]
    fn who_never_reports_is_believed_after_a_while() {
        let (mut all, begun) = (Acquaintance::default(), Instant::now());
        let after = |tenths: u32| begun + Duration::from_millis(100) * tenths;
        assert_eq!(look(&mut all, begun, &[(1, None), (2, Some(0))]), 2);
        for tenths in 1..20 {
            assert_eq!(look(&mut all, after(tenths), &[(1, None), (2, Some(0))]), 2);
        }
        assert_eq!(look(&mut all, after(20), &[(1, None), (2, Some(0)), (3, None)]), 1);
    }
}
