//! Recorded topics that somebody publishes who does not count and whom no name shows, as one of several types: which
//! one can't be known, so that the recorder can't subscribe, and nothing else accounts for what is published.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use crate::unnamed::Unnamed;

/// By topic.
#[derive(Default)]
pub(crate) struct Untyped(Mutex<BTreeMap<String, Seen>>);

#[derive(Default)]
struct Seen {
    publishers: Unnamed,
    types: Vec<String>,
}

impl Untyped {
    /// What was seen before the play matters no more.
    pub(crate) fn begin(&self) {
        self.all().clear();
    }

    /// Takes in a look at a topic that has several `types`, with how many publishers more than those that count.
    pub(crate) fn look(&self, topic: &str, now: Instant, more: u64, types: Vec<String>) {
        let mut all = self.all();
        let seen = all.entry(topic.to_owned()).or_default();
        seen.publishers.look(now, || more);
        if more > 0 {
            seen.types = types;
        }
    }

    /// What is missing in the recording, as sentences.
    pub(crate) fn lacking(&self) -> Vec<String> {
        let all = self.all();
        let there = all.iter().filter(|(_, seen)| seen.publishers.seen() > 0);
        there.map(|(topic, seen)| sentence(topic, seen)).collect()
    }

    fn all(&self) -> MutexGuard<'_, BTreeMap<String, Seen>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn sentence(topic: &str, seen: &Seen) -> String {
    format!(
        "{topic} was not recorded, and has publishers (at least {}) that do not count: the graph has it as {}, and \
         does not show which of them is theirs, as of a node whose name another has, or of a program that is no \
         node. Give each node a name of its own, and the topic one type",
        seen.publishers.seen(),
        seen.types.join(" and as ")
    )
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    /// Looks that are 200 ms apart, each with so many publishers more.
    fn after(looks: &[u64]) -> Untyped {
        let (untyped, begun) = (Untyped::default(), Instant::now());
        for (at, more) in (0..).zip(looks) {
            let types = vec!["a/msg/A".to_owned(), "b/msg/B".to_owned()];
            untyped.look("/talk", begun + Duration::from_millis(at * 200), *more, types);
        }
        untyped
    }

    #[test]
    fn who_is_there_at_three_looks_in_a_row_is_missed() {
        assert_eq!(after(&[1, 1, 0, 1, 1]).lacking(), <[String; 0]>::default());
        let [lacking] = &after(&[2, 1, 1, 0]).lacking()[..] else { panic!("none") };
        let begin = "/talk was not recorded, and has publishers (at least 1) that do not count: the \
                     graph has it as a/msg/A and as b/msg/B,";
        assert!(lacking.starts_with(begin), "{lacking}");
    }

    #[test]
    fn what_was_there_before_the_play_is_missed_by_nobody() {
        let untyped = after(&[1, 1, 1]);
        untyped.begin();
        assert_eq!(untyped.lacking(), <[String; 0]>::default());
    }
}
