//! What is recorded, and whether all of it came.

use std::collections::BTreeSet;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{GraphError, Node, Publication, Publisher};
use bagpipe_ros2ledger::{Endpoint, EndpointId, Kind};
use bagpipe_ros2player::{GraphPublisher, Qos};

use super::Graph;
use super::others::{AGAIN, UNLISTED};
use crate::accounts::{Due, Publishing};
use crate::clock::source_now;
use crate::definition::{installed, schema_encoding};
use crate::error::failed;
use crate::handed::Handed;
use crate::other_types::{Types, chosen};
use crate::publishers::{Known, are_listed};
use crate::recording::Input;
use crate::topic::{Look, uncounted};
use crate::unmet::{Begun, Ended};
use crate::{qos, stamp};

/// How long a message may be on its way to us once all is over.
pub(super) const ON_ITS_WAY: Duration = Duration::from_secs(1);
/// Looks at the end at what was published, and at most while calls that publish are under way.
const LOOKS: u32 = 3;
const MOST_LOOKS: u32 = 60;
/// The longest pause between two of these: no call is always under way then that goes on for less.
const BETWEEN: Duration = Duration::from_millis(17);

impl Graph {
    /// Subscribes to what is wanted and whose type is known by now: to all of that, whichever fails.
    pub(super) fn subscribe_to_wanted(
        &self,
        types: &Types,
        endpoints: &[Endpoint],
    ) -> Result<(), GraphError> {
        let wanted: Vec<String> = self.wanted().iter().cloned().collect();
        let (mut all, mut patience) = (Ok(()), UNLISTED);
        for topic in wanted.into_iter().filter(|topic| types.contains_key(topic)) {
            match self.subscribe_as_published(&topic, &mut patience) {
                Ok(false) => {}
                Ok(true) => drop(self.wanted().remove(&topic)),
                Err(error) => {
                    let counts = published_on(&topic, endpoints).next().is_some();
                    let why = error.source.to_string();
                    match !counts && self.unnamed_topics.refuse(&topic, &why) {
                        true => drop(self.wanted().remove(&topic)),
                        false => all = all.and(Err(error)),
                    }
                }
            }
        }
        all
    }

    /// Subscribes to a topic by its publishers' type; false if it has none but ours.
    fn subscribe_as_published(
        &self,
        topic: &str,
        patience: &mut Duration,
    ) -> Result<bool, GraphError> {
        let shown = self.others_on(topic)?;
        let Some(datatype) = chosen(&shown).map(str::to_owned) else { return Ok(false) };
        let look = self.look_behind(topic, &shown, patience)?;
        let all: Vec<&Endpoint> = published_on(topic, &look.endpoints).collect();
        let wanted = qos::recorded(all.iter().map(|one| &one.qos));
        let names: BTreeSet<&String> = all.iter().map(|one| &one.node).collect();
        let node = match names.into_iter().collect::<Vec<_>>()[..] {
            [only] => Some(only.clone()),
            _ => None,
        };
        let publisher = self.publisher(node, &datatype, &all, &wanted);
        let subscription = self.means.player.listen(topic, &datatype, &wanted).map_err(failed)?;
        self.inputs.add(topic, (subscription, wanted), publisher);
        Ok(true)
    }

    /// The ledger, read after the graph: who creates a publisher lists it a moment later, and a recording introduces it by
    /// what is listed. Who does not count is waited for until `patience` is over.
    fn look_behind(
        &self,
        topic: &str,
        shown: &[GraphPublisher],
        patience: &mut Duration,
    ) -> Result<Look, GraphError> {
        loop {
            let look = Look::at(self.ledger()).map_err(failed)?;
            if patience.is_zero() || are_listed(shown, &self.known_on(topic, &look)) {
                return Ok(look);
            }
            std::thread::sleep(AGAIN);
            *patience = patience.saturating_sub(AGAIN);
        }
    }

    /// How a recording introduces who publishes a topic.
    fn publisher(
        &self,
        node: Option<String>,
        datatype: &str,
        publishers: &[&Endpoint],
        recorded: &Qos,
    ) -> Publisher {
        let played = self.topics().iter().map(|topic| topic.info().clone()).collect::<Vec<_>>();
        let same = || played.iter().find(|info| info.datatype == datatype);
        let definition = installed(datatype, &self.prefixes)
            .or_else(|| Some(same()?.definition.to_string()))
            .unwrap_or_default();
        Publisher {
            node,
            datatype: datatype.to_owned(),
            md5sum: String::new(),
            read_stamp: stamp::reader(&definition),
            message_encoding: "cdr",
            schema_encoding: schema_encoding(&definition),
            definition,
            latching: recorded.durability == bagpipe_ros2player::Durability::TransientLocal,
            may_latch: false,
            offered_qos: Some(qos::yaml(publishers.iter().map(|one| &one.qos))),
        }
    }

    /// Takes in what was published on a recorded topic and handed on, by now.
    pub(super) fn compare(&self, input: &Input, handed: &Handed, look: &Look) {
        let met = self.met(input, look);
        let now: Vec<_> = published_on(&input.topic, &look.endpoints).map(Publishing::of).collect();
        input.accounts().look(&now, handed, &met);
        self.look_for_unrecordable(input, look);
    }

