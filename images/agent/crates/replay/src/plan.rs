//! Which messages go out, under which names, in which order.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::ops::Range;

use bagpipe_graph::TopicInfo;
use bagpipe_log::{
    Connection, LatchedState, Latcher, Late, Message, Recording, Timeline, another_type, latchers,
};

use crate::names::resolved;
use crate::{ReplayError, ReplayRequest};

/// A publisher's profile of which nothing is known.
const UNKNOWN_PROFILE: &str = "- {}\n";

/// What to play.
pub(crate) struct Plan<'a> {
    /// Published topics.
    pub(crate) topics: Vec<TopicInfo>,
    /// By connection, as the timeline numbers them: where its messages go.
    routes: HashMap<u32, Route>,
    timeline: Timeline<'a>,
    /// Latched messages in force at the lead-in's start, as places in the timeline.
    pub(crate) latched: Vec<usize>,
    /// The lead-in, as places in the timeline.
    pub(crate) lead_in: Range<usize>,
    /// The window, as places in the timeline.
    pub(crate) counted: Range<usize>,
}

/// Where the messages of a connection go.
pub(crate) struct Route {
    /// Places in [`Plan::topics`].
    pub(crate) topics: Vec<usize>,
    /// The recorded publisher.
    pub(crate) caller_id: String,
    /// Whether it latched.
    pub(crate) latching: bool,
}

impl<'a> Plan<'a> {
    /// Selects from bags, which make one timeline.
    ///
    /// # Errors
    /// The bag can't be read, or a topic was recorded with two types.
    pub(crate) fn new(
        bags: &[&'a dyn Recording],
        request: &ReplayRequest,
    ) -> Result<Plan<'a>, ReplayError> {
        let mut draft = Draft::new(request);
        let mut timelines = Vec::with_capacity(bags.len());
        for (at, bag) in bags.iter().enumerate() {
            let timeline = bag.timeline(&|connection| draft.names.has(&connection.topic));
            let unreadable = |error| ReplayError::BagUnreadable { bag: at, error };
            let timeline = timeline.map_err(unreadable)?;
            draft.define(*bag, &timeline.firsts())?;
            timelines.push(timeline);
        }
        let add = |(bag, timeline)| (timeline, draft.add(bag, bags.len() == 1));
        let parts: Vec<_> = bags.iter().copied().zip(timelines).map(add).collect();
        let Draft { topics, routes, latching, .. } = draft;
        let timeline = match <[_; 1]>::try_from(parts) {
            Ok([(alone, _)]) => alone,
            Err(parts) => Timeline::join(parts),
        };
        let window = request.window;
        let lead_in = timeline.between(window.lead_in_start, window.start);
        let counted = timeline.between(window.start, window.end);
        let latched = latched_before(&latching, &timeline, lead_in.start);
        Ok(Plan { topics, routes, timeline, latched, lead_in, counted })
    }

    /// Topics that somebody else speaks on, message by message; nothing of a bag.
    pub(crate) fn of_topics(topics: Vec<TopicInfo>) -> Plan<'static> {
        Plan {
            topics,
            routes: HashMap::new(),
            timeline: Timeline::join(Vec::new()),
            latched: Vec::new(),
            lead_in: 0..0,
            counted: 0..0,
        }
    }

    /// Whether there is nothing to play.
    pub(crate) fn is_empty(&self) -> bool {
        self.latched.is_empty() && self.lead_in.is_empty() && self.counted.is_empty()
    }

    /// A message alone.
    pub(crate) fn bare_message(&self, place: usize) -> Option<Message<'a>> {
        self.timeline.get(place)
    }

    /// Where the messages of a connection go.
    pub(crate) fn route(&self, connection: u32) -> Option<&Route> {
        self.routes.get(&connection)
    }

    /// A message and where it goes.
    pub(crate) fn message(&self, place: usize) -> Option<(Message<'a>, &Route)> {
        let message = self.timeline.get(place)?;
        Some((message, self.routes.get(&message.connection)?))
    }

    /// The topics that have a message to be played, as places in [`Plan::topics`].
    pub(crate) fn spoken(&self) -> Vec<usize> {
        if self.timeline.is_empty() {
            // Without a bag it is not known beforehand which topics have messages.
            return (0..self.topics.len()).collect();
        }
        let mut spoken = vec![false; self.topics.len()];
        let mut seen = HashSet::new();
        let latched = self.latched.iter().copied();
        for place in latched.chain(self.lead_in.clone()).chain(self.counted.clone()) {
            let Some((message, route)) = self.message(place) else { continue };
            if seen.insert(message.connection) {
                route.topics.iter().for_each(|at| spoken[*at] = true);
            }
        }
        (0..spoken.len()).filter(|at| spoken[*at]).collect()
    }
}

