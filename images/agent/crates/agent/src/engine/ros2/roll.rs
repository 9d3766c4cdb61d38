//! The nodes that count when the play begins, and what has become of them at its end.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_ros2::is_of_command_line;
use bagpipe_ros2ledger::{Endpoint, Ledger, ProcessId};

use crate::stack::nodes::{Found, Known};

/// All nodes. A ledger that can't be read fails the replay, so no error is reported here.
pub fn roll(ledger: &Ledger) -> Vec<Known> {
    let alive = live_nodes(ledger, &endpoints(ledger));
    alive.into_iter().map(|(name, process)| known(name, process)).collect()
}

fn known(name: String, process: ProcessId) -> Known {
    let pid = i32::try_from(process.pid).ok();
    Known { name, uri: mark(process), pid, stayed: false }
}

/// Each node that has had an endpoint by now, in each of its processes.
pub fn met(ledger: &Ledger) -> Vec<Known> {
    let named = endpoints(ledger).into_iter().filter(|one| !one.node.is_empty());
    let others = named.filter(|one| !is_of_command_line(&one.node));
    let met: BTreeSet<(String, ProcessId)> = others.map(|one| (one.node, one.process)).collect();
    met.into_iter().map(|(name, process)| known(name, process)).collect()
}

/// Notes who is still there.
pub fn note_stayed(ledger: &Ledger, roll: &mut [Known]) {
    let alive = live_nodes(ledger, &endpoints(ledger));
    for known in roll {
        known.stayed = alive.get(&known.name).is_some_and(|process| mark(*process) == known.uri);
    }
}

/// What has become of each.
pub fn look(ledger: &Ledger, roll: &[Known]) -> Vec<Found> {
    let endpoints = endpoints(ledger);
    let alive = live_nodes(ledger, &endpoints);
    roll.iter().map(|known| found(known, &endpoints, &alive)).collect()
}

fn found(known: &Known, all: &[Endpoint], alive: &BTreeMap<String, ProcessId>) -> Found {
    if let Some(process) = alive.get(&known.name) {
        return if mark(*process) == known.uri { Found::Same } else { Found::Another };
    }
    // Who leaves in order destroys its endpoints first.
    let mut own = all.iter().filter(|one| one.node == known.name && mark(one.process) == known.uri);
    if own.all(|one| one.destroyed) { Found::Unregistered } else { Found::Unreachable }
}

/// Each node that has an endpoint in a process that runs.
fn live_nodes(ledger: &Ledger, endpoints: &[Endpoint]) -> BTreeMap<String, ProcessId> {
    let processes = ledger.processes().unwrap_or_default();
    let runs = |id: ProcessId| processes.iter().any(|process| process.id == id && process.alive);
    let there = endpoints.iter().filter(|one| !one.destroyed && !one.node.is_empty());
    let alive = there.filter(|one| runs(one.process));
    alive.map(|one| (one.node.clone(), one.process)).collect()
}

fn endpoints(ledger: &Ledger) -> Vec<Endpoint> {
    ledger.endpoints().unwrap_or_default()
}

/// One process, also where another has its number later.
fn mark(process: ProcessId) -> String {
    format!("{}/{}", process.pid, process.start)
}
