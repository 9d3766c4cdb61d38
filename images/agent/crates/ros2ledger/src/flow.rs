//! Whether nodes wait for room in their receivers' sockets when they publish.

use std::sync::atomic::Ordering::SeqCst;

use crate::Ledger;

/// How what the nodes publish goes out within one machine, where the kernel throws away what a socket has no
/// room for: of a message that is larger than its reader's socket some always, if nobody waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u32)]
pub enum Flow {
    /// At once, as without a ledger.
    #[default]
    Free,
    /// No faster than it is taken from the sockets: a call that publishes waits, for who takes nothing a second.
    Controlled,
    /// The same, but 20 ms at the most and a fourth of the time, since nodes wait for what is due.
    ByTheClock,
}

impl Ledger {
    /// How what is published goes out from now on. It concerns what is sent within `rmw_publish` of Cyclone DDS to
    /// the machine's own addresses (IPv4), not repetitions nor what threads of the middleware send. Fast DDS holds
    /// what its threads that receive need while it sends, so that two nodes would wait for each other.
    pub fn control_flow(&self, flow: Flow) {
        self.memory.header.flow.store(flow as u32, SeqCst);
    }

    /// How what is published goes out; what a node has written that is none of these is [`Flow::Free`].
    pub fn flow(&self) -> Flow {
        let all = [Flow::Free, Flow::Controlled, Flow::ByTheClock];
        let found = self.memory.header.flow.load(SeqCst);
        all.into_iter().find(|one| *one as u32 == found).unwrap_or_default()
    }
}