/// The part of a plan that comes of the bags' connections.
struct Draft {
    names: Names,
    /// What the graph's messages are.
    plays: &'static str,
    topics: Vec<TopicInfo>,
    places: BTreeMap<String, usize>,
    routes: HashMap<u32, Route>,
    /// What late subscribers get of a recorded topic, where a job says so.
    late: BTreeMap<String, Late>,
    /// Whose latched messages are in force, and how many.
    latching: HashMap<u32, (Latcher, u32)>,
}

impl Draft {
    fn new(request: &ReplayRequest) -> Draft {
        Draft {
            names: Names::new(request),
            plays: request.middleware.encoding(),
            topics: Vec::new(),
            places: BTreeMap::new(),
            routes: HashMap::new(),
            late: request.late.iter().map(|(topic, late)| (resolved(topic), *late)).collect(),
            latching: HashMap::new(),
        }
    }

    /// Has the connections that speak decide what the topics are; `firsts` has their first messages.
    fn define(
        &mut self,
        bag: &dyn Recording,
        firsts: &HashMap<u32, Message<'_>>,
    ) -> Result<(), ReplayError> {
        for connection in bag.connections() {
            let Some(first) = firsts.get(&connection.id) else { continue };
            for name in self.names.published_as(&connection.topic) {
                place(&mut self.topics, &mut self.places, &name, connection)?;
            }
            self.readable(connection)?;
            if connection.message_encoding.is_packed(first.data) {
                return Err(ReplayError::Packed { topic: connection.topic.clone() });
            }
        }
        Ok(())
    }

    /// Takes a bag's connections in; answers the numbers that those to be played have in the
    /// play: their own ones if the bag is `alone`. One that is not of its topic's type, or not
    /// readable, is silent, as [`Draft::define`] let it pass.
    fn add(&mut self, bag: &dyn Recording, alone: bool) -> HashMap<u32, u32> {
        let mut numbers = HashMap::new();
        let mut offered: HashMap<usize, Offered> = HashMap::new();
        let mut latchers = latchers(bag.connections());
        for connection in bag.connections() {
            if self.readable(connection).is_err() {
                continue;
            }
            let late = self.late.get(&resolved(&connection.topic)).copied().unwrap_or_default();
            let in_force = late.in_force(connection.in_force());
            let mut topics = Vec::new();
            for name in self.names.published_as(&connection.topic) {
                let Ok(at) = place(&mut self.topics, &mut self.places, &name, connection) else {
                    continue;
                };
                self.topics[at].latching |= in_force > 0;
                offered.entry(at).or_default().add(connection.offered_qos.as_deref());
                topics.push(at);
            }
            if topics.is_empty() {
                continue;
            }
            let number = if alone { connection.id } else { self.routes.len() as u32 };
            numbers.insert(connection.id, number);
            let caller_id = connection.caller_id.clone().unwrap_or_default();
            if let Some(latcher) = latchers.remove(&connection.id).filter(|_| in_force > 0) {
                self.latching.insert(number, (latcher, in_force));
            }
            self.routes.insert(number, Route { topics, caller_id, latching: in_force > 0 });
        }
        for (at, offered) in offered {
            offered.join(&mut self.topics[at].offered_qos);
        }
        numbers
    }

    fn readable(&self, connection: &Connection) -> Result<(), ReplayError> {
        let (encoding, plays) = (connection.message_encoding.name(), self.plays);
        if encoding == plays {
            return Ok(());
        }
        let (topic, encoding) = (connection.topic.clone(), encoding.to_owned());
        Err(ReplayError::OtherEncoding { topic, encoding, plays })
    }
}

