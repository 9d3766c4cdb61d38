//! What nodes have done with our messages, by the ledger that they count in.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{Audit, GraphError, Publication as _, Received};
use bagpipe_ros2ledger::{Kind, Ledger};

use crate::error::failed;
use crate::topic::Topic;

/// Reads the ledger; nobody is asked, so nobody can keep us waiting.
pub(crate) struct Reader {
    pub(crate) ledger: Arc<Ledger>,
    pub(crate) topics: Vec<Arc<Topic>>,
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
                if link.is_mixed(&self.ledger).map_err(failed)? {
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
        let endpoints = self.ledger.endpoints().map_err(failed)?;
        let own = endpoints.iter().find(|one| one.node == node && !one.destroyed);
        let pid = own.and_then(|one| i32::try_from(one.process.pid).ok());
        pid.ok_or_else(|| failed(format!("{node} does not count, so its process is not known")))
    }

    fn subscribers(&mut self, node: &str) -> Result<BTreeSet<(String, String)>, GraphError> {
        let endpoints = self.ledger.endpoints().map_err(failed)?;
        let there = endpoints.iter().filter(|one| !one.destroyed);
        let published: BTreeSet<&String> = there
            .clone()
            .filter(|one| one.kind == Kind::Publisher && one.node == node)
            .map(|one| &one.topic)
            .collect();
        let connected = there.filter(|one| one.kind == Kind::Subscription && one.node != node);
        // How many publishers a subscription knows is known, not which: one of them will do. A
        // process that has not reported yet is waited for, as long as anything is before a play.
        let connected = connected.filter(|one| one.matched.is_some_and(|known| known > 0));
        let links = connected.filter(|one| published.contains(&one.topic));
        Ok(links.map(|one| (one.topic.clone(), one.node.clone())).collect())
    }
}
