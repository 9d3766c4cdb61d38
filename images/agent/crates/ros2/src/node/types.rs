//! As which types the graph has what is recorded.

use std::collections::BTreeMap;
use std::time::Instant;

use bagpipe_graph::{GraphError, SystemState};
use bagpipe_ros2ledger::Endpoint;
use bagpipe_ros2player::GraphPublisher;

use super::Graph;
use super::recorded::published_on;
use crate::error::failed;
use crate::other_types::{Differing, differing};
use crate::recording::Input;
use crate::seen::is_of_command_line;
use crate::unnamed;

impl Graph {
    /// Who else publishes a topic, whether the graph names it or not.
    fn others_on(&self, topic: &str) -> Result<Vec<GraphPublisher>, GraphError> {
        let mut all = self.means.player.publishers_of(topic).map_err(failed)?;
        all.retain(|one| one.node.as_deref() != Some(&self.name));
        Ok(all)
    }

    /// The type that others publish a topic as: of several that of a node.
    pub(super) fn type_of(&self, topic: &str) -> Result<Option<String>, GraphError> {
        let others = self.others_on(topic)?.into_iter();
        let first = others.min_by_key(|one| (one.node.is_none(), one.datatype.clone()));
        Ok(first.map(|one| one.datatype))
    }

    /// The topics that others publish and that have no publisher in this state; but for those of the command line.
    pub(super) fn topics_without_names(
        &self,
        state: &SystemState,
    ) -> Result<Vec<String>, GraphError> {
        let mut found = Vec::new();
        for topic in self.topics_of_graph()?.into_keys() {
            if state.publishers.contains_key(&topic) {
                continue;
            }
            let is_person =
                |one: &GraphPublisher| one.node.as_deref().is_some_and(is_of_command_line);
            if !self.others_on(&topic)?.iter().all(is_person) {
                found.push(topic);
            }
        }
        Ok(found)
    }

    /// The topics of the graph, each with how many types it has, whoever publishes it or subscribes to it.
    pub(super) fn topics_of_graph(&self) -> Result<BTreeMap<String, u32>, GraphError> {
        self.means.player.topics_of_graph().map_err(failed)
    }

    /// Takes in who publishes a recorded topic as another type, if the last look at it is not just over.
    pub(super) fn look_for_other_types(
        &self,
        input: &Input,
        types: &BTreeMap<String, u32>,
        endpoints: &[Endpoint],
    ) {
        // Most have one, and those of a thousand are not asked for one by one.
        let several = types.get(&input.topic).is_some_and(|many| *many > 1);
        let differing =
            || if several { self.differing(input, endpoints) } else { Differing::default() };
        input.other_types.look(Instant::now(), differing);
    }

    /// The publishers of another type. Those that count are taken in. A graph that can't be read is reported by who has
    /// read it before.
    fn differing(&self, input: &Input, endpoints: &[Endpoint]) -> Differing {
        let Ok(others) = self.others_on(&input.topic) else { return Differing::default() };
        let recorded = &input.publisher.datatype;
        let mut counting: BTreeMap<&str, u64> = BTreeMap::new();
        for one in published_on(&input.topic, endpoints).filter(|one| !one.destroyed) {
            *counting.entry(&one.node).or_default() += 1;
        }
        let found = differing(&others, recorded, &counting);
        for (node, other) in &found.counting {
            let mut own = published_on(&input.topic, endpoints).filter(|one| one.node == *node);
            if own.any(|one| one.counts.published > 0) {
                input.unrecordable().insert(format!(
                    "{node} publishes {} as {other}, and it is recorded as {recorded}: a topic has one \
                     type",
                    input.topic
                ));
            }
        }
        found
    }

    /// Takes in once more who publishes what is recorded as another type: a play may be shorter than the looks that it
    /// takes to be certain.
    pub(super) fn look_for_other_types_at_last(&self) {
        for _look in 0..=unnamed::LOOKS {
            // Who can't be read is reported by who has read it before.
            let (Ok(types), Ok(endpoints)) = (self.topics_of_graph(), self.ledger().endpoints())
            else {
                return;
            };
            let mut are = false;
            for input in self.inputs.all() {
                are |= types.get(&input.topic).is_some_and(|many| *many > 1)
                    && self.differing(&input, &endpoints).uncounted > 0;
                self.look_for_other_types(&input, &types, &endpoints);
            }
            if !are {
                return;
            }
            std::thread::sleep(unnamed::EVERY);
        }
    }
}
