//! The recorder: what the stack publishes goes, stamped with bag time, into a bag in memory.

mod connection;
mod failure;
mod latched;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs::File;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{Incoming, Sink};
use bagpipe_log::{Connection, RecordingFormat, RecordingWriter};

pub(crate) use self::connection::connection_of;
use self::failure::Failure;
use self::latched::LatchedState;
use crate::ReplayError;
use crate::answers::Answers;
use crate::clock::BagClock;
use crate::ordered::{Hold, settled_name};
use crate::outcome::{Figures, Recorded, RecordedTopic};

/// A recorder; its clones write into the same bag.
#[derive(Clone)]
pub(crate) struct Recorder {
    shared: Arc<Shared>,
}

struct Shared {
    clock: Arc<BagClock>,
    answers: Arc<Answers>,
    byte_budget: u64,
    born: Instant,
    /// Nanoseconds from `born` to the last arrival, of a part of a message too; 0 before the
    /// first one.
    last: AtomicU64,
    messages: AtomicU64,
    state: Mutex<State>,
}

/// What a recording may take, how it is written, and where.
pub(crate) struct Room {
    /// The finished bag's largest size.
    pub(crate) bytes: u64,
    pub(crate) format: Arc<dyn RecordingFormat>,
    /// An empty file that it goes into chunk by chunk; else it stays in memory.
    pub(crate) file: Option<File>,
}

struct State {
    /// None once the recording is finished: what arrives later is not in it.
    writer: Option<Box<dyn RecordingWriter>>,
    file: Option<File>,
    /// In lock-step: what waits to be written in an order of its own.
    hold: Option<Hold>,
    /// By the graph's connection, what [`Hold`] needs to know of it.
    publishers: HashMap<u64, Arc<Connection>>,
    /// Topics that are received for the sake of a step and not recorded.
    unrecorded: BTreeSet<String>,
    /// Whether the counted part has begun; before it only latched messages are kept.
    counting: bool,
    latched: LatchedState,
    /// Connections of the bag by topic, publisher and md5sum.
    connections: HashMap<(String, String, String), u32>,
    /// Connections of the bag by the graph's connection.
    links: HashMap<u64, u32>,
    topics: BTreeMap<String, RecordedTopic>,
    bytes: u64,
    failure: Option<Failure>,
    broken: Option<String>,
}

impl Recorder {
    /// An empty recording; `ordered`, as lock-step wants it.
    pub(crate) fn new(
        clock: Arc<BagClock>,
        room: Room,
        answers: Arc<Answers>,
        ordered: bool,
    ) -> Recorder {
        let Room { bytes: byte_budget, format, file } = room;
        let state = State {
            writer: Some(format.writer(Some(byte_budget))),
            file,
            hold: ordered.then(Hold::default),
            publishers: HashMap::new(),
            unrecorded: BTreeSet::new(),
            counting: false,
            latched: LatchedState::within(byte_budget, ordered),
            connections: HashMap::new(),
            links: HashMap::new(),
            topics: BTreeMap::new(),
            bytes: 0,
            failure: None,
            broken: None,
        };
        Recorder {
            shared: Arc::new(Shared {
                born: clock.time.now(),
                clock,
                answers,
                byte_budget,
                last: AtomicU64::new(0),
                messages: AtomicU64::new(0),
                state: Mutex::new(state),
            }),
        }
    }

    /// That these connections' publishers latch after all, with what each sent last.
    pub(crate) fn latch_after_all(&self, links: &BTreeSet<u64>) {
        let mut state = self.state();
        if let Err(failure) = state.latched.latch_after_all(links) {
            state.failure = Some(failure);
        }
    }

    /// Begins to count: what latching publishers have in force is written at `start`.
    pub(crate) fn count_from(&self, start: u64) {
        let mut state = self.state();
        for (connection, data) in state.latched.release() {
            let topic = connection.topic.clone();
            if let Some(hold) = &mut state.hold {
                hold.push(Arc::new(connection), &data);
                continue;
            }
            let Some(id) = state.connection(connection) else { return };
            self.write(&mut state, id, &topic, start, &data);
        }
        state.counting = true;
    }

    /// Does not record a topic, although it is subscribed to.
    pub(crate) fn only_listen_to(&self, topic: &str) {
        self.state().unrecorded.insert(topic.to_owned());
    }

    /// Writes what is held with the present time, before that moves on.
    pub(crate) fn end_step(&self) {
        let mut state = self.state();
        let Some(hold) = &mut state.hold else { return };
        let now = self.shared.clock.now();
        for held in hold.release() {
            let Some(id) = state.connection((*held.connection).clone()) else { return };
            self.write(&mut state, id, &held.connection.topic, now, &held.data);
        }
    }

    /// Keeps a message of our own beside what the stack says, in the present step.
    pub(crate) fn keep(&self, connection: &Arc<Connection>, data: &[u8]) {
        let mut state = self.state();
        self.hold_back(&mut state, Arc::clone(connection), data);
    }

    /// Messages in the bag.
    pub(crate) fn messages(&self) -> u64 {
        self.shared.messages.load(Ordering::Relaxed)
    }

    /// What it has done so far.
    pub(crate) fn figures(&self) -> Figures {
        let state = self.state();
        let held = state.writer.as_ref().map_or(0, |writer| writer.high_water());
        Figures { messages: self.messages(), bytes: state.bytes, held }
    }

    /// How long nothing has arrived, counted from `since` at the earliest.
    pub(crate) fn quiet_for(&self, since: Instant) -> Duration {
        let last =
            self.shared.born + Duration::from_nanos(self.shared.last.load(Ordering::Relaxed));
        self.shared.clock.time.now().saturating_duration_since(last.max(since))
    }

