//! Connecting to publishers: requestTopic, TCP, header exchange.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::net::TcpStream;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_graph::Publisher;

use crate::header::ConnectionHeader;
use crate::hosts;
use crate::inbox::{Counts, InLink};
use crate::sockets::lock;
use crate::xmlrpc::Client;
use crate::{RosError, Value, stamp};

/// Attempts to connect to one publisher; a node may register before it listens.
pub(crate) const ATTEMPTS: u32 = 4;

/// How the server of a node of roscpp calls itself. It knows before it registers a topic whether
/// it latches; rospy sets that after (`Publisher.__init__` in its topics.py), so that whoever
/// connects at once is introduced to a publisher that does not latch yet.
const ROSCPP: &str = "XMLRPC++";

/// A publisher that we read: its slave URI, the connection, what that has handed over.
pub(crate) type ReadLink = (String, u64, Arc<Counts>);

/// A subscribed topic: which publishers there are and which of them we read.
#[derive(Default)]
pub(crate) struct Subscription {
    state: Mutex<Publishers>,
}

#[derive(Default)]
struct Publishers {
    /// Slave URIs that the master has named last.
    registered: BTreeSet<String>,
    /// Those that a connection exists to or is being made.
    taken: BTreeSet<String>,
    /// How often a connection that had ended was made again to those that stay registered.
    renewed: BTreeMap<String, u32>,
    /// Those that a connection stands to: its number and what it has handed over.
    connected: BTreeMap<String, (u64, Arc<Counts>)>,
    /// Those that may latch although their introductions have it otherwise, and their connections.
    may_latch: BTreeMap<String, u64>,
}

impl Subscription {
    /// Takes in the master's list; answers the publishers to connect to now.
    pub(crate) fn update(&self, uris: Vec<String>, ourselves: &str) -> Vec<String> {
        let mut state = lock(&self.state);
        let registered: BTreeSet<String> =
            uris.into_iter().filter(|uri| uri != ourselves).collect();
        state.renewed.retain(|uri, _| registered.contains(uri));
        state.registered = registered;
        let new: Vec<_> = state.registered.difference(&state.taken).cloned().collect();
        state.taken.extend(new.iter().cloned());
        new
    }

    /// Whether the publisher is still registered: whether another attempt makes sense.
    pub(crate) fn wants(&self, uri: &str) -> bool {
        lock(&self.state).registered.contains(uri)
    }

    pub(crate) fn connected(&self, uri: &str, link: &InLink) {
        let counts = (link.id, Arc::clone(&link.counts));
        let mut state = lock(&self.state);
        state.connected.insert(uri.to_owned(), counts);
        if link.publisher.may_latch {
            state.may_latch.insert(uri.to_owned(), link.id);
        }
    }

    /// A connection has ended. Whether the caller is to make another one, since the publisher is
    /// registered: it may have taken its topic back and advertised it again before this end was seen.
    /// Of one that ends its connections time and again without a message it is not, until it registers
    /// again.
    #[must_use]
    pub(crate) fn lost(&self, uri: &str) -> bool {
        let mut state = lock(&self.state);
        let ended = state.connected.remove(uri);
        state.may_latch.remove(uri);
        if ended.is_some_and(|(_, counts)| counts.messages.load(Ordering::Relaxed) > 0) {
            state.renewed.remove(uri);
        }
        let renewed = state.renewed.get(uri).copied().unwrap_or(0);
        if !state.registered.contains(uri) || renewed >= ATTEMPTS {
            state.taken.remove(uri);
            return false;
        }
        state.renewed.insert(uri.to_owned(), renewed + 1);
        true
    }

    /// No connection could be made; the next update may try again.
    pub(crate) fn not_reached(&self, uri: &str) {
        lock(&self.state).taken.remove(uri);
    }

    /// How many publishers we read.
    pub(crate) fn connections(&self) -> usize {
        lock(&self.state).connected.len()
    }

    /// The publishers that we read and that may latch against their introductions: slave URI and
    /// connection.
    pub(crate) fn may_latch(&self) -> Vec<(String, u64)> {
        lock(&self.state).may_latch.clone().into_iter().collect()
    }

    /// The publishers that we read: slave URI, connection, what it has handed over.
    pub(crate) fn links(&self) -> Vec<ReadLink> {
        let state = lock(&self.state);
        let link = |(uri, (id, counts)): (&String, &(u64, Arc<Counts>))| {
            (uri.clone(), *id, Arc::clone(counts))
        };
        state.connected.iter().map(link).collect()
    }
}

/// Shakes hands with the publisher of `topic` whose slave API is at `uri`.
///
/// # Errors
/// The node does not answer or publish, or refuses the header.
pub(crate) fn connect(
    our_name: &str,
    topic: &Arc<str>,
    uri: &str,
    deadline: Duration,
) -> Result<InLink, RosError> {
    static NEXT: AtomicU64 = AtomicU64::new(1);
    let (header, stream, server) = reach(our_name, topic, uri, deadline)?;
    let id = NEXT.fetch_add(1, Ordering::Relaxed);
    let (topic, uri, counts) = (Arc::clone(topic), uri.to_owned(), Arc::default());
    let may_latch = !header.latching() && !server.starts_with(ROSCPP);
    let publisher = Publisher { may_latch, ..introduced(&header) };
    Ok(InLink { id, topic, uri, publisher, stream, counts })
}

