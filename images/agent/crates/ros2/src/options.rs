//! What it takes to join a graph.

use std::collections::BTreeMap;
use std::ffi::{OsStr, OsString};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use bagpipe_ros2ledger::Ledger;

use crate::QosOverride;
use crate::subscriptions::MOST_WAITING;

/// Names the middleware; without it ROS 2 takes its distribution's.
const IMPLEMENTATION: &str = "RMW_IMPLEMENTATION";
/// It holds back a publisher whose messages are not taken over.
const HOLDS_BACK: &str = "rmw_cyclonedds_cpp";
/// Of any other: Fast DDS has room for 512 in a reader's shared memory and for some 230 small ones at
/// its socket, and does not always send again what found none (docs/concepts/proof.md).
const MOST_IN_TRANSPORT: u64 = 128;

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
    /// Whether the stack's nodes publish no faster than their messages are taken from sockets
    /// ([`Ledger::control_flow`]).
    pub flow_control: bool,
    /// Where packages are installed, for the definitions of recorded types (AMENT_PREFIX_PATH).
    pub prefixes: Vec<PathBuf>,
    /// Until when the player must be there, and each answer of it.
    pub deadline: Duration,
}

impl Ros2Options {
    /// The most messages that may wait for a node, so that its middleware loses none on their way.
    pub(crate) fn most_waiting(&self) -> u64 {
        let set = self.environment.iter().rev().find(|(name, _)| name == IMPLEMENTATION);
        let set = set.map(|(_, value)| value.clone());
        most_waiting(set.or_else(|| std::env::var_os(IMPLEMENTATION)).as_deref())
    }
}

fn most_waiting(implementation: Option<&OsStr>) -> u64 {
    match implementation {
        Some(name) if name == HOLDS_BACK => MOST_WAITING,
        _ => MOST_IN_TRANSPORT,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_middleware_that_holds_back_publishers_is_given_more() {
        assert_eq!(most_waiting(Some(OsStr::new("rmw_cyclonedds_cpp"))), 1000);
        for other in [None, Some("rmw_fastrtps_cpp"), Some("rmw_zenoh_cpp"), Some("")] {
            assert_eq!(most_waiting(other.map(OsStr::new)), 128);
        }
    }
}
