//! Who else is in the graph, and who of them counts.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{GraphError, Publication, SystemState, TopicInfo};
use bagpipe_ros2ledger::{Endpoint, Kind, Strength, Unlisted};
use bagpipe_ros2player::GraphNode;

use super::Graph;
use crate::absence::counted;
use crate::error::failed;
use crate::seen::state;
use crate::topic::{Look, PLAYER, Topic, uncounted};

/// How long an endpoint may be in the graph before its process has listed it: a moment, unless that
/// gets no processor just then.
pub(super) const UNLISTED: Duration = Duration::from_millis(500);
/// How often it is looked for meanwhile.
pub(super) const AGAIN: Duration = Duration::from_millis(5);

/// Who else is there at a moment.
pub(super) struct Around {
    pub(super) nodes: Vec<GraphNode>,
    pub(super) look: Look,
    pub(super) state: SystemState,
}

impl Graph {
    /// Fails where another case plays into the same domain.
    pub(super) fn must_be_alone(&self, nodes: &[GraphNode]) {
        if let Some(other) = nodes.iter().find_map(|node| foreign_player(&node.name)) {
            self.inputs.fail(format!(
                "{other} of another case is in the same domain, so that each receives what the \
                 other plays: the stack sets ROS_DOMAIN_ID, which must be left to the agent"
            ));
        }
    }

    /// The graph and the ledger, which was read after it, and who is in both. A node that the ledger
    /// does not have is new in the graph, or has just left it, or does not count: it is known which
    /// after a while.
    pub(super) fn look_around(&self) -> Result<Around, GraphError> {
        let (mut looked, mut waited) = (Instant::now(), Duration::ZERO);
        loop {
            let nodes = self.means.player.graph().map_err(failed)?;
            let look = Look::at(self.ledger()).map_err(failed)?;
            let state = state(&look.endpoints, &nodes);
            let settled = |topic: &Arc<Topic>| {
                self.unlisted(topic, &state, &look).iter().all(|node| topic.is_uncounted(node))
            };
            if waited >= UNLISTED || self.topics().iter().all(settled) {
                return Ok(Around { nodes, look, state });
            }
            std::thread::sleep(AGAIN);
            let now = Instant::now();
            waited += counted(now - looked);
            looked = now;
        }
    }

    /// Whether a process is a node's that counts, ours, or none of a node; one that has loaded ROS 2 and has
    /// no endpoint yet is to have some.
    pub(super) fn is_there(&self, pid: i32) -> bool {
        let Ok(pid) = u32::try_from(pid) else { return false };
        let is_clear = |of: Option<Strength>| of.is_none_or(|of| of > Strength::Received);
        pid == self.means.player.pid() || self.ledger().strength_of(pid).is_ok_and(is_clear)
    }

    /// The nodes that subscribe to a topic, and whose subscriptions the ledger does not have. By topic: a
    /// node may count in one of its processes, or with some of its endpoints.
    pub(super) fn unlisted(
        &self,
        topic: &Topic,
        state: &SystemState,
        look: &Look,
    ) -> BTreeSet<String> {
        let name = &topic.info().topic;
        let counts = |node: &String| listed_on(name, &look.endpoints).any(|one| one.node == *node);
        let named = state.subscribers.get(name).into_iter().flatten();
        named.filter(|node| **node != self.name && !counts(node)).cloned().collect()
    }

