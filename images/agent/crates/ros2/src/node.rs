//! Our node in the graph.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bagpipe_graph::{
    Audit, GraphError, Node, NodeOptions, Publication, Publisher, Seen, Sink, SystemState,
    TopicInfo,
};
use bagpipe_ros2ledger::{Endpoint, EndpointId, Kind, Ledger};
use bagpipe_ros2player::{GraphNode, Player, Qos, Reliability};

use crate::account::Counts;
use crate::audit::Reader;
use crate::definition::installed;
use crate::recording::{Input, Inputs, Receiving};
use crate::topic::{Means, Topic};
use crate::{QosOverride, Ros2Options, qos, stamp};

/// A node of ours: the player's, with what the ledger says of the others.
pub(crate) struct Graph {
    name: String,
    // Before the player, which it takes from.
    _receiving: Receiving,
    means: Arc<Means>,
    inputs: Arc<Inputs>,
    qos: BTreeMap<String, QosOverride>,
    prefixes: Vec<PathBuf>,
    topics: Mutex<Vec<Arc<Topic>>>,
    wanted: Mutex<BTreeSet<String>>,
}

/// An error of the graph.
pub(crate) fn failed(source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> GraphError {
    GraphError { reason: "Ros2Failed", what: "the ROS 2 graph failed", source: source.into() }
}

impl Graph {
    pub(crate) fn join(
        name: &str,
        player: Player,
        middleware: &Ros2Options,
        options: &NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Graph, GraphError> {
        let Ros2Options { ledger, qos, prefixes, .. } = middleware;
        let means = Arc::new(Means {
            player,
            ledger: Arc::clone(ledger),
            paced_by: options.paced_by,
            stall: options.stall,
            links: AtomicU64::new(1),
            watching: AtomicBool::new(true),
        });
        let inputs = Arc::new(Inputs::default());
        let receiving = Receiving::start(&inputs, &means, sink).map_err(failed)?;
        Ok(Graph {
            name: name.to_owned(),
            _receiving: receiving,
            means,
            inputs,
            qos: qos.clone(),
            prefixes: prefixes.clone(),
            topics: Mutex::default(),
            wanted: Mutex::default(),
        })
    }

    fn ledger(&self) -> &Ledger {
        &self.means.ledger
    }

    fn topics(&self) -> MutexGuard<'_, Vec<Arc<Topic>>> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wanted(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Subscribes to what is wanted and whose type is known by now.
    fn subscribe_to_wanted(
        &self,
        endpoints: &[Endpoint],
        nodes: &[GraphNode],
    ) -> Result<(), GraphError> {
        let wanted: Vec<String> = self.wanted().iter().cloned().collect();
        for topic in wanted {
            let publishing = nodes.iter().filter(|node| node.name != self.name);
            let types = publishing.flat_map(|node| node.publishes.iter());
            let Some((_, datatype)) = types.clone().find(|(name, _)| *name == topic) else {
                continue;
            };
            let all: Vec<&Endpoint> = published_on(&topic, endpoints).collect();
            let wanted = qos::recorded(all.iter().map(|one| &one.qos));
            let subscription =
                self.means.player.subscribe(&topic, datatype, &wanted).map_err(failed)?;
            let names: BTreeSet<&String> = all.iter().map(|one| &one.node).collect();
            let node = match names.into_iter().collect::<Vec<_>>()[..] {
                [only] => Some(only.clone()),
                _ => None,
            };
            let publisher = self.publisher(node, datatype, &all, &wanted);
            self.inputs.add(&topic, subscription, publisher);
            self.wanted().remove(&topic);
        }
        Ok(())
    }

    /// How a recording introduces who publishes a topic.
    fn publisher(
        &self,
        node: Option<String>,
        datatype: &str,
        publishers: &[&Endpoint],
        recorded: &Qos,
    ) -> Publisher {
        let played = self.topics().iter().map(|topic| topic.info().clone()).collect::<Vec<_>>();
        let same = || played.iter().find(|info| info.datatype == datatype);
        let definition = installed(datatype, &self.prefixes)
            .or_else(|| Some(same()?.definition.clone()))
            .unwrap_or_default();
        Publisher {
            node,
            datatype: datatype.to_owned(),
            md5sum: String::new(),
            read_stamp: stamp::reader(&definition),
            message_encoding: "cdr",
            schema_encoding: if definition.contains("struct ") { "ros2idl" } else { "ros2msg" },
            definition,
            latching: recorded.durability == bagpipe_ros2player::Durability::TransientLocal,
            offered_qos: Some(qos::yaml(publishers.iter().map(|one| &one.qos))),
        }
    }

    /// What was published on a recorded topic and handed on, by now.
    fn counts(&self, input: &Input, endpoints: &[Endpoint]) -> Counts {
        let handed = input.handed.load(Ordering::Acquire);
        let published = published_on(&input.topic, endpoints);
        Counts { published: published.map(|one| one.counts.published).sum(), handed }
    }
}

/// The publishers of a topic that count, also those that are gone.
fn published_on<'e>(
    topic: &'e str,
    endpoints: &'e [Endpoint],
) -> impl Iterator<Item = &'e Endpoint> {
    endpoints.iter().filter(move |one| one.kind == Kind::Publisher && one.topic == topic)
}

