//! Recording a graph as it is, without playing: bags are made in memory and handed over
//! whole, one at the end or several where the recording is split.

use std::collections::{BTreeSet, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use bagpipe_graph::{
    GraphError, Incoming, Middleware, Node, NodeOptions, PacedBy, Seen, Sink, SystemState,
};
use bagpipe_log::{RecordingFormat, RecordingWriter};
use regex::Regex;

use crate::ReplayError;
use crate::discovery::whole;
use crate::names::resolved;
use crate::recorder::connection_of;

/// The deadline of every call to the master and of every handshake.
const CALL: Duration = Duration::from_secs(3);
/// The time between two looks at the master for new topics.
const LOOK: Duration = Duration::from_millis(100);
/// The longest sleep without a look at `stop`.
const NAP: Duration = Duration::from_millis(20);
/// Looks at the master that may fail in a row before it counts as gone.
const FAILURES: u32 = 50;

/// A recording to be made.
#[derive(Clone, Debug)]
pub struct RecordRequest {
    /// Whose graph is recorded.
    pub middleware: Arc<dyn Middleware>,
    /// Regular expressions that a topic's whole name must match; empty: every topic.
    pub topics: Vec<String>,
    /// Topics whose whole names match this are left out.
    pub exclude: Option<String>,
    /// Only topics that this node subscribes to.
    pub node: Option<String>,
    /// How the bags are written.
    pub record_as: Arc<dyn RecordingFormat>,
    /// A bag is handed over once its messages have so many bytes.
    pub split_bytes: u64,
    /// A bag is handed over once it spans this time.
    pub split_after: Option<Duration>,
    /// When to end by itself.
    pub duration: Option<Duration>,
    /// So many messages end it.
    pub limit: Option<u64>,
}

/// What was recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordedLive {
    /// Messages in all bags.
    pub messages: u64,
    /// Bytes of their data.
    pub bytes: u64,
    /// Bags that were handed over.
    pub bags: u64,
    /// Whether the master did not answer any more at the end: messages of known publishers
    /// were still received, new ones could not be found.
    pub master_lost: bool,
    /// Subscriptions that were made again, since a restarted master knew nothing of them.
    pub again: u64,
}

/// Takes finished bags; an error ends the recording.
pub type Keep = Box<dyn FnMut(Vec<u8>) -> Result<(), String> + Send>;

/// Records until `stop` says so, or as the request limits it. While a bag is handed over
/// nothing is read, so that publishers wait (or drop, as their own queues say).
///
/// # Errors
/// The master can't be reached at the start, an expression is none, or `keep` fails.
pub fn record(
    request: &RecordRequest,
    keep: Keep,
    stop: &dyn Fn() -> bool,
) -> Result<RecordedLive, ReplayError> {
    let choice = Choice::new(request)?;
    let tape = Tape::new(request, keep);
    let options = NodeOptions {
        name: format!("/bagpipe_recorder_{}", std::process::id()),
        call_deadline: CALL,
        stall: CALL,
        max_message: usize::MAX,
        paced_by: PacedBy::Schedule,
    };
    let node = request
        .middleware
        .join(options, Box::new(tape.clone()))
        .map_err(ReplayError::GraphFailed)?;
    let begun = Instant::now();
    let (mut failures, mut again) = (0, 0);
    choice.subscribe(&*node).map_err(ReplayError::GraphFailed)?;
    let mut looked = Instant::now();
    while !(stop() || tape.is_over() || request.duration.is_some_and(|d| begun.elapsed() >= d)) {
        if looked.elapsed() >= LOOK {
            looked = Instant::now();
            // While a master is away, messages of known publishers are received.
            match choice.subscribe(&*node) {
                Ok(made) => (failures, again) = (0, again + made),
                Err(_) => failures += 1,
            }
        }
        std::thread::sleep(NAP);
    }
    // What has been sent to us by now is recorded.
    node.sweep(CALL);
    drop(node);
    Ok(RecordedLive { master_lost: failures >= FAILURES, again, ..tape.finish()? })
}

/// Which topics are recorded.
struct Choice {
    patterns: Vec<Regex>,
    exclude: Option<Regex>,
    node: Option<String>,
}

impl Choice {
    fn new(request: &RecordRequest) -> Result<Choice, ReplayError> {
        let patterns = request.topics.iter().map(|text| {
            whole(&if text.starts_with('/') { text.clone() } else { format!("/?{text}") })
        });
        Ok(Choice {
            patterns: patterns.collect::<Result<_, _>>()?,
            exclude: request.exclude.as_deref().map(whole).transpose()?,
            node: request.node.as_deref().map(resolved),
        })
    }

