//! A node of the graph: its slave API, its TCPROS port, its topics.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{SocketAddr, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bagpipe_graph::{
    GraphError, Node as GraphNode, NodeOptions, Publication as Advertised, Seen, Sink, SystemState,
    TopicInfo,
};

use crate::audit::Audit;
use crate::header::ConnectionHeader;
use crate::inbox::Inbox;
use crate::listener::Listener;
use crate::master::Master;
use crate::publisher::Publication;
use crate::sockets::lock;
use crate::subscriber::{self, ReadLink, Subscription};
use crate::{RosError, hosts, http, slave};

/// Threads that connect to publishers: a stale registration must not hold the others up.
const CONNECTORS: usize = 4;

/// Connections that each of a node's ports serves at once.
const MAX_SERVED: usize = 256;

/// A node; dropping it takes its registrations back and ends its threads.
pub struct Node {
    graph: Arc<Graph>,
    inbox: Arc<Inbox>,
    threads: Vec<JoinHandle<()>>,
    _data: Listener,
    _slave: Listener,
}

/// What the node's threads share.
pub(crate) struct Graph {
    pub(crate) name: String,
    pub(crate) master: Master,
    pub(crate) data_address: SocketAddr,
    slave_uri: OnceLock<String>,
    deadline: Duration,
    stall: Duration,
    publications: Arc<Publications>,
    subscriptions: Mutex<BTreeMap<String, Arc<Subscription>>>,
    connect: Mutex<Option<Sender<Job>>>,
    stopped: AtomicBool,
    pause: (Mutex<()>, Condvar),
}

/// A topic, the slave URI of a publisher to connect to, and how often that is tried.
type Job = (Arc<str>, String, u32);
type Publications = Mutex<BTreeMap<String, Arc<Publication>>>;

impl Node {
    /// Starts a node whose received messages go to `sink`.
    ///
    /// # Errors
    /// The master's URI is unusable or a socket or thread can't be had. The master itself
    /// is not called yet.
    pub fn start(
        master_uri: &str,
        options: NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Node, RosError> {
        let (host, port) = hosts::split_uri(master_uri)?;
        let ip = hosts::local_address_towards(host, port)?;
        let publications: Arc<Publications> = Arc::default();
        let data = Listener::start("tcpros", (ip, 0).into(), MAX_SERVED, {
            let (publications, name) = (Arc::clone(&publications), options.name.clone());
            let deadline = options.call_deadline;
            move |connection| {
                // Without a descriptor for it the peer sees it closed, and tries again.
                if let Ok(stream) = connection.stream.try_clone() {
                    receive_subscriber(&publications, &name, stream, deadline);
                }
            }
        })?;
        let (connect, jobs) = channel();
        let graph = Arc::new(Graph {
            master: Master::new(master_uri, &options.name, options.call_deadline)?,
            name: options.name,
            data_address: data.address(),
            slave_uri: OnceLock::new(),
            deadline: options.call_deadline,
            stall: options.stall,
            publications,
            subscriptions: Mutex::default(),
            connect: Mutex::new(Some(connect)),
            stopped: AtomicBool::new(false),
            pause: (Mutex::new(()), Condvar::new()),
        });
        let slave = Listener::start("slave", (ip, 0).into(), MAX_SERVED, {
            let graph = Arc::clone(&graph);
            let room = http::Room::default();
            move |one| http::serve(one, &room, |body| slave::answer(&graph, body))
        })?;
        graph.slave_uri.get_or_init(|| format!("http://{}/", slave.address()));
        let max_message = options.max_message.min(crate::MAX_MESSAGE);
        let (inbox, reader) = Inbox::start(sink, max_message, {
            let graph = Arc::clone(&graph);
            move |topic, uri| graph.lost(topic, uri)
        })?;
        let mut node = Node { graph, inbox, threads: vec![reader], _data: data, _slave: slave };
        node.start_connectors(jobs)?;
        Ok(node)
    }

    fn start_connectors(&mut self, jobs: Receiver<Job>) -> Result<(), RosError> {
        let jobs = Arc::new(Mutex::new(jobs));
        for _ in 0..CONNECTORS {
            let (graph, inbox) = (Arc::clone(&self.graph), Arc::clone(&self.inbox));
            let jobs = Arc::clone(&jobs);
            let thread = std::thread::Builder::new()
                .name("connector".into())
                .spawn(move || {
                    loop {
                        let job = lock(&jobs).recv();
                        let Ok((topic, uri, attempts)) = job else { return };
                        graph.connect_to(&inbox, &topic, &uri, attempts);
                    }
                })
                .map_err(RosError::io("a thread that connects to publishers can't start"))?;
            self.threads.push(thread);
        }
        Ok(())
    }

    /// Its master.
    pub fn master(&self) -> &Master {
        &self.graph.master
    }

    /// The URI of its slave API.
    pub fn slave_uri(&self) -> &str {
        self.graph.slave_uri()
    }

    /// Registers again what the master's state lacks of ours, as that of a restarted master does.
    /// Returns the number of registrations made.
    fn register_missing(&self, state: &SystemState) -> Result<u64, RosError> {
        let lacks = |nodes: Option<&Vec<String>>| {
            nodes.is_none_or(|nodes| !nodes.contains(&self.graph.name))
        };
        let mut made = 0;
        for publication in self.graph.publications() {
            let info = publication.info();
            if lacks(state.publishers.get(&info.topic)) {
                self.master().register_publisher(&info.topic, &info.datatype, self.slave_uri())?;
                made += 1;
            }
        }
        for topic in self.graph.subscribed_topics() {
            if lacks(state.subscribers.get(&topic)) {
                let uris = self.master().register_subscriber(&topic, "*", self.slave_uri())?;
                self.graph.update_publishers(&topic, uris);
                made += 1;
            }
        }
        Ok(made)
    }
}

impl GraphNode for Node {
    fn name(&self) -> &str {
        &self.graph.name
    }

    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Advertised>, GraphError> {
        let (topic, datatype) = (info.topic.clone(), info.datatype.clone());
        let publication = Arc::new(Publication::new(info, self.graph.stall));
        lock(&self.graph.publications).insert(topic.clone(), Arc::clone(&publication));
        self.master().register_publisher(&topic, &datatype, self.slave_uri())?;
        Ok(publication)
    }

