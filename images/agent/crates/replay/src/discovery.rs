//! Which topics are to be recorded, and which nodes are in the graph, as the master reports it.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bagpipe_graph::{GraphError, Node, Publication, Seen, SystemState};
use regex::Regex;

use crate::ReplayError;
use crate::lockstep::Lockstep;
use crate::names::resolved;
use crate::recorder::Recorder;
use crate::time::Time;

/// The time between two looks at our own connections.
pub(crate) const LOOK: Duration = Duration::from_millis(10);
/// How long the master may not answer: one that is restarted needs a second or two.
const GONE: Duration = Duration::from_secs(5);

/// Which topics to record, and the search for them.
pub(crate) struct Discovery<'a> {
    pub(crate) node: &'a dyn Node,
    patterns: Vec<Regex>,
    /// Topics whose publishers must be there before the play begins.
    pub(crate) expected: Vec<String>,
    master: Mutex<MasterSeen>,
    time: &'a Time,
}

/// How the master was found.
#[derive(Default)]
struct MasterSeen {
    /// Since when it has not answered.
    silent: Option<Instant>,
    /// Registrations that it had lost and that were made again.
    again: u64,
}

impl<'a> Discovery<'a> {
    /// Subscribes to the plain names at once; the patterns need [`Discovery::look`].
    pub(crate) fn start(
        node: &'a dyn Node,
        record: &[String],
        time: &'a Time,
    ) -> Result<Discovery<'a>, ReplayError> {
        let mut patterns = Vec::new();
        for text in record {
            if is_plain(text) {
                node.subscribe(&resolved(text)).map_err(ReplayError::GraphFailed)?;
            } else {
                patterns.push(whole(text)?);
            }
        }
        Ok(Discovery { node, patterns, expected: Vec::new(), master: Mutex::default(), time })
    }

    /// Subscribes to the answers of a lock-step play, which need not be recorded, and expects
    /// those that it can't do without.
    pub(crate) fn listen_for(
        &mut self,
        lockstep: &Lockstep,
        recorder: &Recorder,
    ) -> Result<(), ReplayError> {
        for answer in lockstep.answers() {
            let named = self.node.subscribed_topics().iter().any(|topic| topic == answer);
            if !named && !self.patterns.iter().any(|pattern| pattern.is_match(answer)) {
                recorder.only_listen_to(answer);
            }
            self.node.subscribe(answer).map_err(ReplayError::GraphFailed)?;
        }
        self.expected = lockstep.required().map(str::to_owned).collect();
        Ok(())
    }

    /// Expected topics that nobody publishes yet.
    pub(crate) fn unanswered(&self) -> Vec<&str> {
        let expected = self.expected.iter().map(String::as_str);
        expected.filter(|topic| self.node.publishers_of(topic) == 0).collect()
    }

    /// Registers again what the master has forgotten, and subscribes to what others publish
    /// and a pattern matches; answers the graph's state.
    ///
    /// # Errors
    /// The master has failed for a while; a passing failure answers `None`.
    pub(crate) fn look(&self) -> Result<Option<SystemState>, ReplayError> {
        let looked = self.node.look().and_then(|seen| {
            self.subscribe_to_matches(&seen.state)?;
            Ok(seen)
        });
        let mut master = self.master.lock().unwrap_or_else(|e| e.into_inner());
        match looked {
            Ok(Seen { state, again }) => {
                *master = MasterSeen { silent: None, again: master.again + again };
                Ok(Some(state))
            }
            Err(error) => {
                let now = self.time.now();
                let since = *master.silent.get_or_insert(now);
                if now.duration_since(since) >= GONE {
                    return Err(ReplayError::GraphFailed(error));
                }
                Ok(None)
            }
        }
    }

    /// The nodes of the graph but ours, as the master knows them now.
    pub(crate) fn others(&self) -> Result<BTreeSet<String>, ReplayError> {
        let state = self.look()?.unwrap_or_default();
        let lists = state.publishers.values().chain(state.subscribers.values());
        let others = lists.flatten().filter(|node| *node != self.node.name());
        Ok(others.cloned().collect())
    }

    /// A warning for the user if the master was restarted.
    pub(crate) fn restarted(&self) -> Option<String> {
        let again = self.master.lock().unwrap_or_else(|e| e.into_inner()).again;
        (again > 0).then(|| self.node.restarted(again))
    }

    fn subscribe_to_matches(&self, state: &SystemState) -> Result<(), GraphError> {
        if self.patterns.is_empty() {
            return Ok(());
        }
        let of_others = state
            .publishers
            .iter()
            .filter(|(_, all)| all.iter().any(|one| one != self.node.name()));
        let named = of_others.map(|(topic, _)| topic.clone());
        for topic in named.chain(self.node.unnamed_topics(state)?) {
            if self.patterns.iter().any(|pattern| pattern.is_match(&topic)) {
                self.node.subscribe(&topic)?;
            }
        }
        Ok(())
    }

    /// Whether every publisher of a recorded topic that the master knows is connected.
    pub(crate) fn has_every_publisher(&self, state: &SystemState) -> bool {
        self.node.subscribed_topics().iter().all(|topic| {
            let others = others(state.publishers.get(topic), self.node.name()).count();
            self.node.publishers_of(topic) >= others
        })
    }
}

pub(crate) fn open_subscribers(publication: &Arc<dyn Publication>) -> BTreeSet<String> {
    let links = publication.subscribers().into_iter().filter(|link| link.open);
    links.map(|link| link.node).collect()
}

/// Of these nodes all but ourselves.
pub(crate) fn others<'n>(
    nodes: Option<&'n Vec<String>>,
    ourselves: &'n str,
) -> impl Iterator<Item = &'n String> {
    nodes.into_iter().flatten().filter(move |node| *node != ourselves)
}

/// Whether a pattern is just a topic's name.
fn is_plain(pattern: &str) -> bool {
    pattern.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'/')
}

/// A pattern that must match a whole name.
pub(crate) fn whole(pattern: &str) -> Result<Regex, ReplayError> {
    Regex::new(&format!("^(?:{pattern})$")).map_err(|error| {
        ReplayError::BadRequest(format!("\"{pattern}\" is not a regular expression: {error}"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain_and_patterns_match_whole_names_only() {
        assert!(is_plain("/lane/markings_2"));
        assert!(!is_plain("/lane/.*"));
        let pattern = whole("/lane/.*|/tf").unwrap();
        assert!(pattern.is_match("/lane/a") && pattern.is_match("/tf"));
        assert!(!pattern.is_match("/tf_static") && !pattern.is_match("/my/lane/a"));
        assert!(whole("/lane/(").unwrap_err().to_string().contains("/lane/("));
    }
}
