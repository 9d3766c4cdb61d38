//! An advertised topic and its subscribers.

use std::sync::Arc;
use std::time::Duration;

/// What a publisher says about its topic.
#[derive(Clone, Debug, Default)]
pub struct TopicInfo {
    /// Resolved name, with its leading slash.
    pub topic: String,
    /// Message type, such as `sensor_msgs/JointState`.
    pub datatype: String,
    /// MD5 sum of the message definition, 32 hex digits.
    pub md5sum: String,
    /// Full text of the message definition.
    pub definition: Arc<str>,
    /// Whether late subscribers get the last message.
    pub latching: bool,
    /// The recorded publishers' quality of service, as ROS 2's recorder wrote it down (YAML).
    pub offered_qos: Option<String>,
}

/// Which part of a case a message belongs to; the ledger counts them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Share {
    /// Warm-up before the window, and latched messages in force at its start.
    LeadIn,
    /// The window itself.
    Counted,
}

/// Why a frame could not be sent.
#[derive(Debug, PartialEq)]
pub enum SendError {
    /// A subscriber took no byte for the whole stall limit.
    Stalled {
        /// The subscribing node.
        node: String,
        /// The topic.
        topic: String,
        /// How long it took nothing.
        waited: Duration,
        /// What it may be, as a clause.
        why: &'static str,
    },
    /// `cancelled` returned true.
    Cancelled,
    /// The graph has failed.
    Failed {
        /// The reason of the ABORT frame, such as `Ros2Failed`.
        reason: &'static str,
        /// What has happened, as a sentence.
        what: String,
    },
}

/// Why a subscriber takes nothing of which no more is known, for [`SendError::Stalled`].
pub const HANGS: &str = "it hangs, or its callback never returns";

/// One subscriber's connection, as seen from here.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinkState {
    /// Distinguishes connections of the same node.
    pub id: u64,
    /// The subscriber's node name.
    pub node: String,
    /// Distinguishes nodes of one name that are there at the same time: 0 of the first. Where a
    /// graph has each name once, 0.
    pub instance: u32,
    /// Lead-in messages sent to it.
    pub lead_in: u64,
    /// Counted messages sent to it.
    pub counted: u64,
    /// Bytes of the counted messages, without the length prefixes.
    pub counted_bytes: u64,
    /// Whether the connection still stands.
    pub open: bool,
    /// How long was waited until it had room for more, since the first counted message.
    pub held_up: Duration,
    /// The most messages that may wait at it; `None` where no queue of its own bounds them.
    pub room: Option<u64>,
}

/// What is known of one subscriber's connection without asking its node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FarEnd {
    /// The connection, as in [`LinkState`].
    pub id: u64,
    /// Bytes that the subscriber has not read, in our socket or in its own.
    pub unread: u64,
    /// Whether the callbacks of all that it took have ended; `None` where nobody counts them.
    pub called_back: Option<bool>,
    /// The number of its socket, if it is on this machine.
    pub inode: Option<u32>,
}

/// Asked now and then whether to give up.
pub type Cancelled<'a> = &'a mut dyn FnMut() -> bool;

/// Where messages of a topic go out.
pub trait Outlet {
    /// The topic's name, with its leading slash.
    fn topic(&self) -> &str;

    /// Keeps a frame as the last one of `publisher`, for subscribers yet to come.
    fn latch(&self, publisher: &str, share: Share, frame: &[u8]);

    /// Sends frames, in order, to every open subscriber and waits for the slowest. A subscriber
    /// that has closed its connection is marked and skipped.
    ///
    /// # Errors
    /// [`SendError::Stalled`] when a subscriber takes no byte for the stall limit;
    /// [`SendError::Cancelled`] when `cancelled`, asked at least every 20 ms while waiting,
    /// says so. Either may leave part of a frame on its way: the case is over then.
    fn send(
        &self,
        share: Share,
        frames: &[&[u8]],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError>;

    /// Waits until no more than `window` bytes of what was sent are unread. For subscribers on
    /// other machines: have not reached their kernels.
    ///
    /// # Errors
    /// As [`Outlet::send`].
    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError>;
}

/// An outlet whose subscribers can be looked at.
pub trait Publication: Outlet + Send + Sync {
    /// What was advertised.
    fn info(&self) -> &TopicInfo;

    /// Every subscriber that ever connected, also those that have left.
    fn subscribers(&self) -> Vec<LinkState>;

    /// Bytes that the subscribers' kernels have not yet acknowledged.
    fn unsent(&self) -> u64;

    /// The other end of every open connection that the kernel knows.
    fn far_ends(&self) -> Vec<FarEnd>;

    /// Subscribers that were refused, as sentences: they wanted another type.
    fn refused(&self) -> Vec<String>;
}
