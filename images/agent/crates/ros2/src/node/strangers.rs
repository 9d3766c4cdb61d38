//! Who does not count and is not named for it: programs that are no nodes, and nodes of a name that another has.

use std::collections::BTreeSet;
use std::sync::PoisonError;
use std::time::Instant;

use bagpipe_graph::{Publication, SystemState};
use bagpipe_ros2ledger::{Endpoint, EndpointId, Kind};
use bagpipe_ros2player::GraphNode;

use super::Graph;
use crate::other_types::Types;
use crate::publishers::unnamed;
use crate::recording::Input;
use crate::seen::{people_who_publish, state};
use crate::topic::{Look, uncounted};
use crate::unnamed;

/// Recorded topics of which a look asks who publishes them though nothing hints at strangers: an answer was measured to
/// take 1.2 ms, and a thousand at each look would delay what else it finds.
const ASKED: usize = 64;

impl Graph {
    /// Takes in who publishes a recorded topic by the graph's names.
    pub(super) fn note_others(&self, input: &Input, nodes: &[GraphNode], state: &SystemState) {
        let others = self.publishing(state, &input.topic);
        let others = others.chain(people_who_publish(nodes, &input.topic)).cloned();
        input.others.lock().unwrap_or_else(PoisonError::into_inner).extend(others);
    }

    /// Takes in how many strangers there are at each topic that is played or recorded.
    pub(super) fn look_for_unnamed(&self, nodes: &[GraphNode], types: &Types, look: &Look) {
        let mut inputs = self.inputs.all();
        for topic in self.topics().iter() {
            let name = &topic.info().topic;
            let recorded = inputs.iter().any(|input| input.topic == *name);
            let listed = self.listed(nodes, look, Kind::Subscription, name);
            if let Some(listed) = listed.filter(|_| !recorded) {
                topic.look_for_unnamed(listed);
            }
        }
        // Who was asked for the longest ago is asked first.
        inputs.sort_by_cached_key(|input| input.unnamed.asked());
        let mut room = ASKED;
        for input in inputs {
            if !self.hints_at_unnamed(&input, types, look) {
                if room == 0 {
                    continue;
                }
                room -= 1;
            }
            let more = || self.unnamed_publishers(&input, nodes, look);
            input.unnamed.look(Instant::now(), more);
        }
    }

    /// Whether a topic is asked for at each look, however many there are.
    fn hints_at_unnamed(&self, input: &Input, types: &Types, look: &Look) -> bool {
        let there = look.there(Kind::Publisher, &input.topic).count() as u64;
        let matched = self.means.player.publishers(input.subscription).unwrap_or_default();
        let of_types = types.get(&input.topic).is_some_and(|of| of.count > 1);
        matched != there || of_types || input.unnamed.is_suspected()
    }

    /// How many endpoints of a topic the ledger has, if all nodes count that the graph has at it. Also those of processes
    /// that have ended, which are matched for a while.
    fn listed(&self, nodes: &[GraphNode], look: &Look, kind: Kind, topic: &str) -> Option<u64> {
        let all = look.endpoints.iter().filter(|one| one.kind == kind && one.topic == topic);
        let there: Vec<&Endpoint> = all.filter(|one| !one.destroyed).collect();
        let has = |node: &&GraphNode| {
            let on = if kind == Kind::Publisher { &node.publishes } else { &node.subscribes };
            node.name != self.name && on.iter().any(|on| on.0 == topic)
        };
        let counts = |node: &GraphNode| there.iter().any(|one| one.node == node.name);
        nodes.iter().filter(has).all(counts).then_some(there.len() as u64)
    }

    /// How many publish a recorded topic that neither count nor are named for it; where no GIDs are known, those that are
    /// matched beyond the listed ones, if all nodes of the topic count. As many may be matched as are listed, and be others:
    /// what a publisher offers may match no recorder of the rest.
    fn unnamed_publishers(&self, input: &Input, nodes: &[GraphNode], look: &Look) -> u64 {
        let Ok(shown) = self.others_on(&input.topic) else { return 0 };
        let judge = |look: &Look| {
            let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
            let named = uncounted(&input.topic, &others, &look.endpoints);
            unnamed(&shown, &self.known_on(&input.topic, look), &named)
        };
        let by_gid = self.judged(look, judge, |many| many.is_some_and(|many| many > 0));
        by_gid.unwrap_or_else(|| {
            let played = self.topics().iter().any(|topic| topic.info().topic == input.topic);
            let listed = self.listed(nodes, look, Kind::Publisher, &input.topic);
            let matched = self.means.player.publishers(input.subscription).unwrap_or_default();
            listed.filter(|_| !played).map_or(0, |listed| matched.saturating_sub(listed))
        })
    }

    /// Takes in once more who publishes what is recorded and does not count: who has come by the end is there for fewer
    /// looks than it takes to be certain.
    pub(super) fn look_for_unnamed_at_last(&self) {
        let mut inputs = self.inputs.all();
        for _look in 0..=unnamed::LOOKS {
            // Who can't be read is reported by who has read it before.
            let (Ok(nodes), Ok(look)) = (self.means.player.graph(), Look::at(self.ledger())) else {
                return;
            };
            let state = state(&look.endpoints, &nodes);
            inputs.retain(|input| {
                self.note_others(input, &nodes, &state);
                let more = self.unnamed_publishers(input, &nodes, &look);
                input.unnamed.look(Instant::now(), || more);
                more > input.unnamed.seen()
            });
            if inputs.is_empty() {
                return;
            }
            std::thread::sleep(unnamed::EVERY);
        }
    }

    /// How many publish a recorded topic and do not count, named for it or not; asked for where a look has found some.
    fn uncounted_on(&self, input: &Input, look: &Look) -> u64 {
        let are_named = || {
            let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
            !uncounted(&input.topic, &others, &look.endpoints).is_empty()
        };
        if !input.unnamed.is_suspected() && !are_named() {
            return 0;
        }
        let Ok(shown) = self.others_on(&input.topic) else { return 0 };
        let judge = |look: &Look| unnamed(&shown, &self.known_on(&input.topic, look), &[]);
        self.judged(look, judge, |many| many.is_some_and(|many| many > 0)).unwrap_or_default()
    }

    /// Whether all publishers that the recorder has matched may be others than those that count and do not report it:
    /// their messages come all the same, and nobody's own are known by them.
    pub(super) fn matches_others(&self, input: &Input, look: &Look) -> bool {
        let uncounted = self.uncounted_on(input, look);
        let acquaintance = input.acquaintance();
        let there = look.there(Kind::Publisher, &input.topic);
        let reporting = there.filter(|one| acquaintance.has_reported(one.id)).count() as u64;
        drop(acquaintance);
        let matched = self.means.player.publishers(input.subscription);
        uncounted > 0 && matched.is_ok_and(|matched| matched <= uncounted + reporting)
    }

    /// The publishers of a recorded topic that report whom they have matched, and not the recorder, where it may have
    /// matched others alone.
    pub(super) fn apart(&self, input: &Input, look: &Look) -> BTreeSet<EndpointId> {
        if !self.matches_others(input, look) {
            return BTreeSet::new();
        }
        let acquaintance = input.acquaintance();
        let there = look.there(Kind::Publisher, &input.topic);
        let apart = |one: &&Endpoint| one.matched.is_some() && !acquaintance.has_reported(one.id);
        there.filter(apart).map(|one| one.id).collect()
    }
}
