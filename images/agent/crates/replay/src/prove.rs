//! Asking the subscribers, while their connections stand, what has reached them.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{Audit, FarEnd, LinkState, Publication, Received};

use crate::outcome::Strength;
use crate::patience::{Patience, Round, Settled};
use crate::processes::Sockets;
use crate::time::Time;

/// A subscriber of a topic: the topic's place and the connection's number.
type Key = (usize, u64);

/// The places of topics, by the names that connections have where a node is asked.
type Places = BTreeMap<(String, u64), usize>;

/// What is known of every subscriber's connection.
pub(crate) struct Proof {
    audit: Box<dyn Audit>,
    known: BTreeMap<Key, Known>,
    /// The nodes' processes, as far as they name them.
    pids: BTreeMap<String, i32>,
}

/// What a node reported about one connection.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Known {
    /// Its last answer.
    pub(crate) now: Option<Received>,
    /// Its answer when the lead-in had been received.
    pub(crate) lead_in: Option<Received>,
    /// Where the node was just before its last answer.
    pub(crate) place: Place,
    /// Whether the node answered every message in lock-step.
    pub(crate) answered: bool,
    /// All that had been sent when the node had counted as many before it was found back. What it does
    /// later, as with what others publish, makes nothing of that uncalled.
    pub(crate) called: Option<u64>,
}

/// Where a subscriber is with what was sent to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Place {
    /// It can't be determined.
    #[default]
    Unknown,
    /// It has not read everything yet.
    Unread,
    /// It has read everything, and no thread of it waits for more: its callback runs.
    Away,
    /// It has read everything, and a thread of it waits at the socket again. Where the thread
    /// that reads also calls, as in rospy, all callbacks have returned. In ROS 2, where calls are
    /// counted: they have.
    Back,
}

impl Proof {
    pub(crate) fn new(audit: Box<dyn Audit>) -> Proof {
        Proof { audit, known: BTreeMap::new(), pids: BTreeMap::new() }
    }

    /// Learns where nodes run. One that does not say is known by its words alone.
    pub(crate) fn meet(&mut self, nodes: &BTreeSet<String>) -> BTreeMap<String, i32> {
        for node in nodes {
            if let Ok(pid) = self.audit.pid(node) {
                self.pids.insert(node.clone(), pid);
            }
        }
        self.pids.clone()
    }

    /// Takes in that a node has answered every message of a topic in lock-step. Where others than the
    /// nodes count, who has had fewer has answered something else.
    pub(crate) fn answered(&mut self, topic: usize, link: &LinkState) {
        let all = link.lead_in + link.counted;
        let counted = self.audit.outlives_nodes();
        let known = self.known.entry((topic, link.id)).or_default();
        known.answered = !(counted && known.now.is_some_and(|now| now.messages < all));
    }

    /// What is known of a connection.
    pub(crate) fn known(&self, topic: usize, link: u64) -> Known {
        self.known.get(&(topic, link)).copied().unwrap_or_default()
    }

    /// Asks every node with an open connection once, and those without where somebody knows their
    /// figures. A node that does not answer keeps its last ones: what can't be proved will count as
    /// lost.
    pub(crate) fn ask(&mut self, topics: &[Arc<dyn Publication>]) {
        let mut nodes: BTreeMap<String, BTreeMap<String, Vec<u64>>> = BTreeMap::new();
        let mut places = Places::new();
        let seen = self.see(topics);
        for (at, publication) in topics.iter().enumerate() {
            let topic = &publication.info().topic;
            let can_be_asked = |link: &LinkState| link.open || self.audit.outlives_nodes();
            for link in publication.subscribers().into_iter().filter(can_be_asked) {
                let of_node = nodes.entry(link.node).or_default();
                of_node.entry(topic.clone()).or_default().push(link.id);
                places.insert((topic.clone(), link.id), at);
            }
        }
        for (node, links) in nodes {
            let Ok(answer) = self.audit.ask(&node, &links) else { continue };
            if self.audit.outlives_nodes() {
                self.forget(&links, &places);
            }
            for (link, received) in answer {
                let Some(at) = places.get(&link) else { continue };
                let key = (*at, link.1);
                let known = self.known.entry(key).or_default();
                known.now = Some(received);
                // Of who is gone nobody sees where it was in the end.
                if !seen.contains_key(&key) {
                    known.place = Place::Unknown;
                }
            }
        }
        // Where somebody was says nothing of what was sent to it in the meantime.
        for (key, sent) in sent(topics) {
            if seen.get(&key) != Some(&sent) {
                self.known.entry(key).or_default().place = Place::Unknown;
            }
        }
    }

