//! Publishers of what is recorded whose messages may never have come, since they and the recorder may not have
//! known each other: those of the play's begin, and those that came later and are strangers at its end. Who has
//! met is accounted for elsewhere ([`crate::account`]); these are not, and others' messages make up for none of theirs.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, EndpointId};

use crate::handed::{Gid, Handed};

/// Who came during the play may publish for so long before it and the recorder know each other.
const LATE: Duration = Duration::from_secs(2);

/// Those of a play.
#[derive(Default)]
pub(crate) struct Unmet {
    topics: Mutex<BTreeMap<String, Begun>>,
    /// Those that were gone when the play began, of all topics.
    gone: Mutex<BTreeSet<EndpointId>>,
}

/// A topic, since the play began.
#[derive(Debug, Default)]
pub(crate) struct Begun {
    /// Messages that the recorder had been handed by then.
    handed: Handed,
    /// What each publisher had published by then that was there.
    before: BTreeMap<EndpointId, u64>,
    /// Those of them that the recorder may not have known.
    strangers: BTreeSet<EndpointId>,
    /// Those of these that had matched nobody of ours by what they report, beside others that do not count.
    apart: BTreeSet<EndpointId>,
    /// Those that came later, since when.
    came: BTreeMap<EndpointId, Instant>,
}

/// A topic at the end of a play.
pub(crate) struct Ended<'e> {
    pub(crate) topic: &'e str,
    /// All of its publishers, also those that are gone.
    pub(crate) publishers: Vec<&'e Endpoint>,
    /// Whether some that are there are not known to the recorder.
    pub(crate) has_strangers: bool,
    /// Whether all that the recorder has matched may be others: those that do not count, and those that report it.
    pub(crate) has_others_alone: bool,
    pub(crate) at: Instant,
}

impl Begun {
    /// A topic of which the recorder was `handed` so many, and whose publishers are `there`, each with whether the
    /// recorder knows it for certain.
    pub(crate) fn new<'e>(
        handed: Handed,
        there: impl Iterator<Item = (&'e Endpoint, bool)>,
    ) -> Begun {
        let mut begun = Begun { handed, ..Begun::default() };
        for (one, known) in there {
            // With the calls under way: their messages may have been handed on already.
            begun.before.insert(one.id, one.counts.offered);
            if !known {
                begun.strangers.insert(one.id);
            }
        }
        begun
    }

    /// The same, with those that were `apart`: what others publish that do not count makes up for none of theirs.
    pub(crate) fn with_apart(mut self, apart: BTreeSet<EndpointId>) -> Begun {
        self.strangers.extend(&apart);
        self.apart = apart;
        self
    }

    /// What one has published since.
    fn published(&self, one: &Endpoint) -> u64 {
        one.counts.published.saturating_sub(self.before.get(&one.id).copied().unwrap_or(0))
    }

    /// Whether messages of it may be missing that nobody else accounts for.
    fn suspects(&self, one: &Endpoint, ended: &Ended<'_>) -> bool {
        let is_late = |since: &Instant| ended.at.saturating_duration_since(*since) >= LATE;
        self.strangers.contains(&one.id)
            || (ended.has_strangers && self.came.get(&one.id).is_some_and(is_late))
    }

    /// How many messages of those lack, once the recorder has been `handed` so many. What others have published
    /// has come; of who came during the play that is not known, unless somebody has stayed a stranger.
    fn missing(&self, ended: &Ended<'_>, handed: &Handed) -> u64 {
        let (mut lost, mut theirs, mut others) = (0, 0, 0);
        for one in &ended.publishers {
            if ended.has_others_alone && self.apart.contains(&one.id) {
                lost += self.missing_of(one, handed);
            } else if self.suspects(one, ended) {
                theirs += self.published(one);
            } else if ended.has_strangers || self.before.contains_key(&one.id) {
                others += self.published(one);
            }
        }
        let came = handed.all.saturating_sub(self.handed.all).saturating_sub(others);
        (lost + theirs.saturating_sub(came)).max(self.missing_of_each(ended, handed))
    }

