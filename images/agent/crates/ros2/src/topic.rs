//! A topic that is played: its subscribers, and the credit that they give.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

use bagpipe_graph::{
    Cancelled, FarEnd, LinkState, Outlet, PacedBy, Publication, SendError, Share, TopicInfo,
};
use bagpipe_ros2ledger::{Endpoint, Event, Kind, Ledger, LedgerError, ProcessId, Waited};
use bagpipe_ros2player::{Player, PlayerError, PublisherId, Qos};

use crate::link::{Link, MOST_WAITING, Subscriptions, Totals};
use crate::qos::incompatible;
use crate::stillness::counted;

/// Bytes that may be on their way to a subscriber: with more in flight of large messages a
/// middleware that fragments them gets slower, not faster (measured with Cyclone DDS).
const WINDOW: u64 = 1 << 20;
/// How often somebody who waits asks whether to give up.
const ASK: Duration = Duration::from_millis(20);
/// A subscription whose process has not reported for so long whom it knows is believed to know us.
const UNREPORTED: Duration = Duration::from_secs(2);
/// How long we may take to know a subscription in place of another of the same node, at which the
/// number that we know stays the same. Fast DDS was measured to take up to 0.24 s.
const RENEWED: Duration = Duration::from_millis(300);
/// How often somebody who waits for new subscriptions looks at them.
const MATCHES: Duration = Duration::from_millis(5);
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
    /// How long a lead-in that is played by the clock may still wait for its subscribers.
    pub(crate) patience: Mutex<Duration>,
    /// Whether the nodes still report whom they have matched, which costs them time at each wait.
    pub(crate) watching: AtomicBool,
}

/// An advertised topic.
pub(crate) struct Topic {
    means: Arc<Means>,
    info: TopicInfo,
    publisher: PublisherId,
    qos: Qos,
    /// Why its subscribers would read its messages as something else, if they would.
    otherwise: Option<String>,
    links: RwLock<Arc<Vec<Arc<Link>>>>,
    /// Subscriptions that have not matched yet: since when they are known.
    strangers: Mutex<BTreeMap<Owner, Instant>>,
    /// Nodes that have destroyed their subscriptions: they may be about to make others.
    departed: Mutex<BTreeMap<Owner, Absence>>,
    sent: Mutex<Sent>,
    /// Held by who looks at the subscriptions; what had gone out by the look before.
    looked: Mutex<Totals>,
    /// Endpoints that the ledger had listed when somebody last looked.
    listed: AtomicU32,
    /// Nodes that publish it beside us, as the graph has them: some may not count.
    others: Mutex<BTreeSet<String>>,
}

/// A node's name, and its process.
type Owner = (ProcessId, String);

/// For how long a node has been without its subscriptions, at the looks that were taken.
struct Absence {
    looked: Instant,
    lasted: Duration,
}

impl Absence {
    fn begin() -> Absence {
        Absence { looked: Instant::now(), lasted: Duration::ZERO }
    }

    /// Takes in a look at this moment.
    fn look(&mut self, now: Instant) -> Duration {
        self.lasted += counted(now - self.looked);
        self.looked = now;
        self.lasted
    }
}

/// The ledger at a moment.
pub(crate) struct Look {
    pub(crate) endpoints: Vec<Endpoint>,
    running: BTreeSet<ProcessId>,
    /// Endpoints that had been listed before.
    listed: u32,
}

impl Look {
    pub(crate) fn at(ledger: &Ledger) -> Result<Look, LedgerError> {
        let listed = ledger.listed();
        let running =
            ledger.processes()?.iter().filter(|one| one.alive).map(|one| one.id).collect();
        Ok(Look { endpoints: ledger.endpoints()?, running, listed })
    }

    /// The subscriptions that are there, by whose they are.
    fn subscriptions(&self, topic: &str) -> BTreeMap<Owner, Vec<&Endpoint>> {
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
        let all = self.endpoints.iter().filter(move |one| one.kind == kind && !one.destroyed);
        all.filter(move |one| one.topic == topic && self.running.contains(&one.process))
    }
}

/// What went out.
#[derive(Default)]
struct Sent {
    totals: Totals,
    bytes: u64,
    /// The bytes that had gone out before each of the last messages, oldest first.
    before: VecDeque<u64>,
}

