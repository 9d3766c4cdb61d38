//! Whether all that is published on a recorded topic has reached us: pure arithmetic over counts.

use std::collections::BTreeSet;

use bagpipe_ros2ledger::EndpointId;

/// What is published on a topic beside what has been handed on. Publishers may have published before
/// they knew us: how much, is known once nothing changes between two looks, and holds for as long as
/// the publishers are the same.
#[derive(Debug, Default)]
pub(crate) struct Account {
    publishers: BTreeSet<EndpointId>,
    last: Option<Counts>,
    before: Option<u64>,
}

/// Messages at a moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Counts {
    /// Published by all publishers that count.
    pub(crate) published: u64,
    /// Handed to the sink.
    pub(crate) handed: u64,
}

impl Account {
    /// Takes in who publishes and how much by now. Nothing is learned while something changes.
    pub(crate) fn look(&mut self, publishers: BTreeSet<EndpointId>, now: Counts) {
        if publishers != self.publishers {
            *self = Account { publishers, last: Some(now), before: None };
            return;
        }
        if self.before.is_none() && self.last == Some(now) {
            self.before = Some(now.published.saturating_sub(now.handed));
        }
        self.last = Some(now);
    }

    /// How many must have been handed on once all that is published by now has come; `None` while
    /// it can't be known.
    pub(crate) fn due(&self, published: u64) -> Option<u64> {
        self.before.map(|before| published.saturating_sub(before))
    }

    /// What is published and has not come; `None` while it can't be known.
    pub(crate) fn lacking(&self, now: Counts) -> Option<u64> {
        self.due(now.published).map(|due| due.saturating_sub(now.handed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(published: u64, handed: u64) -> Counts {
        Counts { published, handed }
    }

    #[test]
    fn what_was_published_before_we_were_known_is_not_lacking() {
        let mut account = Account::default();
        account.look(BTreeSet::new(), at(7, 2));
        assert_eq!(account.lacking(at(7, 2)), None);
        account.look(BTreeSet::new(), at(8, 2));
        assert_eq!(account.lacking(at(8, 2)), None);
        account.look(BTreeSet::new(), at(8, 2));
        assert_eq!((account.due(8), account.lacking(at(8, 2))), (Some(2), Some(0)));
        assert_eq!((account.due(11), account.lacking(at(11, 4))), (Some(5), Some(1)));
        // Once it is known it stays, also if messages are on their way for a while.
        account.look(BTreeSet::new(), at(12, 4));
        account.look(BTreeSet::new(), at(12, 4));
        assert_eq!(account.lacking(at(12, 4)), Some(2));
    }

    #[test]
    fn more_than_was_published_lacks_nothing() {
        let mut account = Account::default();
        account.look(BTreeSet::new(), at(3, 5));
        account.look(BTreeSet::new(), at(3, 5));
        assert_eq!(account.lacking(at(4, 5)), Some(0));
    }
}