/// The place of a published topic, which the first connection that comes here defines.
fn place(
    topics: &mut Vec<TopicInfo>,
    places: &mut BTreeMap<String, usize>,
    name: &str,
    connection: &Connection,
) -> Result<usize, ReplayError> {
    let Some(&at) = places.get(name) else {
        topics.push(TopicInfo {
            topic: name.to_owned(),
            datatype: connection.datatype.clone(),
            md5sum: connection.md5sum.clone(),
            definition: connection.definition.clone(),
            latching: false,
            offered_qos: None,
        });
        places.insert(name.to_owned(), topics.len() - 1);
        return Ok(topics.len() - 1);
    };
    let topic = &topics[at];
    let known = [&*topic.datatype, &topic.md5sum, &topic.definition];
    let found = [&*connection.datatype, &connection.md5sum, &connection.definition];
    match another_type(known, found) {
        None => Ok(at),
        Some([one, other]) => Err(ReplayError::TwoTypes {
            topic: connection.topic.clone(),
            first: format!("{} ({one})", topic.datatype),
            second: format!("{} ({other})", connection.datatype),
        }),
    }
}

/// The profiles of a topic's publishers in one bag, of which each channel has some.
#[derive(Default)]
struct Offered {
    profiles: String,
    /// Whether a channel has none, so that its publishers are not known.
    unknown: bool,
}

impl Offered {
    fn add(&mut self, profiles: Option<&str>) {
        match profiles.map(str::trim_end).unwrap_or_default() {
            "" | "[]" => self.unknown = true,
            known => {
                self.profiles.push_str(known);
                self.profiles.push('\n');
            }
        }
    }

    /// Adds them to those of other bags, of which most have the same.
    fn join(mut self, all: &mut Option<String>) {
        if self.unknown && !self.profiles.is_empty() {
            self.profiles.push_str(UNKNOWN_PROFILE);
        }
        let known = all.get_or_insert_default();
        if !known.contains(&self.profiles) {
            known.push_str(&self.profiles);
        }
    }
}

/// What is latched and in force before `end`, in the timeline's order. `latching` has the
/// publishers by connection.
fn latched_before(
    latching: &HashMap<u32, (Latcher, u32)>,
    timeline: &Timeline<'_>,
    end: usize,
) -> Vec<usize> {
    if latching.is_empty() {
        return Vec::new();
    }
    let mut in_force = LatchedState::default();
    for place in 0..end {
        if let Some(message) = timeline.get(place)
            && let Some((latcher, most)) = latching.get(&message.connection)
        {
            in_force.take(latcher, *most, message.time, place);
        }
    }
    in_force.into_messages().into_iter().map(|(_, place)| place).collect()
}

/// Which recorded topic is published under which names.
struct Names {
    wanted: HashSet<String>,
    by_recorded: HashMap<String, Vec<String>>,
    taken: HashSet<String>,
}

impl Names {
    fn new(request: &ReplayRequest) -> Names {
        let mut by_recorded: HashMap<String, Vec<String>> = HashMap::new();
        let mut taken = HashSet::new();
        for (stack, recorded) in &request.remap {
            by_recorded.entry(resolved(recorded)).or_default().push(resolved(stack));
            taken.insert(resolved(stack));
        }
        if request.use_sim_time {
            // The player's own /clock takes the place of a recorded one.
            taken.insert("/clock".to_owned());
        }
        let wanted = request.topics.iter().map(|topic| resolved(topic)).collect();
        Names { wanted, by_recorded, taken }
    }

    /// Whether a recorded topic is played.
    fn has(&self, recorded: &str) -> bool {
        !self.published_as(recorded).is_empty()
    }

    /// The names of a recorded topic; none if it is not played. A recorded topic whose own
    /// name the remap gives to another one makes room for that.
    fn published_as(&self, recorded: &str) -> Vec<String> {
        let recorded = resolved(recorded);
        if !self.wanted.is_empty() && !self.wanted.contains(&recorded) {
            return Vec::new();
        }
        match self.by_recorded.get(&recorded) {
            Some(names) => names.clone(),
            None if self.taken.contains(&recorded) => Vec::new(),
            None => vec![recorded],
        }
    }
}
