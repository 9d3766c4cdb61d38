//! Whether all that is published on a recorded topic has reached us, of all its publishers together and of each: who
//! does not count, and publishes the same topic, makes up for nothing that another loses.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_ros2ledger::{Endpoint, EndpointId};

use crate::account::{Account, Publishes};
use crate::handed::{Gid, Handed};

/// The accounts of one topic.
#[derive(Debug)]
pub(crate) struct Accounts<P = EndpointId> {
    all: Account<P>,
    /// Of those that the ledger has by their GIDs, with their nodes' names. A GID has several entries of the ledger
    /// where a process goes on with what its parent made.
    of: BTreeMap<Gid, (String, Account<P>)>,
}

impl<P> Default for Accounts<P> {
    fn default() -> Self {
        Accounts { all: Account::default(), of: BTreeMap::new() }
    }
}

/// What one publishes, by its entry in the ledger.
pub(crate) struct Publishing<'e, P = EndpointId> {
    pub(crate) id: P,
    pub(crate) node: &'e str,
    pub(crate) gid: Option<Gid>,
    pub(crate) publishes: Publishes,
}

impl<'e> Publishing<'e> {
    pub(crate) fn of(one: &'e Endpoint) -> Publishing<'e> {
        let publishes = Publishes::of(&one.counts);
        Publishing { id: one.id, node: &one.node, gid: one.gid, publishes }
    }
}

/// How many must have been handed on at least.
#[derive(Debug, Default)]
pub(crate) struct Due {
    all: u64,
    of: Vec<DueOf>,
}

#[derive(Debug)]
struct DueOf {
    gid: Gid,
    node: String,
    due: u64,
    offered: u64,
}

impl<P: Copy + Ord> Accounts<P> {
    /// Whether some of these may not know us yet.
    pub(crate) fn has_strangers(&self, publishers: impl Iterator<Item = P>) -> bool {
        self.all.has_strangers(publishers)
    }

    /// Takes in how much each publisher has published by now, which was read after `handed`, and which of them have
    /// `met` us.
    pub(crate) fn look(&mut self, now: &[Publishing<'_, P>], handed: &Handed, met: &BTreeSet<P>) {
        let each = now.iter().map(|one| (one.id, one.publishes));
        self.all.look(each, handed.all, |one| met.contains(one));
        // Once through all: a node may have made thousands, of which each look has those that are gone, too.
        let mut by_gid: BTreeMap<Gid, Vec<&Publishing<'_, P>>> = BTreeMap::new();
        for one in now {
            if let Some(gid) = one.gid {
                by_gid.entry(gid).or_default().push(one);
            }
        }
        for (gid, ones) in by_gid {
            let node = || ones.first().map(|one| one.node.to_owned()).unwrap_or_default();
            let (_, account) = self.of.entry(gid).or_insert_with(|| (node(), Account::default()));
            let each = ones.iter().map(|one| (one.id, one.publishes));
            account.look(each, handed.of(&gid), |one| met.contains(one));
        }
    }

    /// What all have begun to publish.
    pub(crate) fn offered(&self) -> u64 {
        self.all.offered()
    }

    /// Whether a call that publishes had begun and not returned at the last look.
    pub(crate) fn is_under_way(&self) -> bool {
        self.all.is_under_way()
    }

    /// How many must have been handed on at least, once all that is published by now has come.
    pub(crate) fn due(&self) -> Due {
        let of = self.of.iter().map(|(gid, (node, account))| DueOf {
            gid: *gid,
            node: node.clone(),
            due: account.due(),
            offered: account.offered(),
        });
        Due { all: self.all.due(), of: of.collect() }
    }
}

impl Due {
    /// So many of all publishers together.
    #[cfg(test)]
    pub(crate) fn of_all(all: u64) -> Due {
        Due { all, of: Vec::new() }
    }

    /// How many lack, by what was `handed` to the sink: of all together, or of each by itself, which are more where
    /// others publish that do not count. A message whose publisher is not known may be anybody's.
    pub(crate) fn missing(&self, handed: &Handed) -> u64 {
        self.all.saturating_sub(handed.all).max(self.missing_of_each(handed))
    }

    fn missing_of_each(&self, handed: &Handed) -> u64 {
        let lacks = |one: &DueOf| one.due.saturating_sub(handed.of(&one.gid));
        self.of.iter().map(lacks).sum::<u64>().saturating_sub(handed.of_nobody())
    }

