//! Whether all that is published on a recorded topic has reached us: pure arithmetic over counts.

use std::collections::BTreeMap;

use bagpipe_ros2ledger::{Counts, EndpointId};

/// What is published on a topic beside what has been handed on. Publishers may have published before
/// they knew us. How much is never known exactly, only at the most: what is missing beyond it is
/// lost.
#[derive(Debug)]
pub(crate) struct Account<P = EndpointId> {
    /// Of each publisher, also of those that are gone.
    publishers: BTreeMap<P, Publisher>,
    /// At most so many messages were published before we were known, by all who know us by now.
    before: u64,
}

/// What one publisher has published.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Publishes {
    /// By calls that have returned: as many at least.
    published: u64,
    /// By all calls that have begun, whose messages may have come: no more than that.
    offered: u64,
}

impl Publishes {
    pub(crate) fn of(counts: &Counts) -> Publishes {
        Publishes { published: counts.published, offered: counts.offered }
    }

    /// So many, of which no call is under way.
    #[cfg(test)]
    pub(crate) fn returned(all: u64) -> Publishes {
        Publishes { published: all, offered: all }
    }
}

/// One publisher.
#[derive(Clone, Copy, Debug, Default)]
struct Publisher {
    publishes: Publishes,
    /// Looks at which all had found each other.
    met: u32,
}

/// Looks after which a publisher knows us: at the first we know it, and by the next it knows us.
const KNOWN: u32 = 2;

impl<P> Default for Account<P> {
    fn default() -> Self {
        Account { publishers: BTreeMap::new(), before: 0 }
    }
}

impl<P: Ord> Account<P> {
    /// Whether some of these may not know us yet.
    pub(crate) fn has_strangers(&self, mut publishers: impl Iterator<Item = P>) -> bool {
        publishers.any(|one| self.publishers.get(&one).is_none_or(|known| known.met < KNOWN))
    }

    /// Takes in how much each publisher has published by now, which was read after `handed`, what
    /// was handed to the sink; `met`: whether we and it know each other.
    pub(crate) fn look(
        &mut self,
        now: impl Iterator<Item = (P, Publishes)>,
        handed: u64,
        met: impl Fn(&P) -> bool,
    ) {
        for (id, publishes) in now {
            let met = met(&id);
            let one = self.publishers.entry(id).or_default();
            let published = one.publishes.published.max(publishes.published);
            one.publishes = Publishes { published, ..publishes };
            if met && one.met < KNOWN {
                one.met += 1;
                self.before += if one.met == KNOWN { publishes.offered } else { 0 };
            }
        }
        // Whatever was missing at some moment includes what came too early for us. A message that
        // has come before its publisher's call returned was not missing.
        self.before = self.before.min(self.offered().saturating_sub(handed));
    }

    /// What all have begun to publish.
    pub(crate) fn offered(&self) -> u64 {
        self.publishers.values().map(|one| one.publishes.offered).sum()
    }

    /// Whether a call that publishes had begun and not returned at the last look.
    pub(crate) fn is_under_way(&self) -> bool {
        let mut each = self.publishers.values().map(|one| one.publishes);
        each.any(|one| one.offered > one.published)
    }

