//! Which of the stack's own connections stand: what is published before both sides know each other never
//! comes, and no count of ours shows it.

use std::collections::BTreeSet;

use bagpipe_ros2ledger::{Endpoint, Kind};

use crate::qos::reaches;

/// An endpoint of the stack that is there.
pub(crate) struct End<'e> {
    pub(crate) endpoint: &'e Endpoint,
    /// How many of ours it may match.
    pub(crate) ours: usize,
    /// Whether its process takes or waits, which reports whom it has matched.
    pub(crate) spins: bool,
}

/// All that are there.
pub(crate) struct Connections<'e>(pub(crate) Vec<End<'e>>);

impl Connections<'_> {
    /// Topic and subscriber of each connection that a node sends over: all publishers of the one node and
    /// all subscriptions of the other have matched as many as there are for them.
    pub(crate) fn of(&self, node: &str) -> BTreeSet<(String, String)> {
        let publishers = || {
            let own = |end: &&End<'_>| end.is(Kind::Publisher) && end.endpoint.node == node;
            self.0.iter().filter(own)
        };
        let published: BTreeSet<&String> = publishers().map(|end| &end.endpoint.topic).collect();
        let failing: BTreeSet<&String> = publishers()
            .filter(|end| !self.has_met_all(end))
            .map(|end| &end.endpoint.topic)
            .collect();
        let (mut standing, mut lacking) = (BTreeSet::new(), BTreeSet::new());
        let others = self.0.iter().filter(|end| end.is(Kind::Subscription));
        for end in others.filter(|end| published.contains(&end.endpoint.topic)) {
            let Endpoint { topic, node, .. } = end.endpoint;
            let stands = !failing.contains(topic) && self.has_met_all(end);
            if stands { &mut standing } else { &mut lacking }.insert((topic.clone(), node.clone()));
        }
        &standing - &lacking
    }

    /// Whether an end has matched as many others as are there for it. What only publishes never reports
    /// that: then the subscriptions' word will do.
    fn has_met_all(&self, end: &End<'_>) -> bool {
        let others = self.0.iter().filter(|other| end.can_match(other)).count();
        match end.endpoint.matched {
            Some(known) => known as usize >= others + end.ours,
            None => end.is(Kind::Publisher) && !end.spins,
        }
    }
}

impl End<'_> {
    fn is(&self, kind: Kind) -> bool {
        self.endpoint.kind == kind
    }

    fn can_match(&self, other: &End<'_>) -> bool {
        let (one, other) = (self.endpoint, other.endpoint);
        one.topic == other.topic
            && match (one.kind, other.kind) {
                (Kind::Publisher, Kind::Subscription) => reaches(&one.qos, &other.qos),
                (Kind::Subscription, Kind::Publisher) => reaches(&other.qos, &one.qos),
                _ => false,
            }
    }
}