    /// Takes in who publishes a recorded topic with another quality of service than the recorder can take.
    pub(super) fn look_for_unrecordable(&self, input: &Input, look: &Look) {
        let mut unrecordable = input.unrecordable();
        for one in published_on(&input.topic, &look.endpoints) {
            if let Some(why) = qos::unrecordable(&one.qos, &input.qos)
                && self.has_published(one)
            {
                unrecordable.insert(format!(
                    "{} publishes {} {why}, for which the recorder was there already: publish it \
                     with one quality of service",
                    one.node, input.topic
                ));
            }
        }
    }

    /// Whether one has published, unless it was gone before the play: that is missed by nobody.
    fn has_published(&self, one: &Endpoint) -> bool {
        one.counts.published > 0 && !self.unmet.was_gone(one.id)
    }

    /// Takes in that the play begins: who can't be recorded and is gone is forgotten, and who is there is found again.
    pub(super) fn begin_without_unrecordable(&self) {
        let inputs = self.inputs.all();
        for input in &inputs {
            input.other_types.begin();
            // Behind the begin of who is unmet, so that a look that is under way finds none of those that are gone.
            input.unrecordable().clear();
        }
        // Who can't be read fails the next look.
        let (Ok(types), Ok(look)) = (self.topics_of_graph(), Look::at(self.ledger())) else {
            return;
        };
        for input in &inputs {
            self.look_for_unrecordable(input, &look);
            self.differing(input, &types, &look);
        }
    }

    /// What a recording has of our own messages, which are none of the stack's, where the RMW hands
    /// them to us all the same: `more` than others have published.
    pub(super) fn own(&self, input: &Input, more: u64) -> Option<String> {
        let played = self.topics().iter().any(|topic| topic.info().topic == input.topic);
        let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
        let endpoints = self.ledger().endpoints().ok()?;
        let known = uncounted(&input.topic, &others, &endpoints).is_empty();
        (played && known && more > 0).then(|| {
            format!(
                "{more} messages of {} were recorded that the stack has not published: it is \
                 played too, and this RMW does not separate them; do not play it, or remap it",
                input.topic
            )
        })
    }

    /// Takes in which of the stack's publishers of a recorded topic know us; those that do and that we know: all where
    /// we know as many as there are, and beside strangers those that report it, if we know as many.
    fn met(&self, input: &Input, look: &Look) -> BTreeSet<EndpointId> {
        let there: Vec<&Endpoint> = look.there(Kind::Publisher, &input.topic).collect();
        let reported = there.iter().map(|one| (one.id, one.matched, look.counterparts(one)));
        let mut acquaintance = input.acquaintance();
        acquaintance.look(Instant::now(), reported);
        let all = || published_on(&input.topic, &look.endpoints).map(|one| one.id);
        // The player is asked no more once all have met.
        if !input.accounts().has_strangers(all()) {
            return BTreeSet::new();
        }
        let known = self.means.player.publishers(input.subscription).unwrap_or_default();
        let reporting: BTreeSet<EndpointId> =
            there.iter().map(|one| one.id).filter(|one| acquaintance.has_reported(*one)).collect();
        if acquaintance.is_whole() && known >= there.len() as u64 {
            return all().collect();
        }
        if known >= reporting.len() as u64 { reporting } else { BTreeSet::new() }
    }

    /// Takes in that the play begins, and which publishers of what is recorded may not know the recorder yet, nor
    /// it them: of a topic whose type is not known, all.
    pub(super) fn begin_without_unmet(&self) {
        // A ledger that can't be read fails the next look.
        // Before what was published is read: what comes meanwhile is not due.
        let all = self.handed();
        let Ok(look) = Look::at(self.ledger()) else { return };
        let recorded = all.into_iter().map(|(input, handed)| {
            let apart = self.apart(&input, &look);
            let there: Vec<&Endpoint> = look.there(Kind::Publisher, &input.topic).collect();
            let all = input.acquaintance().is_whole() && !self.has_strangers(&input, there.len());
            let known = |one: &&Endpoint| all || input.acquaintance().has_reported(one.id);
            let there = there.into_iter().map(|one| (one, known(&one)));
            let begun = Begun::new(handed, there).with_apart(apart);
            (input.topic.clone(), begun)
        });
        let recorded: Vec<(String, Begun)> = recorded.collect();
        let wanted = self.wanted().clone().into_iter().map(|topic| {
            let there = look.there(Kind::Publisher, &topic).map(|one| (one, false));
            let begun = Begun::new(Handed::default(), there);
            (topic, begun)
        });
        let publishers = look.endpoints.iter().filter(|one| one.kind == Kind::Publisher);
        let gone = publishers.filter(|one| !look.is_there(one)).map(|one| one.id);
        self.unmet.begin(recorded.into_iter().chain(wanted), gone);
    }

