//! What nodes have done with our messages, by the ledger that they count in.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{Audit, GraphError, Publication as _, Received};
use bagpipe_ros2ledger::{Endpoint, Kind, Ledger};

use crate::connections::standing;
use crate::error::failed;
use crate::recording::Inputs;
use crate::topic::{Look, Topic};

/// Reads the ledger; nobody is asked, so nobody can keep us waiting.
pub(crate) struct Reader {
    pub(crate) ledger: Arc<Ledger>,
    pub(crate) topics: Vec<Arc<Topic>>,
    pub(crate) inputs: Arc<Inputs>,
}

impl Audit for Reader {
    fn ask(
        &mut self,
        _: &str,
        links: &BTreeMap<String, Vec<u64>>,
    ) -> Result<BTreeMap<(String, u64), Received>, GraphError> {
        let mut found = BTreeMap::new();
        let endpoints = self.ledger.endpoints().map_err(failed)?;
        for topic in &self.topics {
            let name = &topic.info().topic;
            let Some(numbers) = links.get(name) else { continue };
            topic.learn_publishers(&endpoints);
            for link in numbers.iter().filter_map(|number| topic.link_with(*number)) {
                // One that was created just before the last look was not complete by then.
                link.note_strength(&endpoints);
                if link.is_unknown(&self.ledger).map_err(failed)? {
                    continue;
                }
                if let Some(messages) = link.taken(&self.ledger).map_err(failed)? {
                    let messages = messages.min(link.sent());
                    found.insert((name.clone(), link.id()), Received { messages, drops: None });
                }
            }
        }
        Ok(found)
    }

    fn outlives_nodes(&self) -> bool {
        true
    }

    fn pid(&mut self, node: &str) -> Result<i32, GraphError> {
        let look = Look::at(&self.ledger).map_err(failed)?;
        let own = look.all_there().find(|one| one.node == node);
        let pid = own.and_then(|one| i32::try_from(one.process.pid).ok());
        pid.ok_or_else(|| failed(format!("{node} does not count, so its process is not known")))
    }

    fn subscribers(&mut self, node: &str) -> Result<BTreeSet<(String, String)>, GraphError> {
        let look = Look::at(&self.ledger).map_err(failed)?;
        let ours = |one: &Endpoint| match one.kind {
            Kind::Publisher => usize::from(self.inputs.of(&one.topic).is_some()),
            Kind::Subscription => self.topics.iter().filter(|topic| topic.plays_to(one)).count(),
        };
        Ok(standing(&look, node, ours))
    }
}
