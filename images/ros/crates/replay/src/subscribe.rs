//! Before the first input: the recorder finds its topics, the stack finds ours.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bagpipe_ros::{Node, Publication, RosError, SystemState};
use regex::Regex;

use crate::lockstep::Lockstep;
use crate::play::Player;
use crate::recorder::Recorder;
use crate::request::resolved;
use crate::settle::settle;
use crate::time::Time;
use crate::watch::Watch;
use crate::{ReplayError, ReplayRequest};

/// The time between two looks at the master while subscribers are awaited.
const DISCOVER: Duration = Duration::from_millis(100);
/// The time between two looks at our own connections.
pub(crate) const LOOK: Duration = Duration::from_millis(10);
/// With no topics named, the subscribers are complete once none came for this time.
const STABLE: Duration = Duration::from_millis(500);
/// How long the master may not answer: one that is started anew needs a second or two.
const GONE: Duration = Duration::from_secs(5);

/// Which topics to record, and the search for them.
pub(crate) struct Discovery<'a> {
    pub(crate) node: &'a Node,
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
        node: &'a Node,
        record: &[String],
        time: &'a Time,
    ) -> Result<Discovery<'a>, ReplayError> {
        let mut patterns = Vec::new();
        for text in record {
            if is_plain(text) {
                node.subscribe(&resolved(text)).map_err(ReplayError::RosMasterFailed)?;
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
            self.node.subscribe(answer).map_err(ReplayError::RosMasterFailed)?;
        }
        self.expected = lockstep.required().map(str::to_owned).collect();
        Ok(())
    }

    /// Expected topics that nobody publishes yet.
    fn unanswered(&self) -> Vec<&str> {
        let expected = self.expected.iter().map(String::as_str);
        expected.filter(|topic| self.node.publishers_of(topic) == 0).collect()
    }

    /// Registers again what the master has forgotten, and subscribes to what others publish
    /// and a pattern matches; answers the graph's state.
    ///
    /// # Errors
    /// The master has failed for a while; a passing failure answers `None`.
    pub(crate) fn look(&self) -> Result<Option<SystemState>, ReplayError> {
        let looked = self.node.master().get_system_state().and_then(|state| {
            let again = self.node.register_missing(&state)?;
            self.subscribe_to_matches(&state)?;
            Ok((state, again))
        });
        let mut master = self.master.lock().unwrap_or_else(|e| e.into_inner());
        match looked {
            Ok((state, again)) => {
                *master = MasterSeen { silent: None, again: master.again + again };
                Ok(Some(state))
            }
            Err(error) => {
                let now = self.time.now();
                let since = *master.silent.get_or_insert(now);
                if now.duration_since(since) >= GONE {
                    return Err(ReplayError::RosMasterFailed(error));
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

    /// What the user should know of a master that was started anew.
    pub(crate) fn restarted(&self) -> Option<String> {
        let again = self.master.lock().unwrap_or_else(|e| e.into_inner()).again;
        (again > 0).then(|| {
            format!(
                "the ROS master was started anew: {again} registrations were made again, and \
                 nodes that came before that were found late"
            )
        })
    }

    fn subscribe_to_matches(&self, state: &SystemState) -> Result<(), RosError> {
        for (topic, publishers) in &state.publishers {
            let others = publishers.iter().any(|node| node != self.node.name());
            if others && self.patterns.iter().any(|pattern| pattern.is_match(topic)) {
                self.node.subscribe(topic)?;
            }
        }
        Ok(())
    }

    /// Whether every publisher of a recorded topic that the master knows is connected.
    pub(crate) fn hears_everyone(&self, state: &SystemState) -> bool {
        self.node.subscribed_topics().iter().all(|topic| {
            let others = others(state.publishers.get(topic), self.node.name()).count();
            self.node.publishers_of(topic) >= others
        })
    }
}

/// Waits until the stack is there.
///
/// # Errors
/// [`ReplayError::NeverSubscribed`] after the deadline, and whatever stops the watch.
pub(crate) fn wait_for_stack(
    discovery: &Discovery<'_>,
    player: &mut Player<'_>,
    request: &ReplayRequest,
    watch: &mut Watch<'_>,
) -> Result<(), ReplayError> {
    let begun = watch.now();
    let deadline = begun + request.subscribe_deadline;
    let mut waiting = Waiting::new(player.required(), request.topics.is_empty(), begun);
    let mut next_look = begun;
    loop {
        watch.check()?;
        let now = watch.now();
        if now >= next_look {
            next_look = now + DISCOVER;
            discovery.look()?;
            player.show_clock(watch)?;
        }
        let unanswered = discovery.unanswered();
        let absent = absent(player.publications(), request);
        if absent.is_empty()
            && unanswered.is_empty()
            && waiting.is_over(player.publications(), now, deadline)
        {
            break;
        }
        if now >= deadline {
            if !absent.is_empty() {
                return Err(still_waiting(&absent, request));
            }
            if !unanswered.is_empty() && waiting.is_over(player.publications(), now, deadline) {
                return Err(never_advertised(&unanswered, request));
            }
            let missing = waiting.missing(player.publications());
            return Err(never_subscribed(discovery, player, &missing, request));
        }
        watch.sleep_until(now + LOOK)?;
    }
    settle(discovery, player, request.start.at_rest_below, watch)?;
    let begin = watch.now() + request.start.delay;
    while watch.now() < begin {
        watch.sleep_until(begin.min(watch.now() + LOOK))?;
        player.show_clock(watch)?;
    }
    Ok(())
}

/// What the request wants to wait for and is not there, in words.
fn absent(topics: &[Arc<Publication>], request: &ReplayRequest) -> Vec<String> {
    let connected: Vec<(&str, BTreeSet<String>)> =
        topics.iter().map(|topic| (topic.info().topic.as_str(), open_subscribers(topic))).collect();
    let nodes = request.start.nodes.iter().map(|node| resolved(node));
    let mut absent: Vec<String> =
        nodes.filter(|node| !connected.iter().any(|(_, there)| there.contains(node))).collect();
    for (topic, wanted) in &request.start.subscribers {
        let topic = resolved(topic);
        let there = connected.iter().find(|(name, _)| *name == topic).map_or(0, |(_, n)| n.len());
        if there < *wanted {
            absent.push(format!("{wanted} subscribers of {topic} (there are {there})"));
        }
    }
    absent
}

fn still_waiting(absent: &[String], request: &ReplayRequest) -> ReplayError {
    ReplayError::NeverSubscribed(format!(
        "waited in vain for {} for {:.1} s",
        absent.join(", "),
        request.subscribe_deadline.as_secs_f64()
    ))
}

/// The state of the wait.
struct Waiting {
    required: Vec<usize>,
    any: bool,
    links: usize,
    since: Instant,
}

impl Waiting {
    fn new(required: Vec<usize>, any: bool, now: Instant) -> Waiting {
        Waiting { required, any, links: 0, since: now }
    }

    fn is_over(&mut self, topics: &[Arc<Publication>], now: Instant, deadline: Instant) -> bool {
        if !self.any {
            return self.missing(topics).is_empty();
        }
        let links = self.required.iter().map(|at| open_subscribers(&topics[*at]).len()).sum();
        if links != self.links {
            (self.links, self.since) = (links, now);
        }
        links > 0 && (now.duration_since(self.since) >= STABLE || now >= deadline)
    }

    /// The required topics that nobody subscribes to.
    fn missing(&self, topics: &[Arc<Publication>]) -> Vec<String> {
        let required = self.required.iter().map(|at| &topics[*at]);
        let missing = required.filter(|publication| open_subscribers(publication).is_empty());
        missing.map(|publication| publication.info().topic.clone()).collect()
    }
}

pub(crate) fn open_subscribers(publication: &Publication) -> BTreeSet<String> {
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

fn never_advertised(answers: &[&str], request: &ReplayRequest) -> ReplayError {
    ReplayError::NeverSubscribed(format!(
        "nobody published {} within {:.1} s, which the steps name as an answer; is the name \
         right? Let the step be optional if its node appears only during the play",
        answers.join(", "),
        request.subscribe_deadline.as_secs_f64()
    ))
}

fn never_subscribed(
    discovery: &Discovery<'_>,
    player: &Player<'_>,
    missing: &[String],
    request: &ReplayRequest,
) -> ReplayError {
    let mut sentence = format!(
        "nobody subscribed to {} within {:.1} s",
        missing.join(", "),
        request.subscribe_deadline.as_secs_f64()
    );
    let refused = player.publications().iter().flat_map(|publication| publication.refused());
    let refused: BTreeSet<String> = refused.collect();
    for refusal in refused {
        sentence.push_str(&format!("; {refusal}"));
    }
    let state = discovery.look().ok().flatten().unwrap_or_default();
    let mut found = BTreeMap::new();
    for (topic, nodes) in &state.subscribers {
        let nodes: Vec<&str> =
            others(Some(nodes), discovery.node.name()).map(String::as_str).collect();
        if !nodes.is_empty() {
            found.insert(topic, nodes.join(", "));
        }
    }
    let found: Vec<String> =
        found.into_iter().map(|(topic, nodes)| format!("{topic} (by {nodes})")).collect();
    sentence.push_str(&if found.is_empty() {
        "; the stack's nodes subscribe to nothing at all".to_owned()
    } else {
        format!("; the stack's nodes subscribe to {}; remap joins the names", found.join(", "))
    });
    ReplayError::NeverSubscribed(sentence)
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
