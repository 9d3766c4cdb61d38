//! The nodes of the graph, and its topics.

use std::collections::BTreeMap;

use crate::PlayerError;
use crate::control::Answer;

/// A node, as the program's own node sees it; its services and actions appear as topics do not.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GraphNode {
    /// Its whole name, such as `/ns/name`.
    pub name: String,
    /// Topics with their types, such as `/scan` and `sensor_msgs/msg/LaserScan`; of a topic with
    /// several types, the first.
    pub publishes: Vec<(String, String)>,
    /// As above.
    pub subscribes: Vec<(String, String)>,
}

/// As which types the graph has a topic, whoever publishes it; with librcl also who subscribes to it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GraphTypes {
    /// How many.
    pub count: u32,
    /// One of them, such as `sensor_msgs/msg/LaserScan`.
    pub first: String,
}

/// A publisher of a topic, whichever node has it: of two nodes of one name a [`GraphNode`] shows what one of them
/// has.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GraphPublisher {
    /// Its node's whole name; `None` of a program that is no node, or whose node is not announced yet.
    pub node: Option<String>,
    /// Its type, such as `sensor_msgs/msg/LaserScan`.
    pub datatype: String,
    /// The GID by which the graph has it; `None` with the librcl of a distribution that is not known.
    pub gid: Option<[u8; 16]>,
}

/// Reads an answer to a request for the graph, after its status.
pub(crate) fn read(from: &mut Answer) -> Result<Vec<GraphNode>, PlayerError> {
    let mut nodes = Vec::new();
    for _ in 0..from.number()? {
        let namespace = from.text()?;
        let name = from.text()?;
        nodes.push(GraphNode {
            name: whole_name(&namespace, &name),
            publishes: topics(from)?,
            subscribes: topics(from)?,
        });
    }
    Ok(nodes)
}

fn topics(from: &mut Answer) -> Result<Vec<(String, String)>, PlayerError> {
    let mut found = Vec::new();
    for _ in 0..from.number()? {
        found.push((from.text()?, from.text()?));
    }
    Ok(found)
}

/// Reads an answer to a request for the topics, after its status.
pub(crate) fn read_topics(from: &mut Answer) -> Result<BTreeMap<String, GraphTypes>, PlayerError> {
    let mut all = BTreeMap::new();
    for _ in 0..from.number()? {
        let topic = from.text()?;
        all.insert(topic, GraphTypes { count: from.number()?, first: from.text()? });
    }
    Ok(all)
}

/// Reads an answer to a request for a topic's publishers, after its status.
pub(crate) fn read_publishers(from: &mut Answer) -> Result<Vec<GraphPublisher>, PlayerError> {
    let mut all = Vec::new();
    for _ in 0..from.number()? {
        let (namespace, name) = (from.text()?, from.text()?);
        // Of who is no node, librcl has words in place of both.
        let node = namespace.starts_with('/').then(|| whole_name(&namespace, &name));
        all.push(GraphPublisher { node, datatype: from.text()?, gid: from.gid()? });
    }
    Ok(all)
}

fn whole_name(namespace: &str, name: &str) -> String {
    format!("{}/{name}", namespace.trim_end_matches('/'))
}
