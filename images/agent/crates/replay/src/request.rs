//! What a replay is asked to do.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::Middleware;
use bagpipe_log::{Late, RecordingFormat};

use crate::{AnswerBy, Meter, Mode, Pause, ReplayError};

/// A window of bag time, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// Messages from here to `start` warm the stack up; they are counted apart.
    pub lead_in_start: u64,
    /// The first counted time.
    pub start: u64,
    /// The first time that is not counted any more.
    pub end: u64,
}

/// An input that the stack answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// The input's topic, as published to the stack.
    pub trigger: String,
    /// The topic of the answer. Steps with the same answer are inputs that are fused: one
    /// answer is expected once all of them have come.
    pub answer: String,
    /// How long to wait for the answer; when it has passed there is "no output".
    pub deadline: Duration,
    /// How an answer is matched to the input.
    pub by: AnswerBy,
    /// Whether the stack may skip the input: nothing waits for it, and its answer's absence
    /// is counted apart.
    pub optional: bool,
}

/// A replay to be done.
#[derive(Clone, Debug)]
pub struct ReplayRequest {
    /// Whose graph it is played into.
    pub middleware: Arc<dyn Middleware>,
    /// Which messages.
    pub window: Window,
    /// Recorded topics to play; empty: all of the bag.
    pub topics: Vec<String>,
    /// By recorded topic: what late subscribers get of it, where that is not as it was recorded.
    pub late: BTreeMap<String, Late>,
    /// The stack's topic name to the recorded one: the recorded topic is published as the
    /// stack's.
    pub remap: BTreeMap<String, String>,
    /// How fast.
    pub mode: Mode,
    /// What to wait for in lock-step; without meaning in other modes.
    pub steps: Vec<Step>,
    /// Bag seconds per second, in realtime; above 0.
    pub rate: f64,
    /// Regular expressions that a topic's whole name must match to be recorded.
    pub record_topics: Vec<String>,
    /// How the recording is written.
    pub record_as: Arc<dyn RecordingFormat>,
    /// The recorded bag may not be larger, in bytes.
    pub byte_budget: u64,
    /// A new file that the recording is written to chunk by chunk, instead of being kept in
    /// memory: [`crate::Replayed::recorded_bag`] is empty then.
    pub record_to: Option<PathBuf>,
    /// How long to wait for the subscribers.
    pub subscribe_deadline: Duration,
    /// How long to wait for the last messages to be received and the outputs to end; also
    /// how long a subscriber may take no byte.
    pub drain_deadline: Duration,
    /// When the case must be over.
    pub case_deadline: Instant,
    /// Whether to publish /clock.
    pub use_sim_time: bool,
    /// How often /clock ticks in realtime, per second of bag time; 0 lets it step with each
    /// message, as it does in `max` and in lock-step.
    pub clock_rate: f64,
    /// What to wait for before the first message, beside a subscriber for each topic.
    pub start: StartWhen,
    /// Where to stop until somebody says to go on.
    pub pause: Option<Pause>,
    /// Where others may see how far it is.
    pub meter: Arc<Meter>,
}

/// What else must be so before the first message goes out.
#[derive(Clone, Debug, PartialEq)]
pub struct StartWhen {
    /// These nodes have each connected to one of the played topics.
    pub nodes: Vec<String>,
    /// These topics have so many subscribers.
    pub subscribers: BTreeMap<String, usize>,
    /// Every process below this one, if it is named, has come to rest: who still starts may
    /// subscribe too. Waited for at most 2 s, since a node may work without end.
    pub at_rest_below: Option<u32>,
    /// With no topics named, no subscriber has come for this time; half a second, unless it is known
    /// before that nobody is to come.
    pub stable: Duration,
    /// So much time has passed since all of that.
    pub delay: Duration,
}

impl Default for StartWhen {
    fn default() -> Self {
        Self {
            nodes: Vec::new(),
            subscribers: BTreeMap::new(),
            at_rest_below: None,
            stable: Duration::from_millis(500),
            delay: Duration::ZERO,
        }
    }
}

/// /clock's usual rate in Hz.
pub const CLOCK_RATE: f64 = 100.0;

impl ReplayRequest {
    /// Refuses what can't be done, before anything is started.
    pub(crate) fn validate(&self) -> Result<(), ReplayError> {
        let Window { lead_in_start, start, end } = self.window;
        if lead_in_start > start || start > end {
            return Err(ReplayError::BadRequest(format!(
                "the window's times must not decrease: lead_in_start {lead_in_start}, \
                 start {start}, end {end}"
            )));
        }
        if !(self.rate.is_finite() && self.rate > 0.0) {
            return Err(ReplayError::BadRequest(format!(
                "the rate must be a number above 0, not {}",
                self.rate
            )));
        }
        if !(self.clock_rate.is_finite() && self.clock_rate >= 0.0) {
            return Err(ReplayError::BadRequest(format!(
                "/clock's rate must be a number of Hz, or 0 to step with each message, not {}",
                self.clock_rate
            )));
        }
        Ok(())
    }
}
