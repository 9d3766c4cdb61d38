//! A topic that is played: its subscribers, and the credit that they give.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

use bagpipe_graph::{
    Cancelled, FarEnd, LinkState, Outlet, PacedBy, Publication, SendError, Share, TopicInfo,
};
use bagpipe_ros2ledger::{Endpoint, Event, Kind, Ledger, LedgerError, ProcessId, Waited};
use bagpipe_ros2player::{Player, PlayerError, PublisherId, Qos};

use crate::link::{Link, MOST_WAITING, Subscriptions};
use crate::qos::incompatible;

/// Bytes that may be on their way to a subscriber: with more in flight of large messages a
/// middleware that fragments them gets slower, not faster (measured with Cyclone DDS).
const WINDOW: u64 = 1 << 20;
/// How often somebody who waits asks whether to give up.
const ASK: Duration = Duration::from_millis(20);
/// A subscription whose process has not reported for so long whom it knows is believed to know us.
const UNREPORTED: Duration = Duration::from_secs(2);
/// How long a node without tracepoints may take to come back for more, after it has taken all: of
/// several threads some never show it.
const COMES_BACK: Duration = Duration::from_millis(100);

/// What all topics of a node share.
pub(crate) struct Means {
    pub(crate) player: Player,
    pub(crate) ledger: Arc<Ledger>,
    pub(crate) paced_by: PacedBy,
    pub(crate) stall: Duration,
    pub(crate) links: AtomicU64,
    /// Whether the nodes still report whom they have matched, which costs them time at each wait.
    pub(crate) watching: AtomicBool,
}

/// An advertised topic.
pub(crate) struct Topic {
    means: Arc<Means>,
    info: TopicInfo,
    publisher: PublisherId,
    qos: Qos,
    links: RwLock<Arc<Vec<Arc<Link>>>>,
    /// Subscriptions that have not matched yet: since when they are known.
    strangers: Mutex<BTreeMap<(ProcessId, String), Instant>>,
    sent: Mutex<Sent>,
    /// Nodes that publish it beside us, as the graph has them: some may not count.
    others: Mutex<BTreeSet<String>>,
}

/// What went out.
#[derive(Default)]
struct Sent {
    messages: u64,
    bytes: u64,
    /// The bytes that had gone out before each of the last messages, oldest first.
    before: VecDeque<u64>,
}

impl Sent {
    fn add(&mut self, bytes: u64) {
        if self.before.len() as u64 > MOST_WAITING {
            self.before.pop_front();
        }
        self.before.push_back(self.bytes);
        self.messages += 1;
        self.bytes += bytes;
    }

    /// Bytes of the last `messages`.
    fn bytes_of_last(&self, messages: u64) -> u64 {
        let from = (self.before.len() as u64).saturating_sub(messages);
        let before = usize::try_from(from).ok().and_then(|from| self.before.get(from));
        before.map_or(0, |before| self.bytes - before)
    }

    /// Whether one more message of `bytes` may go out to somebody who has `waiting` of them
    /// before it, in a queue of `depth`.
    fn has_room(&self, waiting: u64, depth: u64, bytes: u64) -> bool {
        waiting == 0 || (waiting < depth && self.bytes_of_last(waiting) + bytes <= WINDOW)
    }
}

impl Topic {
    pub(crate) fn new(
        means: Arc<Means>,
        info: TopicInfo,
        publisher: PublisherId,
        qos: Qos,
    ) -> Topic {
        Topic {
            means,
            info,
            publisher,
            qos,
            links: RwLock::default(),
            strangers: Mutex::default(),
            sent: Mutex::default(),
            others: Mutex::default(),
        }
    }