    /// The same of those that are known by their GIDs: what others publish stands for none of theirs. A message whose
    /// publisher is not known may be anybody's.
    fn missing_of_each(&self, ended: &Ended<'_>, handed: &Handed) -> u64 {
        let suspects = ended.publishers.iter().filter(|one| self.suspects(one, ended));
        let known = suspects.filter(|one| one.gid.is_some());
        let missing: u64 = known.map(|one| self.missing_of(one, handed)).sum();
        let of_nobody = handed.of_nobody().saturating_sub(self.handed.of_nobody());
        missing.saturating_sub(of_nobody)
    }

    /// What of one has not come by its GID: without that, all that it has published.
    fn missing_of(&self, one: &Endpoint, handed: &Handed) -> u64 {
        let came = |gid: &Gid| handed.of(gid).saturating_sub(self.handed.of(gid));
        self.published(one).saturating_sub(one.gid.as_ref().map_or(0, came))
    }

    fn sentence(&self, ended: &Ended<'_>, handed: &Handed) -> Option<String> {
        let missing = self.missing(ended, handed);
        let theirs = |one: &&&Endpoint| self.suspects(one, ended) && self.published(one) > 0;
        let nodes = ended.publishers.iter().filter(theirs).map(|one| one.node.as_str());
        let nodes: BTreeSet<&str> = nodes.collect();
        let nodes = nodes.into_iter().collect::<Vec<_>>().join(", ");
        let topic = ended.topic;
        (missing > 0).then(|| {
            format!(
                "{missing} messages of {topic} did not reach the recorder, which {nodes} did not know when the \
                 play began, or when they came: is there another node of its name, which hides it in the graph? is it \
                 in the case's domain (ROS_DOMAIN_ID is the agent's)? or had they no processor to find each other?"
            )
        })
    }
}

impl Unmet {
    fn topics(&self) -> MutexGuard<'_, BTreeMap<String, Begun>> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn gone(&self) -> MutexGuard<'_, BTreeSet<EndpointId>> {
        self.gone.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Takes in that the play begins, without those that are `gone`.
    pub(crate) fn begin(
        &self,
        topics: impl Iterator<Item = (String, Begun)>,
        gone: impl Iterator<Item = EndpointId>,
    ) {
        *self.topics() = topics.collect();
        *self.gone() = gone.collect();
    }

    /// Whether one was gone when the play began: what it published is none of the play's.
    pub(crate) fn was_gone(&self, one: EndpointId) -> bool {
        self.gone().contains(&one)
    }

    /// Takes in who publishes a recorded topic at a moment of the play.
    pub(crate) fn look<'e>(
        &self,
        topic: &str,
        there: impl Iterator<Item = &'e Endpoint>,
        now: Instant,
    ) {
        let mut topics = self.topics();
        let begun = topics.entry(topic.to_owned()).or_default();
        for one in there.filter(|one| !begun.before.contains_key(&one.id)).collect::<Vec<_>>() {
            begun.came.entry(one.id).or_insert(now);
        }
    }

    /// How many messages lack of all topics, of each of which the recorder was `handed` so many.
    pub(crate) fn missing(&self, ended: &[Ended<'_>], handed: impl Fn(&str) -> Handed) -> u64 {
        let topics = self.topics();
        let missing = |one: &Ended<'_>| {
            topics.get(one.topic).map_or(0, |begun| begun.missing(one, &handed(one.topic)))
        };
        ended.iter().map(missing).sum()
    }

    /// The same as sentences, one for each topic of which some lack.
    pub(crate) fn lacking(
        &self,
        ended: &[Ended<'_>],
        handed: impl Fn(&str) -> Handed,
    ) -> Vec<String> {
        let topics = self.topics();
        let sentence = |one: &Ended<'_>| topics.get(one.topic)?.sentence(one, &handed(one.topic));
        ended.iter().filter_map(sentence).collect()
    }
}
