//! Why a replay failed, as the reasons of the pipe's ABORT frame and as sentences.

use std::time::Duration;

use bagpipe_graph::GraphError;
use bagpipe_log::RecordingError;

use crate::Cancellation;

/// Why a replay failed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The stack ended before the play did.
    #[error("the stack ended {during}; it must keep running until the agent stops it")]
    StackExited {
        /// When, as the end of a clause.
        during: &'static str,
    },
    /// Nobody subscribed in time.
    #[error("{0}")]
    NeverSubscribed(String),
    /// A node that was to be active did not stay so.
    #[error("{0}; a play proves nothing of a node that is not at work")]
    NodeInactive(String),
    /// A subscriber took nothing for too long.
    #[error(
        "the node {node} has taken nothing from {topic} for {:.1} s although messages wait for \
         it; {why}", waited.as_secs_f64()
    )]
    StackStoppedReading {
        /// The node.
        node: String,
        /// The topic.
        topic: String,
        /// For how long.
        waited: Duration,
        /// What it may be, as a clause.
        why: &'static str,
    },
    /// The recording is larger than allowed.
    #[error("{0}; record fewer topics, cut shorter fragments or raise the budget")]
    RecorderBudgetExceeded(String),
    /// The stack published more on recorded topics than reached the recorder.
    #[error("the recording is not whole: {}", .0.join("; "))]
    RecordingIncomplete(Vec<String>),
    /// The case took too long.
    #[error("the case's deadline passed {during}")]
    CaseDeadlineExceeded {
        /// When, as the end of a clause.
        during: &'static str,
    },
    /// A bag can't be read.
    #[error("{error}")]
    BagUnreadable {
        /// Its place among those that are played, from 0.
        bag: usize,
        /// Why.
        #[source]
        error: RecordingError,
    },
    /// The bag has one topic with two types, which no node can receive.
    #[error(
        "the topic {topic} was recorded with two types, {first} and {second}; name the topics to be played without it"
    )]
    TwoTypes {
        /// The topic.
        topic: String,
        /// Type of one, with its md5sum or, where there is none, the first field that differs.
        first: String,
        /// The same of the other.
        second: String,
    },
    /// A topic's messages are none that the graph's nodes can read.
    #[error(
        "the topic {topic} holds messages in {encoding}, and its nodes would read them as {plays}; name the topics to be played without it"
    )]
    OtherEncoding {
        /// The topic.
        topic: String,
        /// What they are.
        encoding: String,
        /// What the graph's are.
        plays: &'static str,
    },
    /// A topic's messages were compressed one by one.
    #[error("{}", bagpipe_log::packed(topic))]
    Packed {
        /// The topic.
        topic: String,
    },
    /// The graph does not answer, such as its master.
    #[error("{0}")]
    GraphFailed(#[source] GraphError),
    /// The request makes no sense.
    #[error("{0}")]
    BadRequest(String),
    /// The caller has stopped the replay.
    #[error("the replay was stopped: {0:?}")]
    Cancelled(Cancellation),
    /// Something that should not happen.
    #[error("{0}")]
    Internal(String),
}

impl ReplayError {
    /// The reason of the ABORT frame. [`ReplayError::Cancelled`] has `Terminated`, which is
    /// never sent: whoever cancelled knows.
    pub fn reason(&self) -> &'static str {
        match self {
            ReplayError::StackExited { .. } => "StackExited",
            ReplayError::NeverSubscribed(_) => "NeverSubscribed",
            ReplayError::NodeInactive(_) => "NodeInactive",
            ReplayError::StackStoppedReading { .. } => "StackStoppedReading",
            ReplayError::RecorderBudgetExceeded(_) => "RecorderBudgetExceeded",
            ReplayError::CaseDeadlineExceeded { .. } => "CaseDeadlineExceeded",
            ReplayError::BagUnreadable { .. }
            | ReplayError::TwoTypes { .. }
            | ReplayError::OtherEncoding { .. }
            | ReplayError::Packed { .. } => "BagUnreadable",
            ReplayError::GraphFailed(error) => error.reason,
            ReplayError::BadRequest(_) => "ProtocolError",
            ReplayError::Cancelled(_) => "Terminated",
            ReplayError::RecordingIncomplete(_) => "RecordingIncomplete",
            ReplayError::Internal(_) => "Internal",
        }
    }
}