    /// Takes in the nodes that publish it beside us.
    pub(crate) fn note_publishers<'n>(&self, nodes: impl Iterator<Item = &'n String>) {
        *self.others.lock().unwrap_or_else(PoisonError::into_inner) = nodes.cloned().collect();
    }

    /// Nodes that publish it in processes that do not count: what its subscribers take of them
    /// can't be separated from ours.
    pub(crate) fn uncounted(&self, endpoints: &[Endpoint]) -> Vec<String> {
        let others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        uncounted(&others, endpoints)
    }

    /// Takes in who subscribes now: those that count, by the ledger, and the names of others.
    pub(crate) fn refresh(&self, endpoints: &[Endpoint], uncounted: &[String]) {
        let ours = |kind| {
            let all = endpoints.iter().filter(move |one| one.kind == kind && !one.destroyed);
            all.filter(|one| one.topic == self.info.topic)
        };
        let publishers: Vec<&Endpoint> = ours(Kind::Publisher).collect();
        let mut nodes: BTreeMap<(ProcessId, String), Vec<&Endpoint>> = BTreeMap::new();
        for one in ours(Kind::Subscription) {
            nodes.entry((one.process, one.node.clone())).or_default().push(one);
        }
        let there = nodes.values().map(Vec::len).sum();
        self.learn_publishers(endpoints);
        let all = self.publishers(endpoints);
        let mut links = Vec::clone(&self.links());
        for link in links.iter().filter(|link| link.is_open()) {
            let there = match &link.counted {
                None => uncounted.contains(&link.node),
                Some(counted) => nodes
                    .get(&(counted.process, link.node.clone()))
                    .is_some_and(|now| counted.is_of(now)),
            };
            if !there {
                link.close();
            }
        }
        for (key, subscriptions) in nodes {
            if !has(&links, Some(key.0), &key.1)
                && self.knows_us(&key, &subscriptions, &publishers, there)
            {
                let counted = Subscriptions::new(&subscriptions, &all);
                links.push(self.link(key.1, counted));
            }
        }
        for name in uncounted {
            if !has(&links, None, name) {
                links.push(self.link(name.clone(), None));
            }
        }
        *self.links.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(links);
    }

    /// The stack's publishers of the topic, also those that are gone.
    fn publishers<'e>(&self, endpoints: &'e [Endpoint]) -> Vec<&'e Endpoint> {
        let all = endpoints.iter().filter(|one| one.kind == Kind::Publisher);
        all.filter(|one| one.topic == self.info.topic).collect()
    }

    /// Takes in whose messages its subscribers take beside ours.
    pub(crate) fn learn_publishers(&self, endpoints: &[Endpoint]) {
        let publishers = self.publishers(endpoints);
        self.links().iter().for_each(|link| link.learn(&publishers));
    }

    fn link(&self, node: String, counted: Option<Subscriptions>) -> Arc<Link> {
        let id = self.means.links.fetch_add(1, Ordering::Relaxed);
        Arc::new(Link::new(id, node, counted))
    }

    /// Whether all subscriptions of a node have matched us, as far as they report: they know more
    /// publishers than there are others, and we know all subscriptions that are there.
    fn knows_us(
        &self,
        key: &(ProcessId, String),
        subscriptions: &[&Endpoint],
        others: &[&Endpoint],
        there: usize,
    ) -> bool {
        let mut strangers = self.strangers.lock().unwrap_or_else(PoisonError::into_inner);
        let reported =
            |one: &&Endpoint| one.matched.is_some_and(|known| known as usize > others.len());
        // Either side may know of the other first, and what is published in between never comes.
        let known_to_us = || self.means.player.subscribers(self.publisher).unwrap_or_default();
        if subscriptions.iter().all(reported) && known_to_us() >= there as u64 {
            strangers.remove(key);
            return true;
        }
        let since = *strangers.entry(key.clone()).or_insert_with(Instant::now);
        // One of the others may be none that it can match.
        let some = |one: &&Endpoint| one.matched.is_none_or(|known| known > 0);
        since.elapsed() >= UNREPORTED && subscriptions.iter().all(some)
    }

    fn links(&self) -> Arc<Vec<Arc<Link>>> {
        Arc::clone(&self.links.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Messages that went out by now.
    pub(crate) fn messages(&self) -> u64 {
        self.sent().messages
    }

    /// The link of a node that counts, or has one without.
    pub(crate) fn link_of(&self, node: &str) -> Option<Arc<Link>> {
        self.links().iter().rev().find(|link| link.node == node).cloned()
    }

    fn sent(&self) -> MutexGuard<'_, Sent> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn publish(
        &self,
        share: Share,
        message: &[u8],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        for link in self.links().iter().filter(|link| link.is_open()) {
            link.count(share, message.len());
        }
        self.sent().add(message.len() as u64);
        if share == Share::Counted && self.means.watching.swap(false, Ordering::Relaxed) {
            self.means.ledger.watch_matches(false);
        }
        match self.means.player.publish(self.publisher, &[message], cancelled) {
            Ok(()) => Ok(()),
            Err(PlayerError::Cancelled) => Err(SendError::Cancelled),
            Err(error) => Err(failed(&error)),
        }
    }

    /// Waits for `holds`, which is asked of each open link that counts, as long as something is
    /// taken or ends now and then.
    fn wait(
        &self,
        events: &[Event],
        mut holds: impl FnMut(&Link, &Ledger) -> Result<bool, LedgerError>,
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        let links = self.links();
        let ledger = &self.means.ledger;
        let mut progress = (0, Instant::now());
        loop {
            let there: Vec<&Arc<Link>> =
                links.iter().filter(|link| link.is_open() && link.counted.is_some()).collect();
            let mut all = |ledger: &Ledger| {
                there.iter().try_fold(true, |held, link| Ok(held && holds(link, ledger)?))
            };
            if all(ledger).map_err(|error| failed(&error))? {
                return Ok(());
            }
            match ledger.wait(events, &[], Instant::now() + ASK, all) {
                Ok(Waited::Held) => return Ok(()),
                Ok(Waited::Late | Waited::Ended(_)) => {}
                Err(error) => return Err(failed(&error)),
            }
            end_dead(&there, ledger).map_err(|error| failed(&error))?;
            if cancelled() {
                return Err(SendError::Cancelled);
            }
            let done = done(&there, ledger).map_err(|error| failed(&error))?;
            if done != progress.0 {
                progress = (done, Instant::now());
            }
            let waited = progress.1.elapsed();
            if waited >= self.means.stall {
                let node = there.first().map(|link| link.node.clone()).unwrap_or_default();
                return Err(SendError::Stalled { node, topic: self.info.topic.clone(), waited });
            }
        }
    }
}

