//! The ledger at a moment.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_ros2ledger::{Endpoint, Kind, Ledger, LedgerError, ProcessId};

/// A node's name, and its process.
pub(super) type Owner = (ProcessId, String);

/// The ledger at a moment.
pub(crate) struct Look {
    pub(crate) endpoints: Vec<Endpoint>,
    pub(super) running: BTreeSet<ProcessId>,
    /// Whether each process that runs has taken or waited by now.
    pub(crate) all_spin: bool,
    /// Endpoints that had been listed before.
    pub(super) listed: u32,
}

impl Look {
    pub(crate) fn at(ledger: &Ledger) -> Result<Look, LedgerError> {
        let listed = ledger.listed();
        let mut processes = ledger.processes()?;
        processes.retain(|one| one.alive);
        let all_spin = processes.iter().all(|one| one.spinners > 0);
        let running = processes.iter().map(|one| one.id).collect();
        Ok(Look { endpoints: ledger.endpoints()?, running, all_spin, listed })
    }

    /// The subscriptions that are there, by whose they are.
    pub(super) fn subscriptions(&self, topic: &str) -> BTreeMap<Owner, Vec<&Endpoint>> {
        let mut nodes: BTreeMap<Owner, Vec<&Endpoint>> = BTreeMap::new();
        for one in self.there(Kind::Subscription, topic) {
            nodes.entry((one.process, one.node.clone())).or_default().push(one);
        }
        nodes
    }

    /// The endpoints of a topic that are there.
    pub(crate) fn there<'l>(
        &'l self,
        kind: Kind,
        topic: &str,
    ) -> impl Iterator<Item = &'l Endpoint> {
        let all = self.endpoints.iter().filter(move |one| one.kind == kind && one.topic == topic);
        all.filter(|one| self.is_there(one))
    }

    /// Whether an endpoint may still publish or take, or give what was published.
    pub(super) fn is_there(&self, endpoint: &Endpoint) -> bool {
        !endpoint.destroyed && self.running.contains(&endpoint.process)
    }
}
