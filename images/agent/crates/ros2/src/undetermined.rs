//! Nodes whose answers in lock-step may differ from run to run, though they are played the same.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, PoisonError};

use bagpipe_ros2ledger::{Endpoint, Kind, Ledger, LedgerError, Process, ProcessId, Strength};

/// Calls of timers that go by the machine's clock, of each process, when the play began.
#[derive(Default)]
pub(crate) struct Undetermined(Mutex<BTreeMap<ProcessId, u64>>);

impl Undetermined {
    /// Takes in that the play begins.
    pub(crate) fn begin(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        let calls = ledger.processes()?.into_iter().map(|one| (one.id, one.machine_timers));
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = calls.collect();
        Ok(())
    }

    /// Who may differ, and why, as sentences.
    pub(crate) fn remarks(&self, ledger: &Ledger) -> Result<Vec<String>, LedgerError> {
        let before = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        Ok(remarks(&before, &ledger.processes()?, &ledger.endpoints()?))
    }
}

fn remarks(
    before: &BTreeMap<ProcessId, u64>,
    processes: &[Process],
    endpoints: &[Endpoint],
) -> Vec<String> {
    let mut remarks = Vec::new();
    for process in processes {
        let of_it: Vec<&Endpoint> =
            endpoints.iter().filter(|one| one.process == process.id).collect();
        let calls =
            process.machine_timers.saturating_sub(before.get(&process.id).copied().unwrap_or(0));
        if calls > 0 {
            let nodes = named(&of_it);
            remarks.push(format!(
                "timers of the machine's clock called back {calls} times in {nodes} during the play: \
                 how often differs from run to run, and so may what it publishes; give it timers of \
                 its node's clock (create_timer), and use_sim_time"
            ));
        }
        if process.spinners > 1 && of_it.iter().any(|one| has_no_ends(one)) {
            let (threads, nodes) = (process.spinners, named(&of_it));
            remarks.push(format!(
                "{threads} threads of {nodes} have waited for messages or taken some, and when a \
                 callback ends is not reported: lock-step may go on before that, and two runs may \
                 differ; give it one thread"
            ));
        }
    }
    remarks.sort();
    remarks
}

/// Whether the end of its callbacks is concluded from what the thread does next.
fn has_no_ends(one: &Endpoint) -> bool {
    one.kind == Kind::Subscription && one.strength < Strength::Called && one.counts.taken > 0
}

/// The nodes of a process, of which these are the endpoints.
fn named(endpoints: &[&Endpoint]) -> String {
    let nodes: BTreeSet<&str> =
        endpoints.iter().map(|one| one.node.as_str()).filter(|node| !node.is_empty()).collect();
    match nodes.is_empty() {
        true => "a process without a node".to_owned(),
        false => nodes.into_iter().collect::<Vec<_>>().join(" and "),
    }
}