    /// What did not stay there, if it had to.
    pub(crate) fn what_broke(&self) -> Option<ReplayError> {
        self.state().broken.clone().map(ReplayError::NodeInactive)
    }

    /// Why recording has failed, if it has.
    pub(crate) fn failure(&self) -> Option<ReplayError> {
        self.state().failure.clone().map(ReplayError::from)
    }

    /// The figures and the bag. What arrives later is not in it.
    pub(crate) fn finish(&self) -> Result<(Recorded, Vec<u8>), ReplayError> {
        self.end_step();
        let mut state = self.state();
        // The last step may have been the one for which there was no room.
        if let Some(failure) = state.failure.clone() {
            return Err(failure.into());
        }
        let Some(writer) = state.writer.take() else {
            return Err(ReplayError::Internal("the recording was finished before".to_owned()));
        };
        let recorded = Recorded {
            messages: writer.messages(),
            bytes: state.bytes,
            high_water_bytes: writer.high_water(),
            topics: std::mem::take(&mut state.topics).into_values().collect(),
        };
        let finished = match &mut state.file {
            None => writer.finish(),
            Some(file) => writer.finish_spilled(file).map(|_| Vec::new()),
        };
        Ok((recorded, finished.map_err(Failure::from)?))
    }

    /// Keeps a message.
    fn take(&self, incoming: &Incoming<'_>) {
        let mut state = self.state();
        let over = state.failure.is_some() || state.writer.is_none();
        if over || state.unrecorded.contains(incoming.topic) {
            return;
        }
        if !state.counting {
            if let Err(failure) = state.latched.take(incoming) {
                state.failure = Some(failure);
            }
            return;
        }
        if state.hold.is_some() {
            return self.hold(&mut state, incoming);
        }
        let id = match state.links.get(&incoming.link) {
            Some(&id) => id,
            None => {
                let connection = state.connection_of(incoming);
                let Some(id) = state.connection(connection) else { return };
                state.links.insert(incoming.link, id);
                id
            }
        };
        let now = self.shared.clock.now();
        self.write(&mut state, id, incoming.topic, now, incoming.data);
    }

    fn hold(&self, state: &mut State, incoming: &Incoming<'_>) {
        let publisher = match state.publishers.get(&incoming.link) {
            Some(known) => Arc::clone(known),
            None => {
                let mut connection = state.connection_of(incoming);
                connection.caller_id = connection.caller_id.as_deref().map(settled_name);
                let connection = Arc::new(connection);
                state.publishers.insert(incoming.link, Arc::clone(&connection));
                connection
            }
        };
        self.hold_back(state, publisher, incoming.data);
    }

    fn hold_back(&self, state: &mut State, publisher: Arc<Connection>, data: &[u8]) {
        let Some(hold) = &mut state.hold else { return };
        hold.push(publisher, data);
        if hold.bytes() > self.shared.byte_budget {
            let why = format!(
                "the outputs of one step are larger than the recording may be, {} bytes",
                self.shared.byte_budget
            );
            state.failure = Some(Failure::Budget(why));
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.shared.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self, state: &mut State, id: u32, topic: &str, time: u64, data: &[u8]) {
        let Some(writer) = &mut state.writer else { return };
        let written = writer.write(id, time, data);
        let spilled = written.and_then(|()| match &mut state.file {
            None => Ok(()),
            Some(file) => writer.spill(file),
        });
        match spilled {
            Ok(()) => {
                state.bytes += data.len() as u64;
                if let Some(topic) = state.topics.get_mut(topic) {
                    topic.messages += 1;
                }
                self.shared.messages.fetch_add(1, Ordering::Relaxed);
            }
            Err(error) => state.failure = Some(error.into()),
        }
    }
}

impl State {
    /// Who sent it, as the recording has it.
    fn connection_of(&self, incoming: &Incoming<'_>) -> Connection {
        Connection { latching: self.latched.latches(incoming), ..connection_of(incoming) }
    }

    /// The bag's connection for a publisher of a topic, which keeps it when it reconnects; `None`
    /// once the recording is finished.
    fn connection(&mut self, connection: Connection) -> Option<u32> {
        let caller = connection.caller_id.clone().unwrap_or_default();
        let key = (connection.topic.clone(), caller, connection.md5sum.clone());
        if let Some(&id) = self.connections.get(&key) {
            return Some(id);
        }
        let id = self.writer.as_mut()?.add_connection(&connection);
        self.topics.entry(connection.topic.clone()).or_insert_with(|| RecordedTopic {
            topic: connection.topic.clone(),
            datatype: connection.datatype.clone(),
            messages: 0,
        });
        self.connections.insert(key, id);
        Some(id)
    }
}

impl Sink for Recorder {
    fn message(&mut self, incoming: Incoming<'_>) {
        self.part();
        self.take(&incoming);
        // After it is kept: what is awaited is recorded in the step that it ends.
        self.shared.answers.receive(&incoming);
    }

    fn part(&mut self) {
        let now = self.shared.clock.time.now();
        let since = now.duration_since(self.shared.born).as_nanos() as u64;
        self.shared.last.store(since, Ordering::Relaxed);
    }

    fn too_large(&mut self, topic: &str, length: u64) {
        let why =
            format!("a message of {length} bytes on {topic} is larger than the recording may be");
        self.state().failure = Some(Failure::Budget(why));
    }

    fn broken(&mut self, why: String) {
        self.state().broken.get_or_insert(why);
    }
}
