//! The nodes of the graph, and its topics.

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

/// A topic, whichever nodes have it: of two nodes of one name the graph shows what one of them has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GraphTopic {
    /// How many publishers it has, the program's own among them.
    pub publishers: u64,
    /// Each type that it has, such as `sensor_msgs/msg/LaserScan`; with librcl also those that are subscribed to.
    pub types: Vec<String>,
}

/// Reads an answer to a request for the graph, after its status.
pub(crate) fn read(from: &mut Answer) -> Result<Vec<GraphNode>, PlayerError> {
    let mut nodes = Vec::new();
    for _ in 0..from.number()? {
        let namespace = from.text()?;
        let name = from.text()?;
        nodes.push(GraphNode {
            name: format!("{}/{name}", namespace.trim_end_matches('/')),
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

/// Reads an answer to a request for a topic, after its status.
pub(crate) fn read_topic(from: &mut Answer) -> Result<GraphTopic, PlayerError> {
    let (publishers, count) = (from.long()?, from.number()?);
    let types = (0..count).map(|_| from.text()).collect::<Result<_, _>>()?;
    Ok(GraphTopic { publishers, types })
}
