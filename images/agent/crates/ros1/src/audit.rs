//! Asking nodes what they received, over `getBusStats` of the slave API.
//!
//! What the two libraries mean by it, measured against their callbacks:
//! - roscpp: `[link, bytes, received, drops, 0]`. Received is what was read from the
//!   socket; drops, cumulative, is what its subscription queues threw away.
//!   Received minus drops reached the callback, or still waits in a queue. Because it never
//!   advances the index of the list, only the last link of a topic is listed. It also
//!   answers without the usual `[code, message, value]` around.
//! - rospy: `[link, bytes, messages, -1, connected]`. Messages were taken for the callback,
//!   which the same thread runs afterwards.
//!
//! The figures vanish with the link: ask while the publisher is still connected.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use bagpipe_graph::{Audit as Questions, GraphError, Received};

use crate::master::Master;
use crate::xmlrpc::Client;
use crate::{RosError, Value};

/// Asks the subscribers of one publisher.
pub(crate) struct Audit {
    master: Master,
    publisher: String,
    deadline: Duration,
    nodes: BTreeMap<String, Asked>,
}

struct Asked {
    client: Client,
    /// Link numbers of our connections, by topic.
    ours: BTreeMap<String, BTreeSet<i64>>,
}

impl Audit {
    /// `publisher` is the slave URI of the publishing node.
    pub(crate) fn new(master: Master, publisher: &str, deadline: Duration) -> Audit {
        Audit { master, publisher: publisher.to_owned(), deadline, nodes: BTreeMap::new() }
    }

    fn asked(&mut self, node: &str) -> Result<&mut Asked, RosError> {
        if !self.nodes.contains_key(node) {
            let uri = self.master.lookup_node(node)?;
            let client = Client::new(&uri, self.deadline)?;
            self.nodes.insert(node.to_owned(), Asked { client, ours: BTreeMap::new() });
        }
        self.nodes.get_mut(node).ok_or_else(|| RosError::BadUri {
            uri: node.to_owned(),
            why: "the node is not known".to_owned(),
        })
    }
}

impl Questions for Audit {
    fn ask(
        &mut self,
        node: &str,
        links: &BTreeMap<String, Vec<u64>>,
    ) -> Result<BTreeMap<(String, u64), Received>, GraphError> {
        let caller = self.master.caller().to_owned();
        let publisher = self.publisher.clone();
        let asked = self.asked(node)?;
        let stats = asked.client.call_statistics(&[caller.as_str().into()])?;
        let known = links.keys().all(|topic| asked.ours.contains_key(topic));
        if !known {
            let info = asked.client.call("getBusInfo", &[caller.as_str().into()])?;
            asked.ours = our_links(&info, &publisher);
        }
        let rows = stats.as_list().and_then(|s| s.get(1)?.as_list()).unwrap_or_default();
        let found = rows.iter().filter_map(|row| {
            let row = row.as_list()?;
            let topic = row.first()?.as_str()?;
            // The node has numbers of its own; it speaks of the connection that it made last.
            let link = *links.get(topic)?.last()?;
            let stats = row.get(1)?.as_list()?;
            Some(((topic.to_owned(), link), pick(stats, asked.ours.get(topic))?))
        });
        let found: BTreeMap<_, _> = found.collect();
        if found.len() < links.len() {
            // A link that was made again has a new number: learn it the next time.
            let topics: BTreeSet<&String> = found.keys().map(|(topic, _)| topic).collect();
            asked.ours.retain(|topic, _| topics.contains(topic));
        }
        Ok(found)
    }

    fn pid(&mut self, node: &str) -> Result<i32, GraphError> {
        let caller = self.master.caller().to_owned();
        let client = &mut self.asked(node)?.client;
        let pid = client.call("getPid", &[caller.as_str().into()])?;
        let pid = pid.as_int().and_then(|pid| i32::try_from(pid).ok()).filter(|pid| *pid > 0);
        Ok(pid.ok_or_else(|| client.bad_answer("getPid", "expected a process's number"))?)
    }

