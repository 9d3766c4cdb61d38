//! What the subscribers say that they received.

use std::collections::{BTreeMap, BTreeSet};

use crate::GraphError;

/// What a node says of one of its links.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Received {
    /// Messages counted by the node: read from the socket, or taken for the callback where it
    /// does not count drops.
    pub messages: u64,
    /// Messages that its queues threw away; `None` if the node does not count them.
    pub drops: Option<u64>,
}

impl Received {
    /// Messages that reached the callback, or a queue in front of it.
    pub fn reached(&self) -> u64 {
        self.messages.saturating_sub(self.drops.unwrap_or(0))
    }
}

/// Asks nodes, each within the deadline that it was made with. Figures may vanish with a link: ask
/// while the connections stand, unless it [outlives](Audit::outlives_nodes) them.
pub trait Audit: Send {
    /// What `node` has received from us over these connections, which are given and answered by
    /// topic and number, the oldest first. One of which nothing is known is absent.
    ///
    /// # Errors
    /// The node is not known, does not answer, or refuses.
    fn ask(
        &mut self,
        node: &str,
        links: &BTreeMap<String, Vec<u64>>,
    ) -> Result<BTreeMap<(String, u64), Received>, GraphError>;

    /// Whether figures of nodes that are gone can be asked for as well.
    fn outlives_nodes(&self) -> bool {
        false
    }

    /// The process that a node runs in.
    ///
    /// # Errors
    /// As [`Audit::ask`].
    fn pid(&mut self, node: &str) -> Result<i32, GraphError>;

    /// Topic and subscriber of each connection that a node sends over.
    ///
    /// # Errors
    /// As [`Audit::ask`].
    fn subscribers(&mut self, node: &str) -> Result<BTreeSet<(String, String)>, GraphError>;
}