    /// Asks once more where nobody has to answer: what waited behind another callback may have been taken.
    pub(crate) fn ask_again(&mut self, topics: &[Arc<dyn Publication>]) {
        if self.audit.outlives_nodes() {
            self.ask(topics);
        }
    }

    /// Takes in who had counted all that had been sent, by its last answer, and is back.
    fn note_called(&mut self, sent: &BTreeMap<Key, u64>) {
        for (key, all) in sent {
            if let Some(known) = self.known.get_mut(key)
                && known.place == Place::Back
                && known.now.is_some_and(|now| now.messages >= *all)
            {
                known.called = Some(*all);
            }
        }
    }

    /// Of who is asked where nodes have no say, what is not answered is not known any more.
    fn forget(&mut self, links: &BTreeMap<String, Vec<u64>>, places: &Places) {
        for (topic, numbers) in links {
            for number in numbers {
                let Some(at) = places.get(&(topic.clone(), *number)) else { continue };
                if let Some(known) = self.known.get_mut(&(*at, *number)) {
                    known.now = None;
                }
            }
        }
    }

    /// Looks where the subscribers are, without asking them. What had been sent to each.
    pub(crate) fn see(&mut self, topics: &[Arc<dyn Publication>]) -> BTreeMap<Key, u64> {
        let sent = sent(topics);
        let ends: Vec<Vec<FarEnd>> = topics.iter().map(|topic| topic.far_ends()).collect();
        let mut looks = BTreeMap::new();
        for (at, (publication, ends)) in topics.iter().zip(ends).enumerate() {
            for link in publication.subscribers().into_iter().filter(|link| link.open) {
                let end = ends.iter().find(|end| end.id == link.id);
                let place =
                    end.map_or(Place::Unknown, |end| self.place(&link.node, end, &mut looks));
                self.known.entry((at, link.id)).or_default().place = place;
            }
        }
        self.note_called(&sent);
        sent
    }

    /// Where a node is with what was sent to it. Unread bytes are looked for first, in all
    /// topics: who has none and then waits at the socket has nothing else to do for it. `looks`
    /// has one at each process.
    fn place(&self, node: &str, end: &FarEnd, looks: &mut BTreeMap<i32, Sockets>) -> Place {
        if end.unread > 0 {
            return Place::Unread;
        }
        if let Some(called_back) = end.called_back {
            return if called_back { Place::Back } else { Place::Away };
        }
        let (Some(&pid), Some(inode)) = (self.pids.get(node), end.inode) else {
            return Place::Unknown;
        };
        match looks.entry(pid).or_insert_with(|| Sockets::of(pid)).wait(inode) {
            None => Place::Unknown,
            Some(true) => Place::Back,
            Some(false) => Place::Away,
        }
    }

    /// Whether a subscriber is seen to be on its way to more than it has counted, or in a
    /// callback.
    pub(crate) fn busy(&self, topics: &[Arc<dyn Publication>]) -> bool {
        self.open(topics).iter().any(|(known, _)| known.busy())
    }

