//! Plays a window of a bag through the nodes of a graph, records what they answer
//! into a bag in memory, and proves what was delivered.
//!
//! The order of things is the guarantee: the recorder is connected before the first
//! input is released; every input waits for the slowest subscriber; the subscribers are
//! asked what they received while their connections still stand.
//!
//! Which middleware makes the graph stands in the request (`bagpipe-graph`).
//!
//! Not for: starting the stack or its master (the agent does), or judging the recording.
#![forbid(unsafe_code)]

mod answer_by;
mod answers;
mod batch;
mod clock;
mod discovery;
mod drain;
mod error;
mod first_time;
mod graph_recording;

mod ledger;
mod lockstep;
mod machine;
mod meter;
mod names;
mod ordered;
mod outcome;
mod pairing;
mod patience;
mod pause;
mod plan;
mod play;
mod processes;
mod prove;

mod recorder;
#[cfg(test)]
mod rehearsal;
mod replay;
mod request;

mod settle;
mod simulate;
mod spacing;
mod stage;
mod startup;
mod step;
mod subscribe;
mod time;
mod watch;
mod world;

pub use answer_by::AnswerBy;
pub use error::ReplayError;
pub use graph_recording::{Keep, RecordRequest, RecordedLive, record};
pub use machine::Machine;
pub use meter::{Meter, Reading, WAIT_BOUNDS};
pub use outcome::{
    Ledger, LedgerSubscriber, LedgerTopic, Playback, Recorded, RecordedTopic, Replayed, StepReport,
    Strength, Timings,
};
pub use pause::{Pause, Resumed};
pub use processes::descendants;
pub use replay::{replay, replay_together, simulate};
pub use request::{CLOCK_RATE, ReplayRequest, StartWhen, Step, Window};
pub use stage::{Cancellation, Mode, Progress, Stage};
pub use world::{LatestMessage, Moment, World};
