//! Who is in the graph: by the ledger, and by the graph itself, which knows those that do not count.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_graph::SystemState;
use bagpipe_ros2ledger::{Endpoint, Kind};
use bagpipe_ros2player::GraphNode;

/// Names that more nodes of the graph have than count: what one of these subscribes to the graph
/// does not show by itself.
pub(crate) fn namesakes(endpoints: &[Endpoint], nodes: &[GraphNode]) -> BTreeSet<String> {
    let mut there: BTreeMap<&String, usize> = BTreeMap::new();
    for node in nodes.iter().filter(|node| !is_hidden(&node.name)) {
        *there.entry(&node.name).or_default() += 1;
    }
    let counting = |name: &String| {
        let own = endpoints.iter().filter(|one| one.node == *name);
        own.map(|one| one.process).collect::<BTreeSet<_>>().len()
    };
    let more = there.into_iter().filter(|(name, many)| *many > counting(name).max(1));
    more.map(|(name, _)| name.clone()).collect()
}

/// Whether a name is one that tools hide, such as those of the command line's own nodes.
fn is_hidden(name: &str) -> bool {
    name.split('/').any(|part| part.starts_with('_'))
}

/// Who publishes and subscribes, by the ledger and by the graph, which knows those that do not count.
pub(crate) fn state(endpoints: &[Endpoint], nodes: &[GraphNode]) -> SystemState {
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
