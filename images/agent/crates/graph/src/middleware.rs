//! A middleware, and our node in its graph.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Debug;
use std::sync::Arc;
use std::time::Duration;

use crate::{Audit, GraphError, Publication, ReadStamp, Sink, TopicInfo};

/// One graph of a middleware, and how its messages are written.
pub trait Middleware: Debug + Send + Sync {
    /// Makes a node whose received messages go to `sink`. The graph need not be there yet.
    ///
    /// # Errors
    /// The graph's address is unusable, or a socket or thread can't be had.
    fn join(&self, options: NodeOptions, sink: Box<dyn Sink>) -> Result<Box<dyn Node>, GraphError>;

    /// What the bytes of its messages are, by the name that recordings have for it, such as `ros1`.
    fn encoding(&self) -> &'static str;

    /// The language of its messages' definitions, by the name that recordings have for it, such as
    /// `ros1msg`.
    fn schema_encoding(&self) -> &'static str;

    /// How to read the stamps of messages of this definition; `None` if they have none.
    fn read_stamp(&self, definition: &str) -> Option<ReadStamp>;

    /// The topic of simulated time.
    fn clock_topic(&self) -> TopicInfo;

    /// The frame of a simulated time in nanoseconds.
    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8>;
}

/// How a node is made.
#[derive(Clone, Debug)]
pub struct NodeOptions {
    /// Its name, such as `/bagpipe_player_17`; unique in its graph.
    pub name: String,
    /// The deadline of every call and handshake.
    pub call_deadline: Duration,
    /// How long a subscriber may take no byte before a send fails.
    pub stall: Duration,
    /// The largest message accepted from a publisher, in bytes; the middleware may have a lower
    /// limit of its own.
    pub max_message: usize,
    /// What says when a message may go out.
    pub paced_by: PacedBy,
}

/// What says when a message may go out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PacedBy {
    /// Its time: a subscriber whose queue is full then may lose some.
    #[default]
    Schedule,
    /// Its subscribers: where a middleware drops what a queue has no room for, sending waits until
    /// every queue has.
    Subscribers,
}

/// Our node; dropping it takes it out of the graph and ends its threads.
pub trait Node: Send + Sync {
    /// Its name in the graph.
    fn name(&self) -> &str;

    /// Advertises a topic: subscribers may connect from now on.
    ///
    /// # Errors
    /// The graph does not answer or refuses.
    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Publication>, GraphError>;

    /// Subscribes to a topic of any type; publishers are connected to in the background.
    /// Subscribing again changes nothing. Our own publications are never received.
    ///
    /// # Errors
    /// The graph does not answer or refuses.
    fn subscribe(&self, topic: &str) -> Result<(), GraphError>;

    /// Looks who publishes and subscribes now, and registers again what the graph has lost of
    /// ours. Open connections are left as they are.
    ///
    /// # Errors
    /// The graph does not answer or refuses; the rest is left for the next time.
    fn look(&self) -> Result<Seen, GraphError>;

    /// The topics that others publish now and that have no publisher in this state, as no name of a node leads to
    /// them.
    ///
    /// # Errors
    /// The graph does not answer or refuses.
    fn unnamed_topics(&self, _state: &SystemState) -> Result<Vec<String>, GraphError> {
        Ok(Vec::new())
    }

    /// What else must be there before the play and is not, as what is waited for, such as
    /// `/planner to be active (it is inactive)`; by the last [`Node::look`].
    fn absent(&self) -> Vec<String> {
        Vec::new()
    }

    /// Whether it is known of every other node that it does its work, and no more prepares for it, by
    /// the last [`Node::look`]; and of these processes that none is still to have one.
    fn all_spin(&self, _processes: &BTreeSet<i32>) -> bool {
        false
    }

    /// That the play begins, from which on that must stay there ([`Sink::broken`]); what is not there
    /// by now, as above.
    fn begin(&self) -> Vec<String> {
        Vec::new()
    }

    /// What to show a user whose graph lost so many of our registrations.
    fn restarted(&self, again: u64) -> String;

    /// The topics subscribed to.
    fn subscribed_topics(&self) -> Vec<String>;

    /// How many publishers of a topic we read from.
    fn publishers_of(&self, topic: &str) -> usize;

    /// The connections to publishers that latch although their introductions had it otherwise. Each
    /// that may be such is asked once more, and is left out if it does not answer within `limit`.
    fn latching_after_all(&self, _limit: Duration) -> BTreeSet<u64> {
        BTreeSet::new()
    }

    /// Waits until everything that has reached us by now has been handed to the sink, at most
    /// for `limit`. Where [`Node::counts_publishes`], all that was published by now.
    fn sweep(&self, limit: Duration);

    /// Whether it is known what the others publish, so that a sweep is exact.
    fn counts_publishes(&self) -> bool {
        false
    }

    /// What the user should know of how it went, as sentences.
    fn remarks(&self) -> Vec<String> {
        Vec::new()
    }

    /// Why what others publish in lock-step may differ from run to run, as sentences; none where nobody
    /// knows.
    fn undetermined(&self) -> Vec<String> {
        Vec::new()
    }

    /// What others have published on the topics subscribed to and did not reach us, as sentences;
    /// none where nobody counts it.
    fn lacking(&self) -> Vec<String> {
        Vec::new()
    }

    /// Questions to our subscribers, each answered within `deadline`.
    fn audit(&self, deadline: Duration) -> Box<dyn Audit>;
}

/// The graph at a moment.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Seen {
    /// Who publishes and subscribes.
    pub state: SystemState,
    /// Registrations of ours that had been lost and were made again.
    pub again: u64,
}

/// Who publishes and who subscribes.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SystemState {
    /// Publishing nodes by topic.
    pub publishers: BTreeMap<String, Vec<String>>,
    /// Subscribing nodes by topic.
    pub subscribers: BTreeMap<String, Vec<String>>,
}