    /// Takes in who publishes what is recorded by now.
    pub(super) fn look_for_unmet(&self, look: &Look) {
        let now = Instant::now();
        for topic in self.subscribed_topics() {
            self.unmet.look(&topic, look.there(Kind::Publisher, &topic), now);
        }
    }

    /// Whether the recorder has matched fewer publishers than there are.
    fn has_strangers(&self, input: &Input, there: usize) -> bool {
        let known = self.means.player.publishers(input.subscription);
        known.is_ok_and(|known| known < there as u64)
    }

    /// What these have published since and did not come, as sentences.
    pub(super) fn unmet(&self) -> Vec<String> {
        // What was published can't be known then, which is reported.
        let Ok(look) = Look::at(self.ledger()) else { return Vec::new() };
        // Behind the counts, so that what is published by who goes on makes up for nothing.
        self.inputs.all().iter().for_each(|input| input.arrivals.mark(source_now));
        let topics = self.subscribed_topics();
        let at = Instant::now();
        let ended: Vec<Ended<'_>> = topics
            .iter()
            .map(|topic| {
                let there = look.there(Kind::Publisher, topic).count();
                let input = self.inputs.of(topic);
                Ended {
                    topic,
                    publishers: published_on(topic, &look.endpoints).collect(),
                    has_strangers: input
                        .as_ref()
                        .is_none_or(|input| self.has_strangers(input, there)),
                    has_others_alone: input.is_some_and(|input| self.matches_others(&input, &look)),
                    at,
                }
            })
            .collect();
        let handed = |topic: &str| {
            self.inputs.of(topic).map(|one| one.arrivals.handed_by_mark()).unwrap_or_default()
        };
        // What went out just then is on its way.
        let missing = || self.unmet.missing(&ended, handed);
        self.inputs.await_arrivals(ON_ITS_WAY, self.means.stall, missing);
        self.unmet.lacking(&ended, handed)
    }

    /// The publishers of a topic that the ledger has.
    pub(super) fn known_on<'e>(&self, topic: &'e str, look: &'e Look) -> Vec<Known<'e>> {
        let all = published_on(topic, &look.endpoints).map(|one| Known {
            node: &one.node,
            gid: one.gid,
            has_published: self.has_published(one),
            destroyed: one.destroyed,
            is_there: look.is_there(one),
        });
        all.collect()
    }

    /// Each recorded topic, with what was handed to the sink by now.
    fn handed(&self) -> Vec<(Arc<Input>, Handed)> {
        let all = self.inputs.all().into_iter();
        all.map(|input| (Arc::clone(&input), input.arrivals.handed())).collect()
    }

    /// What each recorded topic must have handed on by now at least, of what is published by this
    /// moment.
    pub(super) fn due(&self) -> Result<Vec<(Arc<Input>, Due)>, GraphError> {
        let all = self.handed();
        let endpoints = self.ledger().endpoints().map_err(failed)?;
        let due = all.into_iter().map(|(input, handed)| {
            // Once more, as all endpoints take a while: what is published between its publisher's count and
            // the mark is not due, and would stand for what is lost.
            let counts = |one: &Endpoint| self.ledger().counts(one.id).unwrap_or(one.counts);
            let again = |one: &Endpoint| Endpoint { counts: counts(one), ..one.clone() };
            let all: Vec<_> = published_on(&input.topic, &endpoints).map(again).collect();
            let now: Vec<_> = all.iter().map(Publishing::of).collect();
            // Behind the counts: whoever publishes counts it after its message has a stamp.
            input.arrivals.mark(source_now);
            input.accounts().look(&now, &handed, &BTreeSet::new());
            let due = input.accounts().due();
            (input, due)
        });
        Ok(due.collect())
    }

    /// What was due at the end, once it has come or was waited for. What is published by a call that is under
    /// way may have come and is not due: it may stand for one that is lost, of several looks hardly at each.
    pub(super) fn due_at_last(&self) -> Result<Vec<(Arc<Input>, Due)>, GraphError> {
        let mut look = 0;
        loop {
            look += 1;
            let due = self.due()?;
            // What goes out at this moment is on its way.
            let missing = || {
                let lacks = |(input, due): &(Arc<Input>, Due)| {
                    due.missing(&input.arrivals.handed_by_mark())
                };
                due.iter().map(lacks).sum()
            };
            let whole = self.inputs.await_arrivals(ON_ITS_WAY, self.means.stall, missing);
            let under_way = due.iter().any(|(input, _)| input.accounts().is_under_way());
            if !whole || look == MOST_LOOKS || (look >= LOOKS && !under_way) {
                return Ok(due);
            }
            if under_way {
                // By another part of the longest pause each time, so that no rhythm of calls fits.
                std::thread::sleep(BETWEEN * (look * 37 % MOST_LOOKS) / MOST_LOOKS);
            }
        }
    }
}

/// The publishers of a topic that count, also those that are gone.
pub(super) fn published_on<'e>(
    topic: &'e str,
    endpoints: &'e [Endpoint],
) -> impl Iterator<Item = &'e Endpoint> {
    endpoints.iter().filter(move |one| one.kind == Kind::Publisher && one.topic == topic)
}