/// Those of some nodes that have nothing in the ledger.
pub(crate) fn uncounted(nodes: &BTreeSet<String>, endpoints: &[Endpoint]) -> Vec<String> {
    let counts = |node: &&String| endpoints.iter().any(|one| one.node == **node);
    nodes.iter().filter(|node| !counts(node)).cloned().collect()
}

/// Whether a node has an open link.
fn has(links: &[Arc<Link>], process: Option<ProcessId>, node: &str) -> bool {
    links.iter().filter(|link| link.is_open()).any(|link| {
        link.node == node && link.counted.as_ref().map(|counted| counted.process) == process
    })
}

/// Closes the links whose processes have ended, of which nobody wakes us.
fn end_dead(links: &[&Arc<Link>], ledger: &Ledger) -> Result<(), LedgerError> {
    let processes = ledger.processes()?;
    let runs = |id: ProcessId| processes.iter().any(|process| process.id == id && process.alive);
    for link in links {
        if link.counted.as_ref().is_some_and(|counted| !runs(counted.process)) {
            link.close();
        }
    }
    Ok(())
}

/// A figure that changes with each message that is taken or done with.
fn done(links: &[&Arc<Link>], ledger: &Ledger) -> Result<u64, LedgerError> {
    let of = |link: &&Arc<Link>| Ok(2 * link.taken(ledger)?.unwrap_or(0) + link.in_hand(ledger)?);
    links.iter().map(of).sum()
}

fn failed(error: &dyn std::error::Error) -> SendError {
    SendError::Failed { reason: "Ros2Failed", what: error.to_string() }
}

