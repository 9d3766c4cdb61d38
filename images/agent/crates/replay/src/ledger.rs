//! The ledger: what was sent, and what each subscriber got of it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{LinkState, Publication};

use crate::outcome::{Ledger, LedgerSubscriber, LedgerTopic, Strength};
use crate::play::Played;
use crate::prove::{Known, Proof};

/// Adds up. `present` are the connections that existed when the last message was played;
/// whoever came later could not have received anything and is no subscriber of the case.
pub(crate) fn ledger(
    topics: &[Arc<dyn Publication>],
    played: &[Played],
    present: &[BTreeSet<u64>],
    proof: &Proof,
) -> Ledger {
    let mut ledger = Ledger::default();
    for (at, publication) in topics.iter().enumerate() {
        let mut nodes: BTreeMap<(String, u32), LedgerSubscriber> = BTreeMap::new();
        let sent = played[at].counted;
        for link in publication.subscribers() {
            if present[at].contains(&link.id) {
                add(&mut nodes, &link, &proof.known(at, link.id));
            }
        }
        let subscribers: Vec<_> = nodes.into_values().map(|node| settle(node, sent)).collect();
        let subscribed = !subscribers.is_empty();
        let topic = LedgerTopic {
            topic: publication.info().topic.clone(),
            datatype: publication.info().datatype.clone(),
            sent: if subscribed { sent } else { 0 },
            lead_in: if subscribed { played[at].lead_in } else { 0 },
            subscribers,
        };
        ledger.sent += topic.sent;
        ledger.lead_in += topic.lead_in;
        ledger.received += topic.subscribers.iter().map(|s| s.received).min().unwrap_or(0);
        ledger.dropped += topic.subscribers.iter().map(|s| s.dropped).sum::<u64>();
        let weakest = topic.subscribers.iter().map(|line| line.strength).min();
        ledger.strength = [ledger.strength, weakest].into_iter().flatten().min();
        ledger.topics.push(topic);
    }
    ledger
}

impl Ledger {
    /// Adds how many seconds each node's threads waited for a processor.
    pub(crate) fn add_waits(&mut self, seconds: &BTreeMap<String, f64>) {
        for line in self.topics.iter_mut().flat_map(|topic| &mut topic.subscribers) {
            line.waited_seconds = seconds.get(&line.node).copied();
        }
    }
}

/// The connections of each topic.
pub(crate) fn present(topics: &[Arc<dyn Publication>]) -> Vec<BTreeSet<u64>> {
    let ids =
        |topic: &Arc<dyn Publication>| topic.subscribers().iter().map(|link| link.id).collect();
    topics.iter().map(ids).collect()
}

/// A node that left and came back has several connections and one line. Nodes that share a name
/// have a line each: what one of them got makes up for nothing that another lost.
fn add(nodes: &mut BTreeMap<(String, u32), LedgerSubscriber>, link: &LinkState, known: &Known) {
    let strength = known.strength();
    let new = || LedgerSubscriber { node: link.node.clone(), strength, ..Default::default() };
    let line = nodes.entry((link.node.clone(), link.instance)).or_insert_with(new);
    line.strength = line.strength.min(strength);
    line.received += known.reached(link);
    line.bytes += link.counted_bytes;
}

fn settle(mut line: LedgerSubscriber, sent: u64) -> LedgerSubscriber {
    line.received = line.received.min(sent);
    line.dropped = sent - line.received;
    // Whoever has called back for all that it took has nothing left to call back for.
    line.queue = (line.strength == Strength::Called).then_some(0);
    line
}