/// Whether the publisher latches by now, as it introduces itself to a second connection.
///
/// # Errors
/// As [`connect`].
pub(crate) fn latches(
    our_name: &str,
    topic: &str,
    uri: &str,
    deadline: Duration,
) -> Result<bool, RosError> {
    // rospy closes the connection of whom it knows when the same name connects again.
    let name = format!("{our_name}_once_more");
    reach(&name, topic, uri, deadline).map(|(header, ..)| header.latching())
}

/// A publisher's introduction, the connection to it, and what its slave API's server calls itself.
fn reach(
    our_name: &str,
    topic: &str,
    uri: &str,
    deadline: Duration,
) -> Result<(ConnectionHeader, TcpStream, String), RosError> {
    let (host, port, server) = request_topic(our_name, topic, uri, deadline)?;
    let mut stream = hosts::connect(&host, port, deadline)?;
    let header = shake_hands(our_name, topic, &mut stream, deadline).map_err(|why| {
        RosError::Handshake { peer: format!("the publisher of {topic} at {host}:{port}"), why }
    })?;
    Ok((header, stream, server))
}

/// What a publisher says of itself in its header.
fn introduced(header: &ConnectionHeader) -> Publisher {
    let definition = header.text("message_definition").to_owned();
    Publisher {
        node: header.get("callerid").map(str::to_owned),
        datatype: header.text("type").to_owned(),
        md5sum: header.text("md5sum").to_owned(),
        message_encoding: "ros1",
        schema_encoding: "ros1msg",
        latching: header.latching(),
        may_latch: false,
        offered_qos: None,
        read_stamp: stamp::reader(&definition),
        definition,
    }
}

fn request_topic(
    our_name: &str,
    topic: &str,
    uri: &str,
    deadline: Duration,
) -> Result<(String, u16, String), RosError> {
    let client = Client::new(uri, deadline)?;
    let protocols = Value::List(vec![Value::List(vec!["TCPROS".into()])]);
    let (answer, server) =
        client.call_of_server("requestTopic", &[our_name.into(), topic.into(), protocols])?;
    let place = answer.as_list().and_then(|list| {
        let host = list.get(1)?.as_str()?.to_owned();
        Some((host, u16::try_from(list.get(2)?.as_int()?).ok()?, server))
    });
    place.ok_or_else(|| client.bad_answer("requestTopic", "expected [\"TCPROS\", host, port]"))
}

fn shake_hands(
    our_name: &str,
    topic: &str,
    stream: &mut TcpStream,
    deadline: Duration,
) -> Result<ConnectionHeader, String> {
    let io = |error: std::io::Error| error.to_string();
    stream.set_nodelay(true).map_err(io)?;
    stream.set_write_timeout(Some(deadline)).map_err(io)?;
    let ours = ConnectionHeader::new()
        .with("callerid", our_name)
        .with("md5sum", "*")
        .with("tcp_nodelay", "1")
        .with("topic", topic)
        .with("type", "*");
    stream.write_all(&ours.encode()).map_err(io)?;
    let theirs = ConnectionHeader::receive(stream, deadline)?;
    if let Some(error) = theirs.get("error") {
        return Err(error.to_owned());
    }
    for field in ["type", "md5sum"] {
        if theirs.text(field).is_empty() || theirs.text(field) == "*" {
            return Err(format!("its connection header has no {field}"));
        }
    }
    stream.set_nonblocking(true).map_err(io)?;
    Ok(theirs)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OURS: &str = "http://us:1/";
    const TALKER: &str = "http://talker:1/";

    fn update(subscription: &Subscription, registered: &[&str]) -> Vec<String> {
        subscription.update(registered.iter().map(|uri| (*uri).to_owned()).collect(), OURS)
    }

    #[test]
    fn who_advertises_again_before_its_end_was_seen_is_connected_to_again() {
        let subscription = Subscription::default();
        assert_eq!(update(&subscription, &[TALKER, OURS]), [TALKER]);
        assert!(update(&subscription, &[]).is_empty());
        // The old connection is not known to have ended.
        assert!(update(&subscription, &[TALKER]).is_empty());
        assert!(subscription.lost(TALKER));
        // It is being connected to.
        assert!(update(&subscription, &[TALKER]).is_empty());
    }

    #[test]
    fn who_is_gone_is_connected_to_when_it_is_registered() {
        let subscription = Subscription::default();
        update(&subscription, &[TALKER]);
        update(&subscription, &[]);
        assert!(!subscription.lost(TALKER));
        assert_eq!(update(&subscription, &[TALKER]), [TALKER]);
        subscription.not_reached(TALKER);
        assert_eq!(update(&subscription, &[TALKER]), [TALKER]);
    }

    #[test]
    fn who_ends_each_connection_is_connected_to_a_few_times() {
        let subscription = Subscription::default();
        update(&subscription, &[TALKER]);
        let again = |_| subscription.lost(TALKER);
        let gives_one = || {
            let counts = Arc::new(Counts::default());
            counts.messages.store(1, Ordering::Relaxed);
            lock(&subscription.state).connected.insert(TALKER.to_owned(), (1, counts));
        };
        assert_eq!((0..6).map(again).collect::<Vec<_>>(), [true, true, true, true, false, false]);
        update(&subscription, &[]);
        assert_eq!(update(&subscription, &[TALKER]), [TALKER]);
        assert!(subscription.lost(TALKER));
        // The ends of one that publishes are not counted together.
        for _end in 0..9 {
            gives_one();
            assert!(subscription.lost(TALKER));
        }
    }
}