impl Outlet for Topic {
    fn topic(&self) -> &str {
        &self.info.topic
    }

    /// The middleware keeps what a transient-local publisher has sent.
    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(
        &self,
        share: Share,
        frames: &[&[u8]],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        for frame in frames {
            let message = frame.get(4..).unwrap_or_default();
            if self.means.paced_by == PacedBy::Subscribers {
                let bytes = message.len() as u64;
                let room = |link: &Link, ledger: &Ledger| {
                    let depth = link.counted.as_ref().map_or(MOST_WAITING, |counted| counted.depth);
                    Ok(self.sent().has_room(link.waiting(ledger)?, depth, bytes))
                };
                self.wait(&[Event::Taken], room, cancelled)?;
            }
            self.publish(share, message, cancelled)?;
        }
        Ok(())
    }

    /// With a window of 0: until the callbacks of all that was sent have ended. Else the credit of
    /// each message is the window.
    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        if window > 0 || self.means.paced_by == PacedBy::Schedule {
            return Ok(());
        }
        let mut taken_since = None;
        let done = |link: &Link, ledger: &Ledger| {
            if link.waiting(ledger)? > 0 {
                return Ok(false);
            }
            let since = *taken_since.get_or_insert_with(Instant::now);
            let gives_up = !link.reports_calls() && since.elapsed() >= COMES_BACK;
            Ok(link.in_hand(ledger)? == 0 || gives_up)
        };
        self.wait(&[Event::Taken, Event::Ended], done, cancelled)
    }
}

impl Publication for Topic {
    fn info(&self) -> &TopicInfo {
        &self.info
    }

    fn subscribers(&self) -> Vec<LinkState> {
        self.links().iter().map(|link| link.state()).collect()
    }

    fn unsent(&self) -> u64 {
        let published = self.means.player.published(self.publisher);
        self.sent().messages.saturating_sub(published)
    }

    fn far_ends(&self) -> Vec<FarEnd> {
        let known = |link: &Arc<Link>| {
            let called_back = link.called_back(&self.means.ledger).ok()??;
            let id = link.state().id;
            Some(FarEnd { id, unread: 0, called_back: Some(called_back), inode: None })
        };
        self.links().iter().filter(|link| link.is_open()).filter_map(known).collect()
    }

    fn refused(&self) -> Vec<String> {
        let Ok(endpoints) = self.means.ledger.endpoints() else { return Vec::new() };
        let mut wanting: Vec<String> = endpoints
            .iter()
            .filter(|one| one.kind == Kind::Subscription && !one.destroyed)
            .filter(|one| one.topic == self.info.topic)
            .filter_map(|one| {
                let why = incompatible(&self.qos, &one.qos)?;
                let (node, topic) = (&one.node, &one.topic);
                Some(format!("{node} subscribes to {topic}, but {why}: set its quality of service"))
            })
            .collect();
        wanting.dedup();
        wanting
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_and_a_mebibyte_give_credit_and_an_empty_queue_always_does() {
        let mut sent = Sent::default();
        assert!(sent.has_room(0, 1, 5 << 20));
        for _ in 0..10 {
            sent.add(100 << 10);
        }
        // Nine of a hundred KiB are below a mebibyte with one more, and below the depth.
        assert!(sent.has_room(9, 10, 100 << 10));
        assert!(!sent.has_room(9, 9, 100 << 10));
        assert!(!sent.has_room(9, 10, 200 << 10));
        assert!(sent.has_room(8, 10, 200 << 10));
    }

    #[test]
    fn only_the_last_messages_are_remembered() {
        let mut sent = Sent::default();
        for _ in 0..5 * MOST_WAITING {
            sent.add(3);
        }
        assert_eq!(sent.bytes_of_last(MOST_WAITING), 3 * MOST_WAITING);
        assert_eq!(sent.bytes_of_last(1), 3);
        assert_eq!(sent.before.len() as u64, MOST_WAITING + 1);
    }
}