    /// Asks until every node has everything, or nothing changes any more, or time runs
    /// out, or `pause` (which may also sleep between two rounds) says so.
    pub(crate) fn settle<E>(
        &mut self,
        topics: &[Arc<dyn Publication>],
        patience: &Patience,
        time: &Time,
        pause: impl FnMut() -> Result<bool, E>,
    ) -> Result<Settled, E> {
        let ask = || {
            self.ask(topics);
            let (complete, figures) = self.figures(topics);
            Round { figures, complete, busy: self.busy(topics) }
        };
        patience.settle(time, ask, pause)
    }

    /// Remembers the present figures as those of the lead-in, where they can't change any
    /// more. Otherwise all of the lead-in is taken as received, so that what was lost of it
    /// counts as lost: figures that have merely stood still for a while prove nothing, since a
    /// first callback may take its time.
    pub(crate) fn end_lead_in(&mut self, topics: &[Arc<dyn Publication>]) {
        for (at, publication) in topics.iter().enumerate() {
            for link in publication.subscribers() {
                let known = self.known.entry((at, link.id)).or_default();
                known.lead_in = known.now.filter(|now| known.is_final(now, &link));
            }
        }
    }

    /// Whether no open connection's figures can change, and the figures.
    fn figures(&self, topics: &[Arc<dyn Publication>]) -> (bool, Vec<Option<Received>>) {
        let open = self.open(topics);
        let complete = open
            .iter()
            .all(|(known, link)| known.now.is_some_and(|now| known.is_final(&now, link)));
        (complete, open.iter().map(|(known, _)| known.now).collect())
    }

    /// What is known of every open connection.
    fn open(&self, topics: &[Arc<dyn Publication>]) -> Vec<(Known, LinkState)> {
        let links = topics.iter().enumerate().flat_map(|(at, publication)| {
            let links = publication.subscribers().into_iter().filter(|link| link.open);
            links.map(move |link| (at, link))
        });
        links.map(|(at, link)| (self.known(at, link.id), link)).collect()
    }
}

/// What was sent to every open connection.
fn sent(topics: &[Arc<dyn Publication>]) -> BTreeMap<Key, u64> {
    let all = topics.iter().enumerate().flat_map(|(at, publication)| {
        let links = publication.subscribers().into_iter().filter(|link| link.open);
        links.map(move |link| ((at, link.id), link.lead_in + link.counted))
    });
    all.collect()
}

impl Known {
    /// What the node's word proves. roscpp counts what it reads from its socket and what its
    /// queues throw away; the rest may still wait in them. rospy counts what it takes for the
    /// callback, and runs that afterwards on the thread that reads.
    pub(crate) fn strength(&self, link: &LinkState) -> Strength {
        let called = self.place == Place::Back || self.called == Some(link.lead_in + link.counted);
        match self.now {
            None => Strength::Sent,
            Some(_) if self.answered => Strength::Called,
            Some(Received { drops: Some(_), .. }) => Strength::Received,
            Some(Received { drops: None, .. }) if called => Strength::Called,
            Some(Received { drops: None, .. }) => Strength::Taken,
        }
    }

    /// Whether what the node says can't change any more: it has counted all that was sent, or
    /// it has lost some and waits for more.
    fn is_final(&self, now: &Received, link: &LinkState) -> bool {
        let waits_for_more = now.drops.is_none() && self.place == Place::Back;
        now.messages >= link.lead_in + link.counted || waits_for_more
    }

    /// Whether it is seen to have something to do with what was sent. roscpp reads on a
    /// thread that never waits at one socket.
    fn busy(&self) -> bool {
        let rospy = self.now.is_some_and(|now| now.drops.is_none());
        self.place == Place::Unread || (rospy && self.place == Place::Away)
    }

    /// Messages of the window that reached the callback.
    pub(crate) fn reached(&self, link: &LinkState) -> u64 {
        // Whoever has answered every message has had it, and may be gone before it was asked.
        if self.answered {
            return link.counted;
        }
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
        let node = "/n".to_owned();
        LinkState { id: 1, node, lead_in, counted, open: true, ..LinkState::default() }
    }