    /// The nodes but ours that publish a topic.
    pub(super) fn publishing<'s>(
        &self,
        state: &'s SystemState,
        topic: &str,
    ) -> impl Iterator<Item = &'s String> {
        let all = state.publishers.get(topic).into_iter().flatten();
        all.filter(|node| **node != self.name)
    }

    /// Who subscribes to what is played and has not matched us, and what that may come of.
    fn unmatched(&self) -> Vec<String> {
        let mut nodes = None;
        let mut remarks = Vec::new();
        for topic in self.topics().iter() {
            let TopicInfo { topic: name, datatype, .. } = topic.info();
            for node in topic.unmatched_nodes() {
                let all =
                    nodes.get_or_insert_with(|| self.means.player.graph().unwrap_or_default());
                let own = all.iter().filter(|one| one.name == node).flat_map(|one| &one.subscribes);
                let other = own.filter(|(topic, _)| topic == name).map(|(_, of)| of);
                let why = match other.clone().find(|of| *of != datatype) {
                    Some(of) => format!("it asks for {of}, and {datatype} is played"),
                    None => "as if it were in another domain".to_owned(),
                };
                remarks.push(format!(
                    "{node} subscribes to {name} and has not matched the player, so that it got \
                     nothing of ours, by all that is known: {why}"
                ));
            }
        }
        remarks
    }

    /// Of which programs that are no nodes nothing is known.
    fn unnamed(&self) -> Vec<String> {
        let mut remarks = Vec::new();
        for (topic, many) in self.inputs.all().iter().map(|one| (&one.topic, one.unnamed.seen())) {
            if many > 0 {
                remarks.push(format!(
                    "programs of DDS that are no nodes, or nodes of a name that another has, publish {topic} (at \
                     least {many}), so that whether all of it was recorded can't be known"
                ));
            }
        }
        for topic in self.topics().iter().filter(|topic| topic.unnamed() > 0) {
            remarks.push(format!(
                "programs of DDS that are no nodes, or nodes of a name that another has, subscribe to {} (at \
                 least {}), so that what they got of ours can't be known",
                topic.info().topic,
                topic.unnamed()
            ));
        }
        remarks
    }

    /// What nobody compared or could separate.
    pub(super) fn uncounted(&self) -> Vec<String> {
        let Ok(endpoints) = self.ledger().endpoints() else { return Vec::new() };
        let mut remarks = Vec::new();
        for input in self.inputs.all() {
            let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
            remarks.extend(uncounted(&input.topic, &others, &endpoints).into_iter().map(|node| {
                format!(
                    "{node} publishes {} in a process that does not count, so that whether all \
                     of it was recorded can't be known",
                    input.topic
                )
            }));
        }
        for topic in self.topics().iter() {
            remarks.extend(topic.confused().into_iter().map(|node| {
                format!(
                    "a subscription of {node} to {} came or went during the play, so that what it got of \
                     ours can't be known",
                    topic.info().topic
                )
            }));
            remarks.extend(topic.mixed().into_iter().map(|node| {
                format!(
                    "the stack publishes {} too, and the middleware of {node} does not say whose \
                     messages it takes, so that what it got of ours can't be known",
                    topic.info().topic
                )
            }));
        }
        remarks.extend(self.unmatched());
        remarks.extend(self.unnamed());
        let Unlisted { processes, endpoints } = self.ledger().unlisted();
        if processes + endpoints > 0 {
            remarks.push(format!(
                "the ledger had no room for {processes} processes and {endpoints} endpoints of the \
                 stack: nothing is proved of these"
            ));
        }
        remarks.sort();
        remarks.dedup();
        remarks
    }
}

/// The subscriptions of a topic that count, also those of processes that were killed, which are in the
/// graph for a while.
fn listed_on<'e>(topic: &'e str, endpoints: &'e [Endpoint]) -> impl Iterator<Item = &'e Endpoint> {
    let there = endpoints.iter().filter(|one| !one.destroyed);
    there.filter(move |one| one.kind == Kind::Subscription && one.topic == topic)
}

/// The name, if it is that of a player of another process that runs. One that was killed is in the
/// graph for a while, and plays no more.
fn foreign_player(name: &str) -> Option<&str> {
    let (process, _) = name.strip_prefix(PLAYER)?.split_once('_')?;
    let process: u32 = process.parse().ok()?;
    let runs = || Path::new("/proc").join(process.to_string()).exists();
    (process != std::process::id() && runs()).then_some(name)
}
