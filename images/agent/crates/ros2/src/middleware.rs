//! ROS 2 behind the seam of `bagpipe-graph`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::{self, Debug};
use std::path::PathBuf;
use std::sync::Arc;

use bagpipe_graph::{GraphError, Middleware, NodeOptions, ReadStamp, Sink, TopicInfo};
use bagpipe_ros2ledger::Ledger;

use crate::node::Graph;
use crate::{QosOverride, clock, stamp};

/// The graph of one domain, on this machine.
#[derive(Clone)]
pub struct Ros2 {
    /// What the stack's nodes count in: they were started with its environment, while it watched
    /// matches ([`Ledger::watch_matches`]).
    pub ledger: Arc<Ledger>,
    /// A file with [`bagpipe_ros2player::PROGRAM`].
    pub program: PathBuf,
    /// The player's variables beside those of this process, such as the domain's number.
    pub environment: Vec<(OsString, OsString)>,
    /// Quality of service by topic, in place of what was recorded.
    pub qos: BTreeMap<String, QosOverride>,
    /// Where packages are installed, for the definitions of recorded types (AMENT_PREFIX_PATH).
    pub prefixes: Vec<PathBuf>,
}

impl Debug for Ros2 {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Ros2 { program, qos, prefixes, .. } = self;
        let mut shown = formatter.debug_struct("Ros2");
        shown.field("program", program).field("qos", qos).field("prefixes", prefixes);
        shown.finish_non_exhaustive()
    }
}

impl Middleware for Ros2 {
    fn join(
        &self,
        options: NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Box<dyn bagpipe_graph::Node>, GraphError> {
        Ok(Box::new(Graph::join(self, &options, sink)?))
    }

    fn encoding(&self) -> &'static str {
        "cdr"
    }

    fn read_stamp(&self, definition: &str) -> Option<ReadStamp> {
        stamp::reader(definition)
    }

    fn clock_topic(&self) -> TopicInfo {
        clock::clock_topic()
    }

    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8> {
        clock::clock_frame(nanoseconds)
    }
}
