//! What it takes to join a graph.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use bagpipe_ros2ledger::Ledger;

use crate::QosOverride;

/// How a graph is joined.
#[derive(Clone)]
pub struct Ros2Options {
    /// What the stack's nodes count in: they were started with its environment, while it watched
    /// matches ([`Ledger::watch_matches`]).
    pub ledger: Arc<Ledger>,
    /// A file with [`bagpipe_ros2player::PROGRAM`] or [`bagpipe_ros2player::DDS_PROGRAM`].
    pub program: PathBuf,
    /// The player's variables beside those of this process, such as the domain's number.
    pub environment: Vec<(OsString, OsString)>,
    /// Quality of service by topic, in place of what was recorded.
    pub qos: BTreeMap<String, QosOverride>,
    /// Nodes with a life cycle that have to be active before the play, and as long as it lasts.
    pub active: Vec<String>,
    /// Where packages are installed, for the definitions of recorded types (AMENT_PREFIX_PATH).
    pub prefixes: Vec<PathBuf>,
    /// Until when the player must be there, and each answer of it.
    pub deadline: Duration,
}
