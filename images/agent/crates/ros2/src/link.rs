//! One node's subscriptions of a topic that is played, and what it has done with the messages.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{PoisonError, RwLock};

use bagpipe_graph::{LinkState, Share};
use bagpipe_ros2ledger::{Endpoint, EndpointId, History, Ledger, LedgerError, ProcessId, Strength};

/// The most messages that may wait for a node to take them, however deep its queue.
pub(crate) const MOST_WAITING: u64 = 1000;

/// A subscribing node of a topic.
#[derive(Debug)]
pub(crate) struct Link {
    id: u64,
    pub(crate) node: String,
    /// `None` where the node does not count, so that nothing is known of it.
    pub(crate) counted: Option<Subscriptions>,
    open: AtomicBool,
    lead_in: AtomicU64,
    window: AtomicU64,
    window_bytes: AtomicU64,
}

/// The subscriptions of one node, with what they had done when the link was first seen.
#[derive(Debug)]
pub(crate) struct Subscriptions {
    pub(crate) process: ProcessId,
    taken: Vec<(EndpointId, u64)>,
    /// The stack's own publishers of the topic, whose messages it takes too, with what they had
    /// published before.
    others: RwLock<BTreeMap<EndpointId, u64>>,
    /// Messages that the smallest of their queues holds.
    pub(crate) depth: u64,
    strength: Strength,
}

impl Subscriptions {
    /// Of the subscriptions of one node and the publishers of the topic, as they are now.
    pub(crate) fn new(subscriptions: &[&Endpoint], publishers: &[&Endpoint]) -> Option<Self> {
        let depth = |one: &&Endpoint| match one.qos.history {
            History::KeepLast => one.qos.depth.clamp(1, MOST_WAITING),
            History::KeepAll | History::Other(_) => MOST_WAITING,
        };
        Some(Subscriptions {
            process: subscriptions.first()?.process,
            taken: subscriptions.iter().map(|one| (one.id, one.counts.taken)).collect(),
            others: RwLock::new(
                publishers.iter().map(|one| (one.id, one.counts.published)).collect(),
            ),
            depth: subscriptions.iter().map(depth).min()?,
            strength: subscriptions.iter().map(|one| one.strength).min()?,
        })
    }

    /// Whether these are still all that there are.
    pub(crate) fn is_of(&self, subscriptions: &[&Endpoint]) -> bool {
        let ids = |known: &(EndpointId, u64)| known.0;
        self.taken.iter().map(ids).eq(subscriptions.iter().map(|one| one.id))
    }
}

impl Link {
    pub(crate) fn new(id: u64, node: String, counted: Option<Subscriptions>) -> Link {
        Link {
            id,
            node,
            counted,
            open: AtomicBool::new(true),
            lead_in: AtomicU64::new(0),
            window: AtomicU64::new(0),
            window_bytes: AtomicU64::new(0),
        }
    }

    /// Takes in which publishers of the topic the stack has by now. One that came later was not
    /// there to publish before.
    pub(crate) fn learn(&self, publishers: &[&Endpoint]) {
        let Some(counted) = &self.counted else { return };
        let mut others = counted.others.write().unwrap_or_else(PoisonError::into_inner);
        for one in publishers {
            others.entry(one.id).or_insert(0);
        }
    }

    /// Takes in that a message of so many bytes goes out.
    pub(crate) fn count(&self, share: Share, bytes: usize) {
        match share {
            Share::LeadIn => _ = self.lead_in.fetch_add(1, Ordering::Relaxed),
            Share::Counted => {
                self.window.fetch_add(1, Ordering::Relaxed);
                self.window_bytes.fetch_add(bytes as u64, Ordering::Relaxed);
            }
        }
    }

    pub(crate) fn state(&self) -> LinkState {
        LinkState {
            id: self.id,
            node: self.node.clone(),
            lead_in: self.lead_in.load(Ordering::Relaxed),
            counted: self.window.load(Ordering::Relaxed),
            counted_bytes: self.window_bytes.load(Ordering::Relaxed),
            open: self.is_open(),
        }
    }

    pub(crate) fn is_open(&self) -> bool {
        self.open.load(Ordering::Relaxed)
    }

    /// Its subscriptions are gone.
    pub(crate) fn close(&self) {
        self.open.store(false, Ordering::Relaxed);
    }

    /// Messages that went out while it was there.
    pub(crate) fn sent(&self) -> u64 {
        self.lead_in.load(Ordering::Relaxed) + self.window.load(Ordering::Relaxed)
    }

    /// Messages of ours that each of its subscriptions has taken; `None` where nobody counts. Of a
    /// topic that the stack publishes too, what it took of the others is taken off, as if it had lost
    /// none of them.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<Option<u64>, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(None) };
        let mut least = u64::MAX;
        for (id, before) in &counted.taken {
            least = least.min(ledger.counts(*id)?.taken.saturating_sub(*before));
        }
        let others = counted.others.read().unwrap_or_else(PoisonError::into_inner);
        for (id, before) in others.iter() {
            least = least.saturating_sub(ledger.counts(*id)?.published.saturating_sub(*before));
        }
        Ok(Some(least))
    }

    /// Messages that wait in the middleware or are on their way to it; 0 where nobody counts.
    pub(crate) fn waiting(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let taken = self.taken(ledger)?;
        Ok(taken.map_or(0, |taken| self.sent().saturating_sub(taken)))
    }

    /// Messages that it has taken and not done with.
    pub(crate) fn in_hand(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(0) };
        let in_hand =
            |(id, _): &(EndpointId, u64)| Ok(ledger.counts(*id)?.in_hand(counted.strength));
        counted.taken.iter().map(in_hand).sum()
    }

    /// Whether its library reports when callbacks end.
    pub(crate) fn reports_calls(&self) -> bool {
        self.counted.as_ref().is_some_and(|counted| counted.strength == Strength::Called)
    }

    /// Whether the callbacks of all that was sent have ended; `None` where it can't be known, or
    /// something may have been lost.
    pub(crate) fn called_back(&self, ledger: &Ledger) -> Result<Option<bool>, LedgerError> {
        if !self.reports_calls() {
            return Ok(None);
        }
        match (self.in_hand(ledger)?, self.waiting(ledger)?) {
            (0, 0) => Ok(Some(true)),
            (0, _) => Ok(None),
            _ => Ok(Some(false)),
        }
    }
}
