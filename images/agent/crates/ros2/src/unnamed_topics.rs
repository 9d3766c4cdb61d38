//! Topics that a pattern asks for and that no name of a node leads to. Of a program that is no node the types need not
//! be installed where the player is: then such a topic is not recorded, which is no fault of the stack's.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Those of a case.
#[derive(Default)]
pub(crate) struct UnnamedTopics(Mutex<Topics>);

#[derive(Default)]
struct Topics {
    /// Those that were found, and why each can't be recorded, if that is so.
    found: BTreeMap<String, Option<String>>,
    /// Those that were asked for and not found here: by their own names, or as a node's.
    named: BTreeSet<String>,
}

impl UnnamedTopics {
    /// Takes in one that was found; whether it may be asked for.
    pub(crate) fn add(&self, topic: &str) -> bool {
        self.topics().found.entry(topic.to_owned()).or_default().is_none()
    }

    /// Takes in that a topic is asked for. One that was not found before is so for another reason than being found.
    pub(crate) fn ask(&self, topic: &str) {
        let mut topics = self.topics();
        if !topics.found.contains_key(topic) {
            topics.named.insert(topic.to_owned());
        }
    }

    /// Takes in that a topic can't be recorded; false if it is none of these, or was asked for without being found.
    pub(crate) fn refuse(&self, topic: &str, why: &str) -> bool {
        let mut topics = self.topics();
        if topics.named.contains(topic) {
            return false;
        }
        let found = topics.found.get_mut(topic);
        found.map(|refused| *refused = Some(why.to_owned())).is_some()
    }

    /// What is not recorded, as sentences.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let topics = self.topics();
        let refused = topics.found.iter().filter_map(|(topic, why)| Some((topic, why.as_ref()?)));
        let sentence = |(topic, why)| {
            format!("{topic}, which programs publish that are no nodes, was not recorded: {why}")
        };
        refused.map(sentence).collect()
    }

    fn topics(&self) -> MutexGuard<'_, Topics> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_refused_is_asked_for_no_more_and_named() {
        let unnamed = UnnamedTopics::default();
        assert!(unnamed.add("/a") && unnamed.add("/b") && unnamed.add("/a"));
        assert!(!unnamed.refuse("/named", "no type"));
        assert_eq!(unnamed.remarks(), <[String; 0]>::default());
        assert!(unnamed.refuse("/a", "no type"));
        assert!(!unnamed.add("/a") && unnamed.add("/b"));
        let expected = "/a, which programs publish that are no nodes, was not recorded: no type";
        assert_eq!(unnamed.remarks(), [expected]);
    }

    #[test]
    fn what_was_asked_for_by_its_name_is_not_refused_though_a_pattern_finds_it_too() {
        let unnamed = UnnamedTopics::default();
        unnamed.ask("/odd");
        assert!(unnamed.add("/odd") && unnamed.add("/found"));
        ["/odd", "/found"].into_iter().for_each(|topic| unnamed.ask(topic));
        assert!(!unnamed.refuse("/odd", "no type") && unnamed.refuse("/found", "no type"));
        let expected =
            "/found, which programs publish that are no nodes, was not recorded: no type";
        assert_eq!(unnamed.remarks(), [expected]);
    }
}
