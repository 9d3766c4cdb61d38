//! The nodes that count when the play begins, and what has become of them at its end.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use bagpipe_ros2::is_of_command_line;
use bagpipe_ros2ledger::{Endpoint, Ledger, LedgerError, Process, ProcessId};
use rustix::time::{ClockId, clock_gettime};

use crate::stack::exit_code::Exit;
use crate::stack::nodes::{Found, Known};

/// The nodes of each name that run, by their processes' marks: two processes may have nodes of one name.
type Alive = BTreeMap<String, BTreeMap<String, Known>>;

/// All nodes, in each of their processes.
///
/// # Errors
/// As the next ones: somebody has spoiled the ledger.
pub fn roll(ledger: &Ledger) -> Result<Vec<Known>, LedgerError> {
    let alive = live_nodes(ledger, &ledger.endpoints()?)?;
    Ok(alive.into_values().flat_map(BTreeMap::into_values).collect())
}

fn known(name: String, process: ProcessId) -> Known {
    let pid = i32::try_from(process.pid).ok();
    let began = Present::read().and_then(|present| present.began(process));
    Known { name, uri: mark(process), pid, stayed: false, began }
}

/// Each node that has had an endpoint by now, in each of its processes, the oldest first. A ledger that can't be read
/// fails the replay and the other questions.
pub fn met(ledger: &Ledger) -> Vec<Known> {
    let others = ledger.endpoints().unwrap_or_default().into_iter().filter(is_of_stack);
    let met: BTreeSet<(String, ProcessId)> = others.map(|one| (one.node, one.process)).collect();
    let mut met: Vec<(String, ProcessId)> = met.into_iter().collect();
    met.sort_by_key(|(_, process)| process.start);
    met.into_iter().map(|(name, process)| known(name, process)).collect()
}

/// Notes who is still there.
pub fn note_stayed(ledger: &Ledger, roll: &mut [Known]) -> Result<(), LedgerError> {
    let alive = live_nodes(ledger, &ledger.endpoints()?)?;
    for known in roll {
        known.stayed = is_there(known, &alive);
    }
    Ok(())
}

/// What has become of each.
pub fn look(ledger: &Ledger, roll: &[Known]) -> Result<Vec<Found>, LedgerError> {
    let endpoints = ledger.endpoints()?;
    let alive = live_nodes(ledger, &endpoints)?;
    let is_own =
        |one: &Endpoint, known: &Known| one.node == known.name && mark(one.process) == known.uri;
    // Who leaves in order destroys its endpoints first.
    let has_left =
        |known: &Known| endpoints.iter().filter(|one| is_own(one, known)).all(|one| one.destroyed);
    Ok(roll.iter().map(|known| found(known, roll, &alive, has_left(known))).collect())
}

fn is_there(known: &Known, alive: &Alive) -> bool {
    alive.get(&known.name).is_some_and(|processes| processes.contains_key(&known.uri))
}

/// What has become of one: another has its name only if that was not there before.
fn found(known: &Known, roll: &[Known], alive: &Alive, has_left: bool) -> Found {
    if is_there(known, alive) {
        return Found::Same;
    }
    let was_there =
        |mark: &String| roll.iter().any(|before| before.name == known.name && before.uri == *mark);
    let mut namesakes = alive.get(&known.name).into_iter().flat_map(BTreeMap::keys);
    match namesakes.any(|mark| !was_there(mark)) {
        true => Found::Another,
        false if has_left => Found::Unregistered,
        false => Found::Unreachable,
    }
}

/// Whether it is a node's, and none of the command line's, which end as they like.
fn is_of_stack(one: &Endpoint) -> bool {
    !one.node.is_empty() && !is_of_command_line(&one.node)
}

/// Each node that has an endpoint in a process that runs.
fn live_nodes(ledger: &Ledger, endpoints: &[Endpoint]) -> Result<Alive, LedgerError> {
    let running = running(ledger)?;
    let there = endpoints.iter().filter(|one| !one.destroyed && is_of_stack(one));
    let mut alive = Alive::new();
    for one in there.filter(|one| running.contains(&one.process)) {
        let processes = alive.entry(one.node.clone()).or_default();
        processes.insert(mark(one.process), known(one.node.clone(), one.process));
    }
    Ok(alive)
}

