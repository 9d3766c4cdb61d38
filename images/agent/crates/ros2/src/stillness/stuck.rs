//! Whose callback was not over in the time that one is waited for.

use std::collections::{BTreeMap, BTreeSet};

/// How often a callback is waited for that is not over in time: each time may last as long as a drain.
const AGAIN: u32 = 3;

/// Node and topic.
pub(super) type Whose = (String, String);

/// Those whose callback was waited for in vain. Of timers and services the node is not known: in its place is nothing,
/// and in the topic's the process with how many run, of which one more is waited for.
#[derive(Default)]
pub(super) struct Stuck {
    /// Whose callback runs still: it is not waited for again.
    pub(super) now: BTreeSet<Whose>,
    /// How often each was.
    pub(super) ever: BTreeMap<Whose, u32>,
}

impl Stuck {
    /// Takes in whose callback was waited for in vain.
    pub(super) fn add(&mut self, those: &BTreeSet<Whose>) {
        for one in those.difference(&self.now) {
            *self.ever.entry(one.clone()).or_default() += 1;
        }
        self.now.extend(those.iter().cloned());
    }

    /// Takes in who is `busy`: who is not has come to its end after all, also if it may lack something, and is
    /// waited for again, some times. Of timers one less is no end of the one that was late.
    pub(super) fn look(&mut self, busy: &BTreeSet<Whose>) {
        self.wait_again_for(|one| !one.0.is_empty() && !busy.contains(one));
    }

    /// Takes in that nobody has work: timers and services have come to their end, too. As long as one is not waited
    /// for, nothing that wakes a thread of its process is.
    pub(super) fn rest(&mut self) {
        self.wait_again_for(|_| true);
    }

    fn wait_again_for(&mut self, has_ended: impl Fn(&Whose) -> bool) {
        let Stuck { now, ever } = self;
        now.retain(|one| ever.get(one).is_some_and(|times| *times >= AGAIN) || !has_ended(one));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whose(node: &str) -> Whose {
        (node.to_owned(), "/topic".to_owned())
    }

    #[test]
    fn who_comes_to_its_end_late_is_waited_for_again_three_times_and_stays_named() {
        let (mut stuck, all) = (Stuck::default(), BTreeSet::from([whose("/node")]));
        for times in 1..=3 {
            stuck.look(&all);
            assert!(stuck.now.is_empty(), "{times}");
            stuck.add(&all);
            // It runs still.
            stuck.look(&all);
            stuck.add(&all);
            assert_eq!((&stuck.now, stuck.ever[&whose("/node")]), (&all, times));
            stuck.look(&BTreeSet::new());
        }
        assert_eq!(stuck.now, all);
        // How many timers run is in the name: one less is no end of one.
        let timers = BTreeSet::from([(String::new(), "process 7, of 2 timers".to_owned())]);
        let mut stuck = Stuck::default();
        for _ in 1..AGAIN {
            stuck.add(&timers);
            stuck.look(&BTreeSet::new());
            assert_eq!(stuck.now, timers);
            // Nobody has work: they are over.
            stuck.rest();
            assert!(stuck.now.is_empty());
        }
        stuck.add(&timers);
        stuck.rest();
        assert_eq!(stuck.now, timers);
    }
}