    fn takes(&self, topic: &str, state: &SystemState) -> bool {
        let matches = |pattern: &Regex| pattern.is_match(topic);
        let of_node = self.node.as_ref().is_none_or(|node| {
            state.subscribers.get(topic).is_some_and(|nodes| nodes.contains(node))
        });
        let named = self.patterns.is_empty() || self.patterns.iter().any(matches);
        named && of_node && !self.exclude.as_ref().is_some_and(matches)
    }

    /// Subscribes to what is new; how many subscriptions had to be registered again with a
    /// restarted master.
    fn subscribe(&self, node: &dyn Node) -> Result<u64, GraphError> {
        let Seen { state, again } = node.look()?;
        let known: BTreeSet<String> = node.subscribed_topics().into_iter().collect();
        let unnamed = node.unnamed_topics(&state)?;
        for topic in state.publishers.keys().chain(&unnamed) {
            if !known.contains(topic) && self.takes(topic, &state) {
                node.subscribe(topic)?;
            }
        }
        Ok(again)
    }
}

/// Where messages go; its clones write into the same bag.
#[derive(Clone)]
struct Tape {
    state: Arc<Mutex<State>>,
}

struct State {
    format: Arc<dyn RecordingFormat>,
    split_bytes: u64,
    split_after: u64,
    limit: u64,
    keep: Keep,
    writer: Box<dyn RecordingWriter>,
    /// Connections of the present bag by TCPROS connection.
    links: HashMap<u64, u32>,
    /// Bytes of the present bag's messages, and the time of its first one.
    bytes: u64,
    first: u64,
    total: RecordedLive,
    failure: Option<String>,
}

impl Tape {
    fn new(request: &RecordRequest, keep: Keep) -> Tape {
        let split_after = request.split_after.map_or(u128::MAX, |after| after.as_nanos());
        let state = State {
            writer: request.record_as.writer(None),
            format: Arc::clone(&request.record_as),
            split_bytes: request.split_bytes,
            split_after: u64::try_from(split_after).unwrap_or(u64::MAX),
            limit: request.limit.unwrap_or(u64::MAX),
            keep,
            links: HashMap::new(),
            bytes: 0,
            first: 0,
            total: RecordedLive::default(),
            failure: None,
        };
        Tape { state: Arc::new(Mutex::new(state)) }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_over(&self) -> bool {
        let state = self.state();
        state.failure.is_some() || state.total.messages >= state.limit
    }

    fn finish(&self) -> Result<RecordedLive, ReplayError> {
        let mut state = self.state();
        if state.failure.is_none() {
            state.hand_over();
        }
        match &state.failure {
            Some(failure) => Err(ReplayError::Internal(failure.clone())),
            None => Ok(state.total),
        }
    }
}

impl State {
    fn hand_over(&mut self) {
        let writer = std::mem::replace(&mut self.writer, self.format.writer(None));
        self.links.clear();
        self.bytes = 0;
        let finished = writer.finish().map_err(|error| error.to_string());
        match finished.and_then(|bag| (self.keep)(bag)) {
            Ok(()) => self.total.bags += 1,
            Err(failure) => self.failure = Some(failure),
        }
    }

    fn write(&mut self, incoming: &Incoming<'_>) {
        let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let now = u64::try_from(since.as_nanos()).unwrap_or(u64::MAX);
        if self.bytes > 0 && now.saturating_sub(self.first) >= self.split_after {
            self.hand_over();
        }
        let writer = &mut self.writer;
        let id = self.links.entry(incoming.link);
        let id = *id.or_insert_with(|| writer.add_connection(&connection_of(incoming)));
        if let Err(error) = writer.write(id, now, incoming.data) {
            self.failure = Some(error.to_string());
            return;
        }
        if self.bytes == 0 {
            self.first = now;
        }
        // A message without a byte is one, too.
        let bytes = incoming.data.len().max(1) as u64;
        self.bytes += bytes;
        self.total.bytes += incoming.data.len() as u64;
        self.total.messages += 1;
        if self.bytes >= self.split_bytes {
            self.hand_over();
        }
    }
}

impl Sink for Tape {
    fn message(&mut self, incoming: Incoming<'_>) {
        let mut state = self.state();
        if state.failure.is_none() && state.total.messages < state.limit {
            state.write(&incoming);
        }
    }

    fn too_large(&mut self, topic: &str, length: u64) {
        let mut state = self.state();
        state.failure = Some(format!("a message of {length} bytes on {topic} is beyond TCPROS"));
    }
}