fn running(ledger: &Ledger) -> Result<BTreeSet<ProcessId>, LedgerError> {
    let processes = ledger.processes()?;
    Ok(processes.iter().filter(|process| process.alive).map(|process| process.id).collect())
}

/// What each process that counts has given exit(3). Two programs of one process have begun at the same moment.
pub fn exits(ledger: &Ledger) -> Result<Vec<Exit>, LedgerError> {
    let Some(present) = Present::read() else { return Ok(Vec::new()) };
    let of = |one: &Process| {
        let (pid, began) = (i32::try_from(one.id.pid).ok()?, present.began(one.id)?);
        Some(Exit { pid, began, status: one.exit_status.map(i32::from) })
    };
    Ok(ledger.processes()?.iter().filter_map(of).collect())
}

/// One moment by both clocks: the one that counts also while the machine sleeps (proc(5), starttime), and ours.
struct Present {
    since_start: Duration,
    now: Instant,
}

impl Present {
    fn read() -> Option<Self> {
        let since_start = clock_gettime(ClockId::Boottime);
        let (seconds, nanoseconds) = (since_start.tv_sec, since_start.tv_nsec);
        let since_start = Duration::new(seconds.try_into().ok()?, nanoseconds.try_into().ok()?);
        Some(Self { since_start, now: Instant::now() })
    }

    /// When a process began.
    fn began(&self, process: ProcessId) -> Option<Instant> {
        let ticks = rustix::param::clock_ticks_per_second();
        let began = Duration::from_millis(process.start * 1000 / ticks);
        self.now.checked_sub(self.since_start.saturating_sub(began))
    }
}

/// One process, also where another has its number later.
fn mark(process: ProcessId) -> String {
    format!("{}/{}", process.pid, process.start)
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::FileExt;

    use super::*;

    fn node(pid: i32) -> Known {
        let (name, uri) = ("/n".to_owned(), format!("{pid}/5"));
        Known { name, uri, pid: Some(pid), stayed: false, began: None }
    }

    /// What has become of nodes of one name in these processes, where it is in those now.
    fn become_of(before: &[i32], now: &[i32], has_left: bool) -> Vec<Found> {
        let roll: Vec<Known> = before.iter().copied().map(node).collect();
        let processes = now.iter().map(|pid| (node(*pid).uri, node(*pid))).collect();
        let alive = Alive::from([("/n".to_owned(), processes)]);
        roll.iter().map(|known| found(known, &roll, &alive, has_left)).collect()
    }

    #[test]
    fn of_two_processes_of_one_name_each_is_itself() {
        use Found::{Another, Same, Unreachable, Unregistered};
        assert_eq!(become_of(&[7, 8], &[7, 8], false), [Same, Same]);
        assert_eq!(become_of(&[7, 8], &[7], false), [Same, Unreachable]);
        assert_eq!(become_of(&[7, 8], &[8], true), [Unregistered, Same]);
        assert_eq!(become_of(&[7, 8], &[8, 9], true), [Another, Same]);
        assert_eq!(become_of(&[7], &[9], false), [Another]);
        assert_eq!(become_of(&[7], &[], true), [Unregistered]);
    }

    #[test]
    fn of_a_ledger_that_somebody_has_spoiled_nothing_is_known() {
        let ledger = Ledger::new().unwrap();
        let mut roll_of = [node(7), node(8)];
        assert_eq!(look(&ledger, &roll_of).unwrap(), [Found::Unregistered, Found::Unregistered]);
        let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
        let file = std::fs::File::options().write(true).open(path).unwrap();
        file.write_all_at(&[0xff; 1 << 16], 0).unwrap();
        assert!(look(&ledger, &roll_of).is_err());
        assert!(note_stayed(&ledger, &mut roll_of).is_err());
        assert!(roll(&ledger).is_err() && exits(&ledger).is_err());
    }
}
