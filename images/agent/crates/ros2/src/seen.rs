//! Who is in the graph: by the ledger, and by the graph itself, which knows those that do not count.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_graph::SystemState;
use bagpipe_ros2ledger::{Endpoint, Kind};
use bagpipe_ros2player::GraphNode;

/// Names that more nodes of the graph have than count: what one of these subscribes to the graph
/// does not show by itself.
pub(crate) fn namesakes(endpoints: &[Endpoint], nodes: &[GraphNode]) -> BTreeSet<String> {
    let mut there: BTreeMap<&String, usize> = BTreeMap::new();
    for node in nodes.iter().filter(|node| !is_of_command_line(&node.name)) {
        *there.entry(&node.name).or_default() += 1;
    }
    let counting = |name: &String| {
        let own = endpoints.iter().filter(|one| one.node == *name);
        own.map(|one| one.process).collect::<BTreeSet<_>>().len()
    };
    let more = there.into_iter().filter(|(name, many)| *many > counting(name).max(1));
    more.map(|(name, _)| name.clone()).collect()
}

/// Whether a name is one of `ros2`'s own nodes, which come and go and are none of the stack's. Any
/// other name that tools hide, with a `_` before it, may be of one that is to be proved.
pub fn is_of_command_line(name: &str) -> bool {
    name.rsplit('/').next().is_some_and(|own| own.starts_with("_ros2cli"))
}

/// The nodes of the command line that publish a topic, as `ros2 topic pub` does: what they publish is
/// recorded, and none of them counts.
pub(crate) fn people_who_publish<'n>(
    nodes: &'n [GraphNode],
    topic: &str,
) -> impl Iterator<Item = &'n String> {
    let people = nodes.iter().filter(|node| is_of_command_line(&node.name));
    people.filter(move |node| node.publishes.iter().any(|on| on.0 == topic)).map(|node| &node.name)
}

/// Whether each node of the graph but `ourselves` counts.
pub(crate) fn all_count(endpoints: &[Endpoint], nodes: &[GraphNode], ourselves: &str) -> bool {
    let counts =
        |node: &GraphNode| endpoints.iter().any(|one| !one.destroyed && one.node == node.name);
    let mut others =
        nodes.iter().filter(|node| node.name != ourselves && !is_of_command_line(&node.name));
    others.all(counts) && namesakes(endpoints, nodes).is_empty()
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
    for node in nodes.iter().filter(|node| !is_of_command_line(&node.name)) {
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

#[cfg(test)]
mod tests {
    use super::*;

    fn node(name: &str, subscribes: &str, publishes: &str) -> GraphNode {
        let on = |topic: &str| vec![(topic.to_owned(), "std_msgs/msg/String".to_owned())];
        GraphNode { name: name.to_owned(), publishes: on(publishes), subscribes: on(subscribes) }
    }

    #[test]
    fn who_does_not_count_is_seen_whatever_its_name_is_but_for_the_command_line_s_nodes() {
        let names = ["/_lane", "/_ns/lane", "/lane", "/ns/_lane", "/_ros2cli/lane"];
        let command_line = ["/_ros2cli_4711", "/_ros2cli_daemon_0_5b9c4f7d", "/ns/_ros2cli_4712"];
        let all = names.iter().chain(&command_line);
        let nodes: Vec<GraphNode> = all.map(|name| node(name, "/in", "/out")).collect();
        let SystemState { publishers, subscribers } = state(&[], &nodes);
        let mut seen = names.map(str::to_owned).to_vec();
        seen.sort();
        assert_eq!((&subscribers["/in"], &publishers["/out"]), (&seen, &seen));
    }

    #[test]
    fn who_has_no_endpoint_in_the_ledger_does_not_count() {
        let count = |names: &[&str]| {
            let nodes: Vec<GraphNode> =
                names.iter().map(|name| node(name, "/in", "/out")).collect();
            all_count(&[], &nodes, "/bagpipe_player")
        };
        assert!(count(&[]) && count(&["/bagpipe_player", "/_ros2cli_4711"]));
        assert!(!count(&["/bagpipe_player", "/lane"]));
    }

    #[test]
    fn of_two_nodes_of_one_name_one_may_not_count() {
        let nodes = |name: &str| [node(name, "/in", "/out"), node(name, "/in", "/out")];
        assert_eq!(namesakes(&[], &nodes("/_lane")), BTreeSet::from(["/_lane".to_owned()]));
        assert_eq!(namesakes(&[], &nodes("/_ros2cli_4711")), BTreeSet::new());
    }
}