    /// How many must have been handed on at least, once all that is published by now has come.
    pub(crate) fn due(&self) -> u64 {
        let known = self.publishers.values().filter(|one| one.met >= KNOWN);
        known.map(|one| one.publishes.published).sum::<u64>().saturating_sub(self.before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of publishers of which no call is under way.
    fn publishes<const N: usize>(now: [(u32, u64); N]) -> impl Iterator<Item = (u32, Publishes)> {
        now.into_iter().map(|(id, all)| (id, Publishes::returned(all)))
    }

    /// An account after looks at one publisher that knows us, each with what was published and handed.
    fn after(looks: &[(u64, u64)]) -> Account<u32> {
        let mut account = Account::default();
        for (published, handed) in looks {
            account.look(publishes([(1, *published)]), *handed, |_| true);
        }
        account
    }

    #[test]
    fn what_was_published_before_we_were_known_is_not_due() {
        assert_eq!(after(&[(7, 2)]).due(), 0);
        assert_eq!(after(&[(7, 2), (8, 2)]).due(), 2);
        assert_eq!(after(&[(7, 2), (8, 2), (11, 4)]).due(), 5);
        // Ones on their way for a while stay due.
        assert_eq!(after(&[(7, 2), (8, 2), (12, 4), (12, 4)]).due(), 6);
    }

    #[test]
    fn a_call_is_under_way_until_it_has_returned() {
        let mut account = Account::<u32>::default();
        for (published, offered, is) in [(0, 0, false), (3, 4, true), (4, 4, false)] {
            account.look(std::iter::once((1, Publishes { published, offered })), 0, |_| true);
            assert_eq!(account.is_under_way(), is);
        }
    }

    #[test]
    fn more_than_was_published_lacks_nothing() {
        assert_eq!(after(&[(3, 5), (3, 5), (4, 5)]).due(), 4);
    }

    #[test]
    fn who_never_rests_is_compared_too() {
        // A hundred between two looks, ten of them on their way; then twenty are lost.
        let looks = [(500, 0), (600, 60), (700, 160), (800, 265), (900, 350)];
        assert_eq!(after(&looks).due(), 900 - (800 - 265));
    }

    #[test]
    fn a_pause_on_the_way_is_not_taken_for_an_early_message() {
        let mut account = after(&[(0, 0), (10, 7), (10, 7), (10, 10)]);
        assert_eq!(account.due(), 10);
        account.look(publishes([(1, 20)]), 17, |_| true);
        assert_eq!(account.due(), 20);
    }

    #[test]
    fn another_publisher_hides_no_loss_of_the_first() {
        let mut account = after(&[(0, 0), (0, 0), (100, 90)]);
        let both = |second: u64| publishes([(1, 100), (2, second)]);
        // The second has published five that nobody had a chance to get.
        account.look(both(5), 90, |_| true);
        assert_eq!((account.offered(), account.due()), (105, 100));
        account.look(both(5), 90, |_| true);
        assert_eq!(account.due(), 100);
        account.look(both(8), 93, |_| true);
        assert_eq!(account.due(), 103);
        // Nor does one that took its slot.
        account.look(publishes([(3, 1)]), 93, |_| true);
        assert_eq!((account.offered(), account.due()), (109, 103));
    }

    #[test]
    fn who_does_not_know_us_yet_owes_nothing() {
        let mut account = Account::<u32>::default();
        for published in [5, 6, 7] {
            assert!(account.has_strangers([1].into_iter()));
            account.look(publishes([(1, published)]), 0, |_| false);
        }
        assert_eq!(account.due(), 0);
        account.look(publishes([(1, 8)]), 0, |_| true);
        account.look(publishes([(1, 9)]), 1, |_| true);
        assert_eq!((account.due(), account.has_strangers([1].into_iter())), (1, false));
    }
    #[test]
    fn a_message_that_comes_before_its_call_has_returned_is_no_early_one() {
        let mut account = after(&[(7, 0), (7, 0)]);
        assert_eq!(account.due(), 0);
        // The eighth is here, and not yet counted as published.
        let under_way = Publishes { published: 7, offered: 8 };
        account.look([(1, under_way)].into_iter(), 1, |_| true);
        assert_eq!(account.due(), 0);
        account.look(publishes([(1, 8)]), 1, |_| true);
        assert_eq!(account.due(), 1);
        // One that the middleware did not take after all.
        let refused = Publishes { published: 8, offered: 9 };
        account.look([(1, refused)].into_iter(), 1, |_| true);
        account.look(publishes([(1, 8)]), 1, |_| true);
        assert_eq!((account.due(), account.offered()), (1, 8));
    }
}
