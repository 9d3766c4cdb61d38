//! Topics that a pattern asks for and that no name of a node leads to. Of a program that is no node the types need not
//! be installed where the player is: then such a topic is not recorded, which is no fault of the stack's.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// By topic, why it can't be recorded, if that is so.
#[derive(Default)]
pub(crate) struct UnnamedTopics(Mutex<BTreeMap<String, Option<String>>>);

impl UnnamedTopics {
    /// Takes in one that was found; whether it may be asked for.
    pub(crate) fn add(&self, topic: &str) -> bool {
        self.all().entry(topic.to_owned()).or_default().is_none()
    }

    /// Takes in that a topic can't be recorded; false if it is none of these.
    pub(crate) fn refuse(&self, topic: &str, why: &str) -> bool {
        let mut all = self.all();
        let found = all.get_mut(topic);
        found.map(|refused| *refused = Some(why.to_owned())).is_some()
    }

    /// What is not recorded, as sentences.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let all = self.all();
        let refused = all.iter().filter_map(|(topic, why)| Some((topic, why.as_ref()?)));
        let sentence = |(topic, why)| {
            format!("{topic}, which programs publish that are no nodes, was not recorded: {why}")
        };
        refused.map(sentence).collect()
    }

    fn all(&self) -> MutexGuard<'_, BTreeMap<String, Option<String>>> {
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
}
