//! The ledger: what was sent, and what each subscriber got of it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{LinkState, Publication};

use crate::outcome::{Ledger, LedgerSubscriber, LedgerTopic, Strength};
use crate::play::Played;
use crate::prove::{Known, Proof};

/// The part of a play that is waited for a subscriber, from which on it sets the pace.
const LEAST: f64 = 0.1;

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
    /// Which subscriber the play waited for the longest, at least for a tenth of these seconds that it
    /// took.
    pub(crate) fn pace(&self, played_seconds: f64) -> Option<String> {
        let lines = self.topics.iter().flat_map(|topic| {
            topic.subscribers.iter().map(move |line| (line.held_up_seconds, &topic.topic, line))
        });
        let slowest = lines.max_by(|one, other| one.0.total_cmp(&other.0));
        let (held, topic, line) = slowest.filter(|one| one.0 >= LEAST * played_seconds)?;
        if held <= 0.0 {
            return None;
        }
        let rate = line.received as f64 / played_seconds.max(held);
        let room = |most| format!(", of which at most {most} may wait at it");
        let room = line.room.map(room).unwrap_or_default();
        Some(format!(
            "{} set the pace: the play waited {held:.3} of {played_seconds:.3} s until it had taken more of \
             {topic}{room}, and it took {rate:.1} a second",
            line.node
        ))
    }

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
    let strength = known.strength(link);
    let new = || LedgerSubscriber { node: link.node.clone(), strength, ..Default::default() };
    let line = nodes.entry((link.node.clone(), link.instance)).or_insert_with(new);
    line.strength = line.strength.min(strength);
    line.received += known.reached(link);
    line.bytes += link.counted_bytes;
    line.held_up_seconds += link.held_up.as_secs_f64();
    line.room = line.room.into_iter().chain(link.room).min();
}

fn settle(mut line: LedgerSubscriber, sent: u64) -> LedgerSubscriber {
    line.received = line.received.min(sent);
    line.dropped = sent - line.received;
    // Whoever has called back for all that it took has nothing left to call back for.
    line.queue = (line.strength == Strength::Called).then_some(0);
    line
}