impl Sent {
    fn add(&mut self, share: Share, bytes: usize) {
        if self.before.len() as u64 > MOST_WAITING {
            self.before.pop_front();
        }
        self.before.push_back(self.bytes);
        self.totals.add(share, bytes);
        self.bytes += bytes as u64;
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
        otherwise: Option<String>,
    ) -> Topic {
        Topic {
            means,
            info,
            publisher,
            qos,
            otherwise,
            links: RwLock::default(),
            strangers: Mutex::default(),
            departed: Mutex::default(),
            sent: Mutex::default(),
            looked: Mutex::default(),
            listed: AtomicU32::new(0),
            others: Mutex::default(),
        }
    }

    /// Why it can't be sent: somebody is there who would read it as something else.
    pub(crate) fn misread(&self) -> Option<&str> {
        let otherwise = self.otherwise.as_deref()?;
        self.links().iter().any(|link| link.is_open()).then_some(otherwise)
    }

    /// Takes in the nodes that publish it beside us.
    pub(crate) fn note_publishers<'n>(&self, nodes: impl Iterator<Item = &'n String>) {
        *self.others.lock().unwrap_or_else(PoisonError::into_inner) = nodes.cloned().collect();
    }

    /// Nodes that publish it in processes that do not count: what its subscribers take of them
    /// can't be separated from ours.
    pub(crate) fn uncounted(&self, endpoints: &[Endpoint]) -> Vec<String> {
        let others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        uncounted(&self.info.topic, &others, endpoints)
    }

    /// Takes in who subscribes now: those that count, and the names of others, where somebody asked
    /// for them.
    pub(crate) fn refresh(
        &self,
        look: &Look,
        uncounted: Option<&[String]>,
    ) -> Result<(), LedgerError> {
        let mut looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        // What goes out from here on is counted by the links.
        let now = self.sent().totals;
        let missed = now.since(*looked);
        *looked = now;
        let nodes = look.subscriptions(&self.info.topic);
        self.learn_publishers(&look.endpoints);
        self.strangers().retain(|owner, _| nodes.contains_key(owner));
        let mut links = Vec::clone(&self.links());
        for link in &links {
            let Some(counted) = &link.counted else { continue };
            let owner = (counted.process, link.node.clone());
            let there = nodes.get(&owner).map(Vec::as_slice).unwrap_or_default();
            let others = link.replace(there, &self.means.ledger)?;
            if there.is_empty() && link.is_open() && look.running.contains(&owner.0) {
                self.departed().insert(owner, Absence::begin());
            }
            if there.is_empty() || (others && self.means.paced_by == PacedBy::Subscribers) {
                link.close();
            }
        }
        let now = Instant::now();
        self.departed().retain(|owner, absence| {
            !nodes.contains_key(owner)
                && look.running.contains(&owner.0)
                && absence.look(now) < RENEWED
        });
        for (owner, subscriptions) in &nodes {
            self.welcome(&mut links, owner, subscriptions, (look, missed));
        }
        if let Some(uncounted) = uncounted {
            self.refresh_uncounted(&mut links, uncounted, missed);
        }
        *self.links.write().unwrap_or_else(PoisonError::into_inner) = Arc::new(links);
        self.listed.store(look.listed, Ordering::Relaxed);
        Ok(())
    }

    /// A node subscribes: if it is new, or has come back, it has a link from now on, or from when it
    /// knows us. By the clock nobody waits for that once the play has begun: `missed` went out since
    /// the last look.
    fn welcome(
        &self,
        links: &mut Vec<Arc<Link>>,
        owner: &Owner,
        subscriptions: &[&Endpoint],
        (look, missed): (&Look, Totals),
    ) {
        let known = links.iter().rev().find(|link| link.is_of(owner)).cloned();
        if known.as_ref().is_some_and(|link| link.is_open()) {
            return;
        }
        let begun = self.sent().totals.messages() > 0;
        let at_once = begun && self.means.paced_by == PacedBy::Schedule;
        if !at_once && !self.knows_us(owner, subscriptions, look, known.is_some()) {
            return;
        }
        let missed = if at_once { missed } else { Totals::default() };
        if let Some(link) = known {
            return link.open(missed);
        }
        let publishers = self.publishers(&look.endpoints);
        let counted = Subscriptions::new(subscriptions, &publishers, !begun);
        let name = self.named(links, &owner.1);
        links.push(self.link(name, counted, missed));
    }

    /// Whether a node is there that does not count, as somebody has found.
    pub(crate) fn is_uncounted(&self, node: &str) -> bool {
        self.links().iter().any(|link| link.is_uncounted() && link.node == node)
    }

    fn refresh_uncounted(&self, links: &mut Vec<Arc<Link>>, names: &[String], missed: Totals) {
        let without = |link: &&Arc<Link>| link.is_uncounted();
        for link in links.iter().filter(without).filter(|link| !names.contains(&link.node)) {
            link.close();
        }
        for name in names {
            if !links.iter().filter(without).any(|link| link.node == *name) {
                let name = self.named(links, name);
                links.push(self.link(name, None, missed));
            }
        }
    }

    /// One of some nodes that share their names with others, where more subscribe than can be seen:
    /// `others` are those that do not count.
    pub(crate) fn hidden(
        &self,
        look: &Look,
        namesakes: &BTreeSet<String>,
        others: usize,
    ) -> Option<String> {
        let name = namesakes.first()?;
        // Those of processes that have ended are known for a while.
        let all = look.endpoints.iter().filter(|one| one.kind == Kind::Subscription);
        let there = all.filter(|one| !one.destroyed && one.topic == self.info.topic).count();
        let known = self.means.player.subscribers(self.publisher).unwrap_or_default();
        (known > (there + others) as u64).then(|| name.clone())
    }

    /// A node's name, with a number that no other of this name has that is there.
    fn named(&self, links: &[Arc<Link>], node: &str) -> (String, u32) {
        let there = links.iter().filter(|link| link.is_open() && link.node == node);
        let taken: BTreeSet<u32> = there.map(|link| link.instance).collect();
        let free = (0..).find(|number| !taken.contains(number)).unwrap_or_default();
        (node.to_owned(), free)
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

    fn link(
        &self,
        name: (String, u32),
        counted: Option<Subscriptions>,
        missed: Totals,
    ) -> Arc<Link> {
        let id = self.means.links.fetch_add(1, Ordering::Relaxed);
        Arc::new(Link::new(id, name, counted, missed))
    }

    /// Whether all subscriptions of a node have matched us, as far as they report: they know more
    /// publishers than there are others, and we know all subscriptions that are there. Of a node
    /// that is `known`, new ones know us from the beginning.
    fn knows_us(
        &self,
        owner: &Owner,
        subscriptions: &[&Endpoint],
        look: &Look,
        known: bool,
    ) -> bool {
        let others = look.there(Kind::Publisher, &self.info.topic).count();
        let there = look.there(Kind::Subscription, &self.info.topic).count();
        let there = there + self.links().iter().filter(|link| link.is_uncounted()).count();
        let reported = |one: &&Endpoint| one.matched.is_some_and(|known| known as usize > others);
        // Either side may know of the other first, and what is published in between never comes.
        let known_to_us = || self.means.player.subscribers(self.publisher).unwrap_or_default();
        let mut strangers = self.strangers();
        let since = *strangers.entry(owner.clone()).or_insert_with(Instant::now);
        let know_us = match known {
            true => since.elapsed() >= RENEWED,
            false => subscriptions.iter().all(reported),
        };
        if know_us && known_to_us() == there as u64 {
            strangers.remove(owner);
            return true;
        }
        // One of the others may be none that it can match.
        let some = |one: &&Endpoint| one.matched.is_none_or(|known| known > 0);
        since.elapsed() >= UNREPORTED && subscriptions.iter().all(some)
    }

    fn strangers(&self) -> MutexGuard<'_, BTreeMap<Owner, Instant>> {
        self.strangers.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Before a message goes out: whoever has begun to subscribe since the last one is noticed, and
    /// at the subscribers' pace it gets to know us first, within a bound.
    fn meet(&self, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        let ledger = &*self.means.ledger;
        let failed = |error: LedgerError| failed(&error);
        if self.listed.load(Ordering::Relaxed) == ledger.listed() && !self.has_strangers() {
            return Ok(());
        }
        loop {
            self.refresh(&Look::at(ledger).map_err(failed)?, None).map_err(failed)?;
            if !self.has_strangers() {
                return Ok(());
            }
            if !self.means.watching.swap(true, Ordering::Relaxed) {
                ledger.watch_matches(true);
            }
            let changes = [Event::Matched, Event::Listed];
            let never = |_: &Ledger| Ok(false);
            ledger.wait(&changes, &[], Instant::now() + MATCHES, never).map_err(failed)?;
            if cancelled() {
                return Err(SendError::Cancelled);
            }
        }
    }

    fn departed(&self) -> MutexGuard<'_, BTreeMap<Owner, Absence>> {
        self.departed.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Whether somebody is to be waited for who subscribes and does not know us yet, or has just left
    /// to subscribe again, and was not waited for in vain. By the clock nobody is.
    fn has_strangers(&self) -> bool {
        let is_new = |since: &Instant| since.elapsed() < UNREPORTED + RENEWED;
        self.means.paced_by == PacedBy::Subscribers
            && (self.strangers().values().any(is_new) || !self.departed().is_empty())
    }

    /// Waits until there is room for a message of so many bytes at each subscriber; at one that has
    /// none, until it has taken half of what waits, so that it wakes us once for many messages.
    fn await_room(&self, bytes: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        loop {
            let mut full: BTreeMap<u64, u64> = BTreeMap::new();
            let room = |link: &Link, ledger: &Ledger| {
                let waiting = link.waiting(ledger)?;
                let room = self.sent().has_room(waiting, link.depth(), bytes);
                if let Some(half) = full.get(&link.id()) {
                    return Ok(room && waiting <= *half);
                }
                if !room {
                    full.insert(link.id(), waiting / 2);
                    link.wake_after(ledger, waiting - waiting / 2)?;
                }
                Ok(room)
            };
            self.wait(&[Event::Taken], room, cancelled)?;
            // Meanwhile one may have been replaced that had none.
            if !self.has_strangers() {
                return Ok(());
            }
            self.meet(cancelled)?;
        }
    }

    /// By the clock: a lead-in waits for its subscribers, as long as all of it may, so that a first
    /// callback that takes its time loses nothing of it. What is lost of a lead-in can't be separated
    /// from what is lost of the window: which messages a queue has overwritten is not known.
    fn await_first(&self, message: &[u8], cancelled: Cancelled<'_>) -> Result<(), SendError> {
        let mut patience = self.means.patience.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = Instant::now();
        let mut over = || cancelled() || begun.elapsed() >= *patience;
        let waited = match patience.is_zero() {
            true => Ok(()),
            false => self.await_room(message.len() as u64, &mut over),
        };
        *patience = patience.saturating_sub(begun.elapsed());
        match waited {
            Err(SendError::Cancelled | SendError::Stalled { .. }) if !cancelled() => Ok(()),
            other => other,
        }
    }

    fn links(&self) -> Arc<Vec<Arc<Link>>> {
        Arc::clone(&self.links.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Messages that went out by now.
    pub(crate) fn messages(&self) -> u64 {
        self.sent().totals.messages()
    }

    /// The link with this number.
    pub(crate) fn link_with(&self, id: u64) -> Option<Arc<Link>> {
        self.links().iter().find(|link| link.id() == id).cloned()
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
        {
            // Whoever looks at the subscribers meanwhile waits, so that none has it twice.
            let _looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
            for link in self.links().iter().filter(|link| link.is_open()) {
                link.count(share, message.len());
            }
            self.sent().add(share, message.len());
        }
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
        let ledger = &self.means.ledger;
        let mut progress = (0, Instant::now());
        loop {
            let links = self.links();
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
            // Nobody wakes us for who has ended.
            let look = Look::at(ledger).map_err(|error| failed(&error))?;
            self.refresh(&look, None).map_err(|error| failed(&error))?;
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

/// Those of a topic's publishing nodes whose publishers of it the ledger does not have.
pub(crate) fn uncounted(
    topic: &str,
    nodes: &BTreeSet<String>,
    endpoints: &[Endpoint],
) -> Vec<String> {
    let publishes = |one: &&Endpoint| one.kind == Kind::Publisher && one.topic == topic;
    let counts = |node: &&String| endpoints.iter().filter(publishes).any(|one| one.node == **node);
    nodes.iter().filter(|node| !counts(node)).cloned().collect()
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
            self.meet(cancelled)?;
            if let Some(why) = self.misread() {
                return Err(SendError::Failed { reason: "BagUnreadable", what: why.to_owned() });
            }
            match (self.means.paced_by, share) {
                (PacedBy::Subscribers, _) => self.await_room(message.len() as u64, cancelled)?,
                (PacedBy::Schedule, Share::LeadIn) => self.await_first(message, cancelled)?,
                (PacedBy::Schedule, Share::Counted) => {}
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
        self.messages().saturating_sub(published)
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
            sent.add(Share::Counted, 100 << 10);
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
            sent.add(Share::LeadIn, 3);
        }
        assert_eq!(sent.bytes_of_last(MOST_WAITING), 3 * MOST_WAITING);
        assert_eq!(sent.bytes_of_last(1), 3);
        assert_eq!(sent.before.len() as u64, MOST_WAITING + 1);
    }

    #[test]
    fn an_absence_lasts_as_long_as_somebody_looked() {
        let mut absence = Absence::begin();
        let (begun, ms) = (absence.looked, Duration::from_millis);
        assert_eq!(absence.look(begun + ms(5)), ms(5));
        assert_eq!(absence.look(begun + ms(30)), ms(30));
        // A machine that stood still.
        assert_eq!(absence.look(begun + ms(5_000)), ms(70));
    }
}