/// Whether a name is one that tools hide, such as those of the command line's own nodes.
fn is_hidden(name: &str) -> bool {
    name.split('/').any(|part| part.starts_with('_'))
}

impl Node for Graph {
    fn name(&self) -> &str {
        &self.name
    }

    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Publication>, GraphError> {
        let wanted = self.qos.get(&info.topic).copied().unwrap_or_default();
        let mut played = qos::played(info.offered_qos.as_deref(), info.latching, wanted);
        if info.topic == "/clock" && wanted.reliability.is_none() {
            played.reliability = Reliability::Reliable;
        }
        let publisher = self.means.player.advertise(&info.topic, &info.datatype, &played);
        let topic = Topic::new(Arc::clone(&self.means), info, publisher.map_err(failed)?, played);
        let topic = Arc::new(topic);
        self.topics().push(Arc::clone(&topic));
        Ok(topic)
    }

    fn subscribe(&self, topic: &str) -> Result<(), GraphError> {
        if self.inputs.of(topic).is_none() {
            self.wanted().insert(topic.to_owned());
        }
        Ok(())
    }

    fn look(&self) -> Result<Seen, GraphError> {
        if let Some(why) = self.inputs.failure() {
            return Err(failed(why));
        }
        let nodes = self.means.player.graph().map_err(failed)?;
        let endpoints = self.ledger().endpoints().map_err(failed)?;
        let state = state(&endpoints, &nodes);
        let counting: BTreeSet<&String> = endpoints.iter().map(|one| &one.node).collect();
        for topic in self.topics().iter() {
            let named = state.subscribers.get(&topic.info().topic).into_iter().flatten();
            let uncounted = named.filter(|name| **name != self.name && !counting.contains(name));
            topic.refresh(&endpoints, &uncounted.cloned().collect::<Vec<_>>());
        }
        self.subscribe_to_wanted(&endpoints, &nodes)?;
        for input in self.inputs.all() {
            let publishers: BTreeSet<EndpointId> =
                published_on(&input.topic, &endpoints).map(|one| one.id).collect();
            input.account().look(publishers, self.counts(&input, &endpoints));
        }
        Ok(Seen { state, again: 0 })
    }

    fn restarted(&self, again: u64) -> String {
        format!("{again} registrations were lost")
    }

    fn subscribed_topics(&self) -> Vec<String> {
        let known = self.inputs.all().into_iter().map(|input| input.topic.clone());
        known.chain(self.wanted().iter().cloned()).collect()
    }

    fn publishers_of(&self, topic: &str) -> usize {
        let Some(input) = self.inputs.of(topic) else { return 0 };
        let matched = self.means.player.publishers(input.subscription).unwrap_or_default();
        usize::try_from(matched).unwrap_or(usize::MAX)
    }

    fn sweep(&self, limit: Duration) {
        let Ok(endpoints) = self.ledger().endpoints() else { return };
        let due: Vec<(Arc<Input>, u64)> = self
            .inputs
            .all()
            .into_iter()
            .filter_map(|input| {
                let published = self.counts(&input, &endpoints).published;
                let due = input.account().due(published)?;
                Some((input, due))
            })
            .collect();
        let come = || due.iter().all(|(input, due)| input.handed.load(Ordering::Acquire) >= *due);
        let _or_it_is_lacking = self.inputs.wait(limit, come);
    }

    fn counts_publishes(&self) -> bool {
        true
    }

    fn lacking(&self) -> Vec<String> {
        let Ok(endpoints) = self.ledger().endpoints() else { return Vec::new() };
        let mut lacking = Vec::new();
        for input in self.inputs.all() {
            let counts = self.counts(&input, &endpoints);
            let missing = input.account().lacking(counts).unwrap_or(0);
            if missing > 0 {
                let Counts { published, handed } = counts;
                lacking.push(format!(
                    "{missing} messages of {} did not reach the recorder, which has {handed} of \
                     {published} published",
                    input.topic
                ));
            }
        }
        lacking.sort();
        lacking
    }

    fn audit(&self, _: Duration) -> Box<dyn Audit> {
        let topics = self.topics().clone();
        Box::new(Reader { ledger: Arc::clone(&self.means.ledger), topics })
    }
}

/// Who publishes and subscribes, by the ledger and by the graph, which knows those that do not count.
fn state(endpoints: &[Endpoint], nodes: &[GraphNode]) -> SystemState {
    let mut publishers: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    let mut subscribers = publishers.clone();
    for one in endpoints.iter().filter(|one| !one.destroyed) {
        let side = match one.kind {
            Kind::Publisher => &mut publishers,
            Kind::Subscription => &mut subscribers,
        };
        side.entry(one.topic.clone()).or_default().insert(one.node.clone());
    }
    for node in nodes.iter().filter(|node| !is_hidden(&node.name)) {
        for (topic, _) in &node.publishes {
            publishers.entry(topic.clone()).or_default().insert(node.name.clone());
        }
        for (topic, _) in &node.subscribes {
            subscribers.entry(topic.clone()).or_default().insert(node.name.clone());
        }
    }
    let listed = |side: BTreeMap<String, BTreeSet<String>>| {
        side.into_iter().map(|(topic, nodes)| (topic, nodes.into_iter().collect())).collect()
    };
    SystemState { publishers: listed(publishers), subscribers: listed(subscribers) }
}
