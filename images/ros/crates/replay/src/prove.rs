//! Asking the subscribers, while their connections stand, what has reached them.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_ros::audit::{Audit, Received};
use bagpipe_ros::{LinkState, Publication};

use crate::outcome::Strength;

/// A subscriber of a topic: the topic's place and the connection's number.
type Key = (usize, u64);

/// What is known of every subscriber's connection.
pub(crate) struct Proof {
    audit: Audit,
    known: BTreeMap<Key, Known>,
}

/// What a node said of one connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Known {
    /// Its last answer.
    pub(crate) now: Option<Received>,
    /// Its answer when the lead-in had been received.
    pub(crate) lead_in: Option<Received>,
}

/// How an attempt to see everything received ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Settled {
    /// Every open connection has counted every message.
    Complete,
    /// Some have not, but nothing has changed for a while.
    Stable,
    /// Time ran out.
    Unsettled,
}

/// How a settling is waited for.
pub(crate) struct Patience {
    /// When to give up.
    pub(crate) deadline: Instant,
    /// Without a change for this time, nothing more is expected.
    pub(crate) stable: Duration,
}

impl Proof {
    pub(crate) fn new(audit: Audit) -> Proof {
        Proof { audit, known: BTreeMap::new() }
    }

    /// What is known of a connection.
    pub(crate) fn known(&self, topic: usize, link: u64) -> Known {
        self.known.get(&(topic, link)).copied().unwrap_or_default()
    }

    /// Asks every node with an open connection once. A node that does not answer keeps its
    /// last figures: what can't be proved will count as lost.
    pub(crate) fn ask(&mut self, topics: &[Arc<Publication>]) {
        let mut links: BTreeMap<String, BTreeMap<String, Key>> = BTreeMap::new();
        for (at, publication) in topics.iter().enumerate() {
            for link in publication.subscribers().into_iter().filter(|link| link.open) {
                let of_node = links.entry(link.node).or_default();
                of_node.insert(publication.info().topic.clone(), (at, link.id));
            }
        }
        for (node, keys) in links {
            let names: Vec<String> = keys.keys().cloned().collect();
            let Ok(answer) = self.audit.ask(&node, &names) else { continue };
            for (topic, received) in answer {
                if let Some(key) = keys.get(&topic) {
                    self.known.entry(*key).or_default().now = Some(received);
                }
            }
        }
    }

    /// Asks until every node has everything, or nothing changes any more, or time runs
    /// out, or `stop` (which may also sleep between two rounds) says so.
    pub(crate) fn settle<E>(
        &mut self,
        topics: &[Arc<Publication>],
        patience: &Patience,
        mut pause: impl FnMut() -> Result<bool, E>,
    ) -> Result<Settled, E> {
        let mut before = None;
        let mut changed = Instant::now();
        loop {
            self.ask(topics);
            let (complete, figures) = self.figures(topics);
            let same = before.as_ref() == Some(&figures);
            if same && complete {
                // Twice the same: roscpp counts a message before it counts its drop.
                return Ok(Settled::Complete);
            }
            let now = Instant::now();
            if !same {
                (before, changed) = (Some(figures), now);
            }
            let waiting: u64 = topics.iter().map(|topic| topic.unsent()).sum();
            if waiting == 0 && now.duration_since(changed) >= patience.stable {
                return Ok(Settled::Stable);
            }
            if now >= patience.deadline || pause()? {
                return Ok(Settled::Unsettled);
            }
        }
    }

    /// Remembers the present figures as those of the lead-in. They are the truth if they
    /// can't change any more; otherwise all of the lead-in is taken as received, so that
    /// what was lost of it counts as lost.
    pub(crate) fn end_lead_in(&mut self, topics: &[Arc<Publication>], settled: Settled) {
        for (at, publication) in topics.iter().enumerate() {
            for link in publication.subscribers() {
                let known = self.known.entry((at, link.id)).or_default();
                let final_now = known
                    .now
                    .filter(|now| settled != Settled::Unsettled || now.messages == link.lead_in);
                known.lead_in = final_now;
            }
        }
    }

    /// Whether every open connection has counted everything, and the figures.
    fn figures(&self, topics: &[Arc<Publication>]) -> (bool, Vec<Option<Received>>) {
        let mut complete = true;
        let mut figures = Vec::new();
        for (at, publication) in topics.iter().enumerate() {
            for link in publication.subscribers().into_iter().filter(|link| link.open) {
                let now = self.known(at, link.id).now;
                let sent = link.lead_in + link.counted;
                complete &= now.is_some_and(|now| now.messages >= sent);
                figures.push(now);
            }
        }
        (complete, figures)
    }
}

impl Known {
    /// What the node's word proves. roscpp counts what it reads from its socket and what its
    /// queues throw away; the rest may still wait in them. rospy counts what it takes for the
    /// callback, and runs that afterwards.
    pub(crate) fn strength(&self) -> Strength {
        match self.now {
            None => Strength::Sent,
            Some(Received { drops: Some(_), .. }) => Strength::Received,
            Some(Received { drops: None, .. }) => Strength::Taken,
        }
    }

    /// Messages of the window that reached the callback.
    pub(crate) fn reached(&self, link: &LinkState) -> u64 {
        let Some(now) = self.now else { return 0 };
        let reached = match now.drops {
            // roscpp reads everything, in order: what it read beyond the lead-in is counted.
            Some(drops) => {
                let before = self.lead_in.and_then(|lead_in| lead_in.drops).unwrap_or(0);
                now.messages.saturating_sub(link.lead_in).saturating_sub(drops - before.min(drops))
            }
            // rospy says what reached the callback, so what the lead-in lost is not in it.
            None => {
                let before = self.lead_in.map_or(link.lead_in, |lead_in| lead_in.messages);
                now.messages.saturating_sub(before)
            }
        };
        reached.min(link.counted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(lead_in: u64, counted: u64) -> LinkState {
        LinkState { id: 1, node: "/n".into(), lead_in, counted, counted_bytes: 0, open: true }
    }

    fn said(messages: u64, drops: Option<u64>) -> Option<Received> {
        Some(Received { messages, drops })
    }

    #[test]
    fn losses_of_the_lead_in_do_not_count_where_they_can_be_told_apart() {
        let roscpp = Known { now: said(110, Some(7)), lead_in: said(10, Some(4)) };
        assert_eq!(roscpp.reached(&link(10, 100)), 97);
        let rospy = Known { now: said(106, None), lead_in: said(6, None) };
        assert_eq!(rospy.reached(&link(10, 100)), 100);
    }

    #[test]
    fn what_is_not_proved_is_not_received() {
        assert_eq!(Known::default().reached(&link(0, 100)), 0);
        let unsettled = Known { now: said(106, None), lead_in: None };
        assert_eq!(unsettled.reached(&link(10, 100)), 96);
        let unsettled = Known { now: said(110, Some(7)), lead_in: None };
        assert_eq!(unsettled.reached(&link(10, 100)), 93);
    }
}