    fn subscribe(&self, topic: &str) -> Result<(), GraphError> {
        let new = {
            let mut subscriptions = lock(&self.graph.subscriptions);
            let new = !subscriptions.contains_key(topic);
            subscriptions.entry(topic.to_owned()).or_default();
            new
        };
        if new {
            let uris = self.master().register_subscriber(topic, "*", self.slave_uri())?;
            self.graph.update_publishers(topic, uris);
        }
        Ok(())
    }

    fn look(&self) -> Result<Seen, GraphError> {
        let state = self.master().get_system_state()?;
        let again = self.register_missing(&state)?;
        Ok(Seen { state, again })
    }

    fn restarted(&self, again: u64) -> String {
        format!(
            "the ROS master was restarted: {again} registrations were made again, and \
             nodes that came before that were found late"
        )
    }

    fn subscribed_topics(&self) -> Vec<String> {
        self.graph.subscribed_topics()
    }

    fn publishers_of(&self, topic: &str) -> usize {
        lock(&self.graph.subscriptions).get(topic).map_or(0, |s| s.connections())
    }

    fn latching_after_all(&self, limit: Duration) -> BTreeSet<u64> {
        self.graph.latching_after_all(limit)
    }

    fn sweep(&self, limit: Duration) {
        self.inbox.sweep(limit);
    }

    fn audit(&self, deadline: Duration) -> Box<dyn bagpipe_graph::Audit> {
        Box::new(Audit::new(self.master().clone(), self.slave_uri(), deadline))
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        self.graph.stopped.store(true, Ordering::Release);
        self.graph.pause.1.notify_all();
        lock(&self.graph.connect).take();
        self.inbox.stop();
        self.graph.unregister();
        for thread in self.threads.drain(..) {
            // A panic in it was already printed; nothing is left to stop.
            let _ended = thread.join();
        }
    }
}

impl Graph {
    pub(crate) fn slave_uri(&self) -> &str {
        self.slave_uri.get().map(String::as_str).unwrap_or_default()
    }

    pub(crate) fn publication(&self, topic: &str) -> Option<Arc<Publication>> {
        lock(&self.publications).get(topic).cloned()
    }

    pub(crate) fn publications(&self) -> Vec<Arc<Publication>> {
        lock(&self.publications).values().cloned().collect()
    }

    pub(crate) fn subscribed_topics(&self) -> Vec<String> {
        lock(&self.subscriptions).keys().cloned().collect()
    }

    /// By subscribed topic: the publishers' slave URIs, connections and counts.
    pub(crate) fn incoming_links(&self) -> Vec<(String, Vec<ReadLink>)> {
        let subscriptions = lock(&self.subscriptions);
        subscriptions.iter().map(|(topic, s)| (topic.clone(), s.links())).collect()
    }

