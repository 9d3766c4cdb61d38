//! As which types the graph has what is recorded.

use std::time::Instant;

use bagpipe_graph::{GraphError, SystemState};
use bagpipe_ros2player::{GraphPublisher, GraphTypes};

use super::Graph;
use crate::error::failed;
use crate::other_types::{Differing, Types, differing};
use crate::recording::Input;
use crate::seen::is_of_command_line;
use crate::topic::Look;
use crate::unnamed;

impl Graph {
    /// Who else publishes a topic, whether the graph names it or not.
    pub(super) fn others_on(&self, topic: &str) -> Result<Vec<GraphPublisher>, GraphError> {
        let mut all = self.means.player.publishers_of(topic).map_err(failed)?;
        all.retain(|one| one.node.as_deref() != Some(&self.name));
        Ok(all)
    }

    /// The topics that others publish and that have no publisher in this state; but for those of the command line.
    pub(super) fn topics_without_names(
        &self,
        state: &SystemState,
    ) -> Result<Vec<String>, GraphError> {
        let mut found = Vec::new();
        let named = |topic: &String| state.publishers.contains_key(topic);
        for topic in self.topics_of_graph()?.into_keys().filter(|topic| !named(topic)) {
            let is_person =
                |one: &GraphPublisher| one.node.as_deref().is_some_and(is_of_command_line);
            if !self.others_on(&topic)?.iter().all(is_person) && self.unnamed_topics.add(&topic) {
                found.push(topic);
            }
        }
        Ok(found)
    }

    /// The topics of the graph, whoever publishes them or subscribes to them.
    pub(super) fn topics_of_graph(&self) -> Result<Types, GraphError> {
        self.means.player.topics_of_graph().map_err(failed)
    }

    /// Takes in who publishes a recorded topic as another type, if the last look at it is not just over.
    pub(super) fn look_for_other_types(&self, input: &Input, types: &Types, look: &Look) {
        let differing = || self.differing(input, types, look);
        input.other_types.look(Instant::now(), differing);
    }

    /// The publishers of another type. Those that count are taken in. A graph that can't be read is reported by who has
    /// read it before.
    pub(super) fn differing(&self, input: &Input, types: &Types, look: &Look) -> Differing {
        let recorded = &input.publisher.datatype;
        // Most have one type, and those of a thousand topics are not asked for one by one.
        let differs = |of: &GraphTypes| of.count > 1 || of.first != *recorded;
        if !types.get(&input.topic).is_some_and(differs) {
            return Differing::default();
        }
        let Ok(others) = self.others_on(&input.topic) else { return Differing::default() };
        let judge = |look: &Look| differing(&others, recorded, &self.known_on(&input.topic, look));
        // From before, so that the play's begin does not come between who is gone and what is taken in.
        let mut unrecordable = input.unrecordable();
        let found = self.judged(look, judge, |found| found.uncounted > 0);
        for (node, other) in &found.counting {
            unrecordable.insert(format!(
                "{node} publishes {} as {other}, and it is recorded as {recorded}: a topic has one type",
                input.topic
            ));
        }
        found
    }

    /// What comes of a look at the ledger; of a later one where that has strangers: who was created between the ledger's
    /// look and the graph's is in the later one alone.
    pub(super) fn judged<F>(
        &self,
        look: &Look,
        judge: impl Fn(&Look) -> F,
        has_strangers: impl FnOnce(&F) -> bool,
    ) -> F {
        let found = judge(look);
        if !has_strangers(&found) {
            return found;
        }
        // A ledger that can't be read fails the next look.
        Look::at(self.ledger()).map_or(found, |later| judge(&later))
    }

    /// Takes in once more who publishes what is recorded as another type, or as what can't be recorded: a play may be
    /// shorter than the looks that it takes to be certain.
    pub(super) fn look_for_other_types_at_last(&self) {
        for _look in 0..=unnamed::LOOKS {
            // Who can't be read is reported by who has read it before.
            let (Ok(types), Ok(look)) = (self.topics_of_graph(), Look::at(self.ledger())) else {
                return;
            };
            let mut are = false;
            for input in self.inputs.all() {
                let found = self.differing(&input, &types, &look);
                are |= found.uncounted > 0;
                self.look_for_unrecordable(&input, &look);
                input.other_types.look(Instant::now(), || found);
            }
            if !are {
                return;
            }
            std::thread::sleep(unnamed::EVERY);
        }
    }
}
