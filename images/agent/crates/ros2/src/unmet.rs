//! Publishers of what is recorded that were there when the play began, and whom the recorder did not know
//! by then: what they have published since and did not reach it is lost, and in nobody else's account.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use bagpipe_ros2ledger::{Endpoint, EndpointId};

/// By topic, each with what it had published when the play began.
#[derive(Default)]
pub(crate) struct Unmet(Mutex<BTreeMap<String, BTreeMap<EndpointId, u64>>>);

impl Unmet {
    /// Takes in that the play begins without these.
    pub(crate) fn begin<'e>(&self, unmet: impl Iterator<Item = &'e Endpoint>) {
        let mut all = BTreeMap::<String, BTreeMap<EndpointId, u64>>::new();
        for one in unmet {
            all.entry(one.topic.clone()).or_default().insert(one.id, one.counts.published);
        }
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = all;
    }

    /// How many messages lack of all topics, of each of which the recorder was `handed` so many.
    pub(crate) fn missing(&self, endpoints: &[Endpoint], handed: impl Fn(&str) -> u64) -> u64 {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let missing = |(topic, begun): (&String, &_)| {
            published(begun, endpoints).saturating_sub(handed(topic))
        };
        all.iter().map(missing).sum()
    }

    /// The same as sentences, one for each topic of which some lack.
    pub(crate) fn lacking(
        &self,
        endpoints: &[Endpoint],
        handed: impl Fn(&str) -> u64,
    ) -> Vec<String> {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.iter()
            .filter_map(|(topic, begun)| lacks(topic, begun, endpoints, handed(topic)))
            .collect()
    }
}

/// Those of the endpoints that were unmet, each with what it had published by then.
fn own<'e>(
    begun: &'e BTreeMap<EndpointId, u64>,
    endpoints: &'e [Endpoint],
) -> impl Iterator<Item = (&'e Endpoint, &'e u64)> {
    endpoints.iter().filter_map(|one| Some((one, begun.get(&one.id)?)))
}

/// What these have published since the play began.
fn published(begun: &BTreeMap<EndpointId, u64>, endpoints: &[Endpoint]) -> u64 {
    own(begun, endpoints).map(|(one, before)| one.counts.published.saturating_sub(*before)).sum()
}

fn lacks(
    topic: &str,
    begun: &BTreeMap<EndpointId, u64>,
    endpoints: &[Endpoint],
    handed: u64,
) -> Option<String> {
    let mut nodes: Vec<&str> = own(begun, endpoints).map(|(one, _)| one.node.as_str()).collect();
    nodes.sort_unstable();
    nodes.dedup();
    let missing = published(begun, endpoints).saturating_sub(handed);
    (missing > 0).then(|| {
        format!(
            "{missing} messages of {topic} did not reach the recorder, which {} did not know when the play \
             began: is there another node of its name, which hides it in the graph? is it in the case's \
             domain (ROS_DOMAIN_ID is the agent's)? or had they no processor to find each other?",
            nodes.join(", ")
        )
    })
}