    /// Takes in the master's list of a topic's publishers.
    pub(crate) fn update_publishers(&self, topic: &str, uris: Vec<String>) {
        let Some(subscription) = self.subscription(topic) else {
            return;
        };
        let topic: Arc<str> = topic.into();
        for uri in subscription.update(uris, self.slave_uri()) {
            self.ask_to_connect(&topic, uri, subscriber::ATTEMPTS);
        }
    }

    fn ask_to_connect(&self, topic: &Arc<str>, uri: String, attempts: u32) {
        if let Some(connect) = lock(&self.connect).as_ref() {
            // Without a receiver the node is ending.
            let _ending = connect.send((Arc::clone(topic), uri, attempts));
        }
    }

    fn subscription(&self, topic: &str) -> Option<Arc<Subscription>> {
        lock(&self.subscriptions).get(topic).cloned()
    }

    fn lost(&self, topic: &str, uri: &str) {
        if self.subscription(topic).is_some_and(|subscription| subscription.lost(uri)) {
            // Who advertised again listens; a node that was killed stays registered.
            self.ask_to_connect(&topic.into(), uri.to_owned(), 1);
        }
    }

    /// Connects to one publisher, a few times with a growing pause.
    fn connect_to(&self, inbox: &Inbox, topic: &Arc<str>, uri: &str, attempts: u32) {
        let Some(subscription) = self.subscription(topic) else {
            return;
        };
        for attempt in 0..attempts {
            if self.stopped.load(Ordering::Acquire) || !subscription.wants(uri) {
                break;
            }
            if let Ok(link) = subscriber::connect(&self.name, topic, uri, self.deadline) {
                subscription.connected(uri, &link);
                inbox.add(link);
                return;
            }
            self.rest(Duration::from_millis(50 << attempt));
        }
        subscription.not_reached(uri);
    }

    /// Asks the publishers that may latch once more, a few at once.
    fn latching_after_all(&self, limit: Duration) -> BTreeSet<u64> {
        let deadline = Instant::now() + limit;
        let doubtful = self.may_latch();
        let (next, found) = (AtomicUsize::new(0), Mutex::new(BTreeSet::new()));
        let ask = || {
            while let Some((topic, uri, link)) = doubtful.get(next.fetch_add(1, Ordering::Relaxed))
            {
                let left = deadline.saturating_duration_since(Instant::now());
                if left.is_zero() {
                    return;
                }
                if subscriber::latches(&self.name, topic, uri, left).unwrap_or(false) {
                    lock(&found).insert(*link);
                }
            }
        };
        std::thread::scope(|scope| {
            for _ in 0..CONNECTORS.min(doubtful.len()) {
                scope.spawn(ask);
            }
        });
        found.into_inner().unwrap_or_else(PoisonError::into_inner)
    }

    /// Topic, slave URI and connection of publishers that may latch.
    fn may_latch(&self) -> Vec<(String, String, u64)> {
        let subscriptions = lock(&self.subscriptions);
        let of = |(topic, subscription): (&String, &Arc<Subscription>)| {
            let topic = topic.clone();
            let publishers = subscription.may_latch().into_iter();
            publishers.map(move |(uri, link)| (topic.clone(), uri, link))
        };
        subscriptions.iter().flat_map(of).collect()
    }

    /// Waits, unless the node ends.
    fn rest(&self, time: Duration) {
        let guard = lock(&self.pause.0);
        let going = |(): &mut ()| !self.stopped.load(Ordering::Acquire);
        // A poisoned pause is over at once, which costs an attempt and nothing else.
        let _rested = self.pause.1.wait_timeout_while(guard, time, going);
    }

    /// Takes every registration back. The master may be gone already, as it is when a
    /// case ends by force; then the first call fails and the rest are not tried.
    fn unregister(&self) {
        let topics: Vec<_> = lock(&self.publications).keys().cloned().collect();
        let published =
            topics.iter().map(|t| self.master.unregister_publisher(t, self.slave_uri()));
        let topics = self.subscribed_topics();
        let subscribed =
            topics.iter().map(|t| self.master.unregister_subscriber(t, self.slave_uri()));
        let _master_gone = published.chain(subscribed).find(Result::is_err);
    }
}

/// Reads a subscriber's header and hands the connection to its publication. Whoever sends
/// no valid header within the deadline is disconnected.
fn receive_subscriber(
    publications: &Publications,
    name: &str,
    stream: TcpStream,
    deadline: Duration,
) {
    if stream.set_write_timeout(Some(deadline)).is_err() {
        return;
    }
    let Ok(header) = ConnectionHeader::receive(&stream, deadline) else {
        return;
    };
    let found = lock(publications).get(header.text("topic")).cloned();
    if let Some(publication) = found {
        // A refusal is kept by the publication, which names it if nobody subscribes.
        let _refused = publication.welcome(name, &header, stream);
    }
}
