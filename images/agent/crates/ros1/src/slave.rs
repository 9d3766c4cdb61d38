//! The Slave API (<https://wiki.ros.org/ROS/Slave_API>): what a node answers to others.

use bagpipe_graph::Publication as _;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::Value;
use crate::calls::{self, Answer};
use crate::node::Graph;

/// Answers one XML-RPC call.
pub(crate) fn answer(graph: &Graph, body: &str) -> String {
    calls::answer(body, |method, params| dispatch(graph, method, &params))
}

/// `None` if there is no such method.
fn dispatch(graph: &Graph, method: &str, params: &[Value]) -> Option<Answer> {
    let fine = |value: Value| Some(Answer::Fine(String::new(), value));
    match method {
        "getBusStats" => fine(bus_stats(graph)),
        "getBusInfo" => fine(bus_info(graph)),
        "getMasterUri" => fine(graph.master.uri().into()),
        "shutdown" | "paramUpdate" => fine(Value::Int(0)),
        "getPid" => fine(Value::Int(i64::from(std::process::id()))),
        "getSubscriptions" => fine(pairs(graph.subscribed_topics(), |_| "*".to_owned())),
        "getPublications" => fine(Value::List(
            graph
                .publications()
                .iter()
                .map(|p| {
                    let info = p.info();
                    vec![info.topic.as_str().into(), info.datatype.as_str().into()].into()
                })
                .collect(),
        )),
        "publisherUpdate" => {
            let topic = params.get(1).and_then(Value::as_str).unwrap_or_default();
            let uris = params.get(2).and_then(Value::as_list).unwrap_or_default();
            let uris = uris.iter().filter_map(|uri| uri.as_str().map(str::to_owned)).collect();
            graph.update_publishers(topic, uris);
            fine(Value::Int(0))
        }
        "requestTopic" => Some(request_topic(graph, params)),
        _ => None,
    }
}

fn request_topic(graph: &Graph, params: &[Value]) -> Answer {
    let refused = |why: String| Answer::Refused(0, why, Value::Int(0));
    let topic = params.get(1).and_then(Value::as_str).unwrap_or_default();
    if graph.publication(topic).is_none() {
        return refused(format!("{topic} is not published by {}", graph.name));
    }
    let protocols = params.get(2).and_then(Value::as_list).unwrap_or_default();
    let tcp = protocols.iter().any(|protocol| {
        let name = protocol.as_list().and_then(|list| list.first()).and_then(Value::as_str);
        name == Some("TCPROS")
    });
    if !tcp {
        return refused("only TCPROS is spoken here".to_owned());
    }
    let address = graph.data_address;
    let place = vec![
        "TCPROS".into(),
        address.ip().to_string().into(),
        Value::Int(i64::from(address.port())),
    ];
    Answer::Fine(format!("ready on {address}"), place.into())
}

/// `[publish, subscribe, service]`: what was written to the links that we publish on, and
/// what was taken from those that we read, of which nothing is ever dropped.
fn bus_stats(graph: &Graph) -> Value {
    let published = graph.publications().into_iter().map(|publication| {
        let links = publication.subscribers().into_iter().map(|link| {
            let messages = clamp(link.lead_in + link.counted);
            vec![clamp(link.id), clamp(link.counted_bytes), messages, link.open.into()].into()
        });
        let links = Value::List(links.collect());
        vec![publication.info().topic.as_str().into(), Value::Int(0), links].into()
    });
    let subscribed = graph.incoming_links().into_iter().map(|(topic, links)| {
        let links = links.into_iter().map(|(_, id, counts)| {
            let count = |count: &AtomicU64| clamp(count.load(Ordering::Relaxed));
            let (bytes, messages) = (count(&counts.bytes), count(&counts.messages));
            vec![clamp(id), bytes, messages, Value::Int(0), true.into()].into()
        });
        vec![topic.into(), Value::List(links.collect())].into()
    });
    let subscribed = Value::List(subscribed.collect());
    vec![Value::List(published.collect()), subscribed, Value::List(Vec::new())].into()
}

fn bus_info(graph: &Graph) -> Value {
    let mut rows = Vec::new();
    for publication in graph.publications() {
        let topic = publication.info().topic.clone();
        for link in publication.subscribers().into_iter().filter(|link| link.open) {
            rows.push(row(clamp(link.id), link.node, "o", &topic));
        }
    }
    for (topic, links) in graph.incoming_links() {
        for (uri, id, _) in links {
            rows.push(row(clamp(id), uri, "i", &topic));
        }
    }
    rows.into()
}

fn row(id: Value, other: String, direction: &str, topic: &str) -> Value {
    vec![id, other.into(), direction.into(), "TCPROS".into(), topic.into(), true.into()].into()
}

fn pairs(topics: Vec<String>, datatype: impl Fn(&str) -> String) -> Value {
    let pairs = topics.into_iter().map(|topic| {
        let datatype = datatype(&topic);
        vec![topic.into(), datatype.into()].into()
    });
    Value::List(pairs.collect())
}

/// XML-RPC integers have 31 bits and a sign; statistics stop there rather than wrap.
fn clamp(count: u64) -> Value {
    Value::Int(count.min(i32::MAX as u64) as i64)
}