    fn reported(messages: u64, drops: Option<u64>) -> Option<Received> {
        Some(Received { messages, drops })
    }

    #[test]
    fn losses_of_the_lead_in_do_not_count_where_they_can_be_separated() {
        let roscpp = Known {
            now: reported(110, Some(7)),
            lead_in: reported(10, Some(4)),
            ..Known::default()
        };
        assert_eq!(roscpp.reached(&link(10, 100)), 97);
        let rospy =
            Known { now: reported(106, None), lead_in: reported(6, None), ..Known::default() };
        assert_eq!(rospy.reached(&link(10, 100)), 100);
    }

    // Promise: ledger-says-no-more
    #[test]
    fn what_is_not_proved_is_not_received() {
        assert_eq!(Known::default().reached(&link(0, 100)), 0);
        let answered = Known { answered: true, ..Known::default() };
        assert_eq!(answered.reached(&link(3, 100)), 100);
        let unsettled = Known { now: reported(106, None), ..Known::default() };
        assert_eq!(unsettled.reached(&link(10, 100)), 96);
        let unsettled = Known { now: reported(110, Some(7)), ..Known::default() };
        assert_eq!(unsettled.reached(&link(10, 100)), 93);
    }

    #[test]
    fn a_lead_in_is_final_only_if_nothing_of_it_can_come_any_more() {
        let at = |now, place| Known { now, place, ..Known::default() };
        let sure = |known: Known| known.is_final(&known.now.unwrap(), &link(10, 0));
        for place in [Place::Unknown, Place::Unread, Place::Away, Place::Back] {
            assert!(sure(at(reported(10, None), place)) && sure(at(reported(10, Some(4)), place)));
            assert_eq!(sure(at(reported(7, None), place)), place == Place::Back);
            assert!(!sure(at(reported(7, Some(0)), place)));
        }
    }

    // Promise: ledger-says-no-more
    #[test]
    fn a_proof_is_as_strong_as_what_the_library_counts_and_what_was_seen() {
        let at = |now, place| Known { now, place, ..Known::default() };
        assert_eq!(at(None, Place::Back).strength(&link(0, 1)), Strength::Sent);
        assert_eq!(at(reported(1, Some(0)), Place::Back).strength(&link(0, 1)), Strength::Received);
        assert_eq!(at(reported(1, None), Place::Away).strength(&link(0, 1)), Strength::Taken);
        assert_eq!(at(reported(1, None), Place::Unknown).strength(&link(0, 1)), Strength::Taken);
        assert_eq!(at(reported(1, None), Place::Back).strength(&link(0, 1)), Strength::Called);
        let away = |called| Known { called, ..at(reported(1, None), Place::Away) };
        assert_eq!(away(Some(1)).strength(&link(0, 1)), Strength::Called);
        assert_eq!(away(Some(1)).strength(&link(1, 1)), Strength::Taken);
        let answered = Known { answered: true, ..at(reported(1, Some(0)), Place::Unknown) };
        assert_eq!(answered.strength(&link(0, 1)), Strength::Called);
        assert_eq!(
            Known { answered: true, ..Known::default() }.strength(&link(0, 1)),
            Strength::Sent
        );
    }

    #[test]
    fn who_has_not_read_everything_is_busy_and_so_is_rospy_away_from_its_socket() {
        let at = |now, place| Known { now, place, ..Known::default() }.busy();
        assert!(at(None, Place::Unread) && at(reported(1, Some(0)), Place::Unread));
        assert!(at(reported(1, None), Place::Away));
        assert!(!at(reported(1, Some(0)), Place::Away) && !at(None, Place::Away));
        assert!(!at(reported(1, None), Place::Back) && !at(reported(1, None), Place::Unknown));
    }
}
