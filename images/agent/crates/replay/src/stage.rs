//! How a replay plays, where it is, and why it should stop.

use std::time::Instant;

/// How fast to play.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// By bag time, `rate` times as fast.
    Realtime,
    /// As fast as the slowest subscriber's socket takes it.
    Max,
    /// The next message goes out when the subscribers have read the last one and the stack
    /// has answered it, as [`Step`](crate::Step)s say.
    Lockstep,
}

/// Why a replay should stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cancellation {
    /// The stack's process has ended.
    StackExited,
    /// The worker at the other end of the pipe is gone.
    PeerGone,
    /// The agent has been told to end.
    Terminated,
}

/// Where a replay is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Waiting for the subscribers.
    Subscribe,
    /// Playing what warms up.
    LeadIn,
    /// Playing what counts.
    Play,
    /// Waiting for the last messages and outputs.
    Drain,
}

impl Stage {
    /// Its name in METRIC frames.
    pub fn name(self) -> &'static str {
        match self {
            Stage::Subscribe => "subscribe",
            Stage::LeadIn => "lead_in",
            Stage::Play => "play",
            Stage::Drain => "drain",
        }
    }
}

/// How far a replay is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Progress {
    /// Where.
    pub stage: Stage,
    /// Messages played, the lead-in included.
    pub sent: u64,
    /// Messages recorded.
    pub recorded: u64,
    /// Bag time since the beginning of the lead-in, in seconds.
    pub bag_seconds: f64,
    /// When the window's last message went out, once that is known.
    pub last_out: Option<Instant>,
}
