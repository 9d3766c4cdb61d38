//! Which of the stack's own connections stand: what is published before both sides know each other never
//! comes, and no count of ours shows it.

use std::collections::BTreeSet;

use bagpipe_ros2ledger::{Endpoint, Kind};

use crate::topic::Look;

/// Topic and subscriber of each connection that a node sends over: all publishers of the one node and all
/// subscriptions of the other have matched as many as there are for them; `ours` is how many of ours an
/// endpoint may match besides.
pub(crate) fn standing(
    look: &Look,
    node: &str,
    ours: impl Fn(&Endpoint) -> usize,
) -> BTreeSet<(String, String)> {
    let of_kind = |kind| look.all_there().filter(move |one| one.kind == kind);
    let publishers = || of_kind(Kind::Publisher).filter(|one| one.node == node);
    let has_met_all = |one: &Endpoint| has_met_all(look, one, ours(one));
    let published: BTreeSet<&String> = publishers().map(|one| &one.topic).collect();
    let failing: BTreeSet<&String> =
        publishers().filter(|one| !has_met_all(one)).map(|one| &one.topic).collect();
    let (mut standing, mut lacking) = (BTreeSet::new(), BTreeSet::new());
    for one in of_kind(Kind::Subscription).filter(|one| published.contains(&one.topic)) {
        let stands = !failing.contains(&one.topic) && has_met_all(one);
        let link = (one.topic.clone(), one.node.clone());
        if stands { &mut standing } else { &mut lacking }.insert(link);
    }
    &standing - &lacking
}

/// Whether an endpoint has matched as many others as are there for it. What only publishes never reports
/// that: then the subscriptions' word will do.
fn has_met_all(look: &Look, one: &Endpoint, ours: usize) -> bool {
    match one.matched {
        Some(known) => known as usize >= look.counterparts(one) + ours,
        None => one.kind == Kind::Publisher && !look.spins(one),
    }
}