    /// That some of a topic's messages lack, of which `published` were published; `None` where none lacks.
    pub(crate) fn lacking(&self, topic: &str, handed: &Handed, published: u64) -> Option<String> {
        let missing = self.missing(handed);
        if missing == 0 {
            return None;
        }
        let sentence = format!("{missing} messages of {topic} did not reach the recorder");
        if missing == self.all.saturating_sub(handed.all) {
            return Some(format!("{sentence}, which has {} of {published} published", handed.all));
        }
        let lacks = self.of.iter().filter(|one| one.due > handed.of(&one.gid));
        let of = |one: &DueOf| {
            format!("of {} it has {} of {}", one.node, handed.of(&one.gid), one.offered)
        };
        let each: Vec<String> = lacks.map(of).collect();
        let each = each.join(", ");
        Some(format!("{sentence}: {each}, and what others publish stands for none of them"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Option<Gid> = Some([1; 16]);
    const B: Option<Gid> = Some([2; 16]);

    /// What one has published by calls that have returned.
    fn publishing(id: usize, gid: Option<Gid>, published: u64) -> Publishing<'static, usize> {
        let publishes = Publishes::returned(published);
        Publishing { id, node: ["/a", "/b"][id], gid, publishes }
    }

    /// So many messages of each publisher.
    fn handed(of: &[(Option<Gid>, u64)]) -> Handed {
        let known = of.iter().filter_map(|(gid, many)| Some((gid.as_ref().copied()?, *many)));
        Handed::new(of.iter().map(|(_, many)| many).sum(), known.collect())
    }

    /// What is due after these have met us with nothing published, and have published so many.
    fn due(published: &[(Option<Gid>, u64)]) -> Due {
        let mut accounts = Accounts::default();
        let met = (0..2).collect();
        let now = |share: u64| -> Vec<_> {
            (0..).zip(published).map(|(at, (gid, all))| publishing(at, *gid, all * share)).collect()
        };
        for share in [0, 0, 1] {
            accounts.look(&now(share), &Handed::default(), &met);
        }
        accounts.due()
    }

    #[test]
    fn what_another_publishes_stands_for_nothing_that_one_loses() {
        let due = due(&[(A, 10), (B, 5)]);
        assert_eq!(due.missing(&handed(&[(A, 10), (B, 5)])), 0);
        assert_eq!(due.missing(&handed(&[(A, 7), (B, 5), (Some([9; 16]), 100)])), 3);
        // More of one than it has published, which can't be, stands for none of the other's.
        assert_eq!(due.missing(&handed(&[(A, 13), (B, 2)])), 3);
        assert_eq!(due.missing(&Handed::default()), 15);
    }

    #[test]
    fn what_is_of_nobody_known_may_be_anybody_s() {
        let due = due(&[(A, 10), (B, 5)]);
        assert_eq!(due.missing(&handed(&[(A, 7), (B, 4), (None, 4)])), 0);
        assert_eq!(due.missing(&handed(&[(A, 7), (B, 4), (None, 3)])), 1);
        assert_eq!(due.missing(&handed(&[(None, 14)])), 1);
    }

    #[test]
    fn one_whose_gid_is_not_known_is_in_the_account_of_all() {
        let due = due(&[(A, 10), (None, 5)]);
        assert_eq!(due.missing(&handed(&[(A, 10), (B, 4)])), 1);
        assert_eq!(due.missing(&handed(&[(A, 9), (B, 6)])), 1);
        assert_eq!(due.missing(&handed(&[(A, 10), (B, 6)])), 0);
    }

    #[test]
    fn several_entries_of_one_gid_have_an_account() {
        let due = due(&[(A, 3), (A, 4)]);
        assert_eq!(due.missing(&handed(&[(A, 7)])), 0);
        assert_eq!(due.missing(&handed(&[(A, 6), (B, 5)])), 1);
    }

    #[test]
    fn whose_messages_lack_is_named_where_others_publish() {
        let due = due(&[(A, 10), (B, 5)]);
        assert_eq!(due.lacking("/t", &handed(&[(A, 10), (B, 5)]), 15), None);
        assert_eq!(
            due.lacking("/t", &handed(&[(A, 9), (B, 4)]), 15).unwrap(),
            "2 messages of /t did not reach the recorder, which has 13 of 15 published"
        );
        assert_eq!(
            due.lacking("/t", &handed(&[(A, 9), (B, 5), (Some([9; 16]), 4)]), 15).unwrap(),
            "1 messages of /t did not reach the recorder: of /a it has 9 of 10, and what others publish stands \
             for none of them"
        );
    }
}