    fn subscribers(&mut self, node: &str) -> Result<BTreeSet<(String, String)>, GraphError> {
        let caller = self.master.caller().to_owned();
        let info = self.asked(node)?.client.call("getBusInfo", &[caller.as_str().into()])?;
        Ok(outgoing(&info))
    }
}

/// The numbers of the links that lead to `publisher`, by topic, from `getBusInfo`:
/// `[link, publisher's URI, "i", transport, topic, ...]`.
fn our_links(info: &Value, publisher: &str) -> BTreeMap<String, BTreeSet<i64>> {
    let mut ours: BTreeMap<String, BTreeSet<i64>> = BTreeMap::new();
    for row in info.as_list().unwrap_or_default().iter().filter_map(Value::as_list) {
        let text = |at: usize| row.get(at).and_then(Value::as_str).unwrap_or_default();
        let same = text(1).trim_end_matches('/') == publisher.trim_end_matches('/');
        if let (Some(id), true, "i") = (row.first().and_then(Value::as_int), same, text(2)) {
            ours.entry(text(4).to_owned()).or_default().insert(id);
        }
    }
    ours
}

/// Topic and subscriber of each link that leads out of a node, from `getBusInfo`:
/// `[link, subscriber's name, "o", transport, topic, ...]`.
fn outgoing(info: &Value) -> BTreeSet<(String, String)> {
    let rows = info.as_list().unwrap_or_default().iter().filter_map(Value::as_list);
    let links = rows.filter_map(|row| {
        let text = |at: usize| row.get(at).and_then(Value::as_str);
        (text(2)? == "o").then(|| Some((text(4)?.to_owned(), text(1)?.to_owned()))).flatten()
    });
    links.collect()
}

/// The statistics of our link among those of a topic. If the numbers are not known,
/// only a single link is certainly ours.
fn pick(links: &[Value], ours: Option<&BTreeSet<i64>>) -> Option<Received> {
    let links: Vec<_> = links.iter().filter_map(Value::as_list).collect();
    let link = match ours {
        Some(ours) => links.iter().find(|link| {
            link.first().and_then(Value::as_int).is_some_and(|id| ours.contains(&id))
        })?,
        None if links.len() == 1 => links.first()?,
        None => return None,
    };
    let messages = u64::try_from(link.get(2)?.as_int()?).ok()?;
    let drops = link.get(3).and_then(Value::as_int).and_then(|drops| u64::try_from(drops).ok());
    Some(Received { messages, drops })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn link(id: i64, messages: i64, drops: i64) -> Value {
        vec![Value::Int(id), Value::Int(1), Value::Int(messages), Value::Int(drops), 1.into()]
            .into()
    }

    #[test]
    fn the_link_is_found_by_its_number_and_drops_mean_what_the_library_means() {
        let row = |id: i64, uri: &str, direction: &str| {
            let words = vec![Value::Int(id), uri.into(), direction.into(), "TCPROS".into()];
            Value::List([words, vec!["/a".into(), true.into()]].concat())
        };
        let info: Value = vec![
            row(3, "http://x:1/", "i"),
            row(4, "http://me:2", "i"),
            row(5, "http://me:2/", "o"),
        ]
        .into();
        let ours = our_links(&info, "http://me:2/");
        assert_eq!(ours["/a"], BTreeSet::from([4]));
        let to = ("/a".to_owned(), "http://me:2/".to_owned());
        assert_eq!(outgoing(&info), BTreeSet::from([to]));
        let roscpp = pick(&[link(4, 20_000, 19_940)], ours.get("/a")).unwrap();
        assert_eq!(roscpp.reached(), 60);
        let rospy = pick(&[link(3, 1, -1), link(4, 8_682, -1)], ours.get("/a")).unwrap();
        assert_eq!((rospy.reached(), rospy.drops), (8_682, None));
        assert_eq!(pick(&[link(3, 1, 0)], ours.get("/a")), None);
        assert_eq!(pick(&[link(3, 1, 0), link(4, 1, 0)], None), None);
    }
}
