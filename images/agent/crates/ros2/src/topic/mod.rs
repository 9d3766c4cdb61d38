//! A topic that is played: its subscribers, and the credit that they give.

mod credit;
mod look;
mod matching;
mod sending;
mod subscribers;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

use bagpipe_graph::{FarEnd, LinkState, PacedBy, Publication, TopicInfo};
use bagpipe_ros2ledger::{Endpoint, Kind, Ledger, LedgerError};
use bagpipe_ros2player::{Player, PublisherId, Qos};

use crate::absence::Absence;
use crate::clock::CLOCK;
use crate::link::{Link, Totals};
use crate::qos::incompatible;
use crate::unnamed::Unnamed;
use crate::unreported::Unreported;
pub(crate) use look::Look;

use credit::Sent;
use look::Owner;

/// What our players' names begin with; their process and a number follow.
pub(crate) const PLAYER: &str = "/bagpipe_player_";

/// What all topics of a node share.
pub(crate) struct Means {
    pub(crate) player: Player,
    pub(crate) ledger: Arc<Ledger>,
    pub(crate) paced_by: PacedBy,
    pub(crate) stall: Duration,
    pub(crate) links: AtomicU64,
    /// The most messages that may wait for a node, so that none is lost on its way.
    pub(crate) most_waiting: u64,
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
    /// Subscriptions that have not matched yet.
    strangers: Mutex<BTreeMap<Owner, Unreported>>,
    /// Nodes that have destroyed their subscriptions: they may be about to make others.
    departed: Mutex<BTreeMap<Owner, Absence>>,
    sent: Mutex<Sent>,
    /// Held by who looks at the subscriptions.
    looked: Mutex<Looked>,
    /// Endpoints that the ledger had listed when somebody last looked.
    listed: AtomicU32,
    /// Nodes that publish it beside us or have done so, as the graph had them: some may not count.
    others: Mutex<BTreeSet<String>>,
    /// Programs that subscribe to it and are no nodes.
    unnamed: Unnamed,
}

/// What had gone out, by the clock, when no subscription was there that has no link.
#[derive(Default)]
struct Looked {
    /// The last look that was taken in.
    look: u64,
    /// Of those that count.
    counted: Totals,
    /// With the message that was handed over next, and when, in ns since 1970.
    handed: Totals,
    handed_at: i64,
    /// Of others.
    uncounted: Totals,
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
            unnamed: Unnamed::default(),
        }
    }

    /// Why it can't be sent: somebody is there who would read it as something else.
    pub(crate) fn misread(&self) -> Option<&str> {
        let otherwise = self.otherwise.as_deref()?;
        self.links().iter().any(|link| link.is_open()).then_some(otherwise)
    }

    /// Takes in the nodes that publish it beside us: what one has published is taken though it is gone.
    /// The player of a case before is in the graph for a while, and has published nothing in this one.
    pub(crate) fn note_publishers<'n>(&self, nodes: impl Iterator<Item = &'n String>) {
        let mut others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        others.retain(|node| !node.starts_with(PLAYER));
        others.extend(nodes.cloned());
    }

    /// Takes in how many more subscribers are matched than the `listed` ones.
    pub(crate) fn look_for_unnamed(&self, listed: u64) {
        let matched = || self.means.player.subscribers(self.publisher).unwrap_or_default();
        self.unnamed.look(Instant::now(), || matched().saturating_sub(listed));
    }

    /// How many programs subscribe to it that are no nodes.
    pub(crate) fn unnamed(&self) -> u64 {
        self.unnamed.seen()
    }

    /// Whether nodes publish it in processes that do not count.
    fn has_uncounted(&self, endpoints: &[Endpoint]) -> bool {
        let others = self.others.lock().unwrap_or_else(PoisonError::into_inner);
        !uncounted(&self.info.topic, &others, endpoints).is_empty()
    }

    /// The nodes of which it is not known what they got of ours, as their subscriptions came and went.
    pub(crate) fn confused(&self) -> Vec<String> {
        self.nodes_where(Link::is_confused)
    }

    /// The nodes of which it is not known what they got of ours, as they may have taken messages of
    /// the stack's own in their place.
    pub(crate) fn mixed(&self) -> Vec<String> {
        self.nodes_where(Link::is_mixed)
    }

    /// The nodes that subscribe and have not matched us.
    pub(crate) fn unmatched_nodes(&self) -> Vec<String> {
        let links = self.links();
        let those = links.iter().filter(|link| link.is_unmatched());
        those.map(|link| link.node.clone()).collect()
    }

    /// Where the ledger can't be read, all.
    fn nodes_where(&self, is: fn(&Link, &Ledger) -> Result<bool, LedgerError>) -> Vec<String> {
        let links = self.links();
        let those = links.iter().filter(|link| is(link, &self.means.ledger).unwrap_or(true));
        those.map(|link| link.node.clone()).collect()
    }

    fn links(&self) -> Arc<Vec<Arc<Link>>> {
        Arc::clone(&self.links.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// Whether it is simulated time.
    fn is_clock(&self) -> bool {
        self.info.topic == CLOCK
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

impl Publication for Topic {
    fn info(&self) -> &TopicInfo {
        &self.info
    }

    fn subscribers(&self) -> Vec<LinkState> {
        self.let_people_go();
        let room = |link: &Link| link.counted.as_ref().map(|_| self.room_at(link));
        let state = |link: &Arc<Link>| LinkState { room: room(link), ..link.state() };
        self.links().iter().map(state).collect()
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
