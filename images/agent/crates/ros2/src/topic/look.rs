//! The ledger at a moment.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use bagpipe_ros2ledger::{Endpoint, Kind, Ledger, LedgerError, ProcessId};

use crate::qos::reaches;

/// A node's name, and its process.
pub(super) type Owner = (ProcessId, String);

/// The ledger at a moment.
pub(crate) struct Look {
    /// The later the greater.
    pub(super) number: u64,
    pub(crate) endpoints: Vec<Endpoint>,
    pub(super) running: BTreeSet<ProcessId>,
    /// Processes that run and have neither taken nor waited by now.
    unspun: BTreeSet<ProcessId>,
    /// Endpoints that had been listed before.
    pub(super) listed: u32,
}

impl Look {
    pub(crate) fn at(ledger: &Ledger) -> Result<Look, LedgerError> {
        // Else what was read first could have the greater number, and be taken for what is so now.
        static LOOKS: Mutex<u64> = Mutex::new(0);
        let mut looks = LOOKS.lock().unwrap_or_else(PoisonError::into_inner);
        *looks += 1;
        let listed = ledger.listed();
        let mut processes = ledger.processes()?;
        processes.retain(|one| one.alive);
        let unspun = processes.iter().filter(|one| one.spinners == 0).map(|one| one.id).collect();
        let running = processes.iter().map(|one| one.id).collect();
        let endpoints = ledger.endpoints()?;
        Ok(Look { number: *looks, endpoints, running, unspun, listed })
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
        self.all_there().filter(move |one| one.kind == kind && one.topic == topic)
    }

    /// How many endpoints of the stack one of them can match.
    pub(crate) fn counterparts(&self, of: &Endpoint) -> usize {
        let (kind, can_match): (_, fn(&Endpoint, &Endpoint) -> bool) = match of.kind {
            Kind::Publisher => (Kind::Subscription, |of, other| reaches(&of.qos, &other.qos)),
            Kind::Subscription => (Kind::Publisher, |of, other| reaches(&other.qos, &of.qos)),
        };
        self.there(kind, &of.topic).filter(|other| can_match(of, other)).count()
    }

    /// Whether each process that runs has taken or waited by now.
    pub(crate) fn all_spin(&self) -> bool {
        self.unspun.is_empty()
    }

    /// Whether an endpoint's process does so: one that only publishes never reports whom it has matched.
    pub(crate) fn spins(&self, endpoint: &Endpoint) -> bool {
        !self.unspun.contains(&endpoint.process)
    }

    /// The endpoints that are there.
    pub(crate) fn all_there(&self) -> impl Iterator<Item = &Endpoint> {
        self.endpoints.iter().filter(|one| self.is_there(one))
    }

    /// Whether an endpoint may still publish or take, or give what was published.
    pub(crate) fn is_there(&self, endpoint: &Endpoint) -> bool {
        !endpoint.destroyed && self.running.contains(&endpoint.process)
    }
}
