//! Topics whose connections and nodes are as a test says.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use bagpipe_graph::{
    Audit, Cancelled, FarEnd, GraphError, LinkState, Outlet, Publication, Received, SendError,
    Share, TopicInfo,
};

/// A topic with the connections that it is given.
pub(super) struct Scripted {
    info: TopicInfo,
    links: Mutex<Vec<LinkState>>,
    ends: Mutex<Vec<FarEnd>>,
    /// Bytes that no subscriber's kernel has taken.
    pub(super) unsent: AtomicU64,
}

impl Scripted {
    pub(super) fn new(topic: &str, links: &[LinkState]) -> Arc<Scripted> {
        let datatype = format!("{}_msgs/String", &topic[1..]);
        let info = TopicInfo { topic: topic.to_owned(), datatype, ..TopicInfo::default() };
        Arc::new(Scripted {
            info,
            links: Mutex::new(links.to_vec()),
            ends: Mutex::default(),
            unsent: AtomicU64::new(0),
        })
    }

    /// What is seen of the other ends from now on.
    pub(super) fn ends_are(&self, ends: &[FarEnd]) {
        *self.ends.lock().unwrap() = ends.to_vec();
    }

    /// What the connections are from now on.
    pub(super) fn links_are(&self, links: &[LinkState]) {
        *self.links.lock().unwrap() = links.to_vec();
    }
}

impl Outlet for Scripted {
    fn topic(&self) -> &str {
        &self.info.topic
    }

    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(&self, _: Share, _: &[&[u8]], _: Cancelled<'_>) -> Result<(), SendError> {
        Ok(())
    }

    fn await_unread(&self, _: u64, _: Cancelled<'_>) -> Result<(), SendError> {
        Ok(())
    }
}

impl Publication for Scripted {
    fn info(&self) -> &TopicInfo {
        &self.info
    }

    fn subscribers(&self) -> Vec<LinkState> {
        self.links.lock().unwrap().clone()
    }

    fn unsent(&self) -> u64 {
        self.unsent.load(Ordering::Relaxed)
    }

    fn far_ends(&self) -> Vec<FarEnd> {
        self.ends.lock().unwrap().clone()
    }

    fn refused(&self) -> Vec<String> {
        Vec::new()
    }
}

/// An open connection of a node, over which so many messages of the lead-in and of the window went.
pub(super) fn link(id: u64, node: &str, (lead_in, counted): (u64, u64)) -> LinkState {
    let node = node.to_owned();
    let counted_bytes = 10 * counted;
    LinkState { id, node, lead_in, counted, counted_bytes, open: true, ..LinkState::default() }
}

/// A connection that no longer stands.
pub(super) fn left(link: LinkState) -> LinkState {
    LinkState { open: false, ..link }
}

/// Of which node which connections were asked for.
pub(super) type Questions = Arc<Mutex<Vec<(String, BTreeMap<String, Vec<u64>>)>>>;

/// What a node reports of each of its connections: by topic and number.
type Counted = BTreeMap<(String, u64), Received>;

/// Nodes that say of each connection what `words` has; the others do not answer.
#[derive(Clone, Default)]
pub(super) struct Words {
    pub(super) words: Arc<Mutex<BTreeMap<String, Counted>>>,
    pub(super) outlives: bool,
    pub(super) pids: BTreeMap<String, i32>,
    pub(super) asked: Questions,
    /// Happens whenever a node is asked.
    pub(super) meanwhile: Option<Arc<dyn Fn() + Send + Sync>>,
}

impl Words {
    /// From now on a node says of a connection that so many messages came, and so many were
    /// dropped, where it counts those.
    pub(super) fn say(&self, node: &str, at: (&str, u64), messages: u64, drops: Option<u64>) {
        let mut words = self.words.lock().unwrap();
        let of_node = words.entry(node.to_owned()).or_default();
        of_node.insert((at.0.to_owned(), at.1), Received { messages, drops });
    }

    /// From now on a node does not answer.
    pub(super) fn is_silent(&self, node: &str) {
        self.words.lock().unwrap().remove(node);
    }

    pub(super) fn audit(&self) -> Box<dyn Audit> {
        Box::new(self.clone())
    }
}

fn unknown() -> GraphError {
    GraphError { reason: "RosMasterFailed", what: "asking", source: "nobody answers".into() }
}

impl Audit for Words {
    fn ask(
        &mut self,
        node: &str,
        links: &BTreeMap<String, Vec<u64>>,
    ) -> Result<BTreeMap<(String, u64), Received>, GraphError> {
        self.asked.lock().unwrap().push((node.to_owned(), links.clone()));
        if let Some(meanwhile) = &self.meanwhile {
            meanwhile();
        }
        self.words.lock().unwrap().get(node).cloned().ok_or_else(unknown)
    }

    fn outlives_nodes(&self) -> bool {
        self.outlives
    }

    fn pid(&mut self, node: &str) -> Result<i32, GraphError> {
        self.pids.get(node).copied().ok_or_else(unknown)
    }

    fn subscribers(&mut self, _: &str) -> Result<BTreeSet<(String, String)>, GraphError> {
        Ok(BTreeSet::new())
    }
}
