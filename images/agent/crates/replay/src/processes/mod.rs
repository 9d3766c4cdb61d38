//! The nodes' processes, seen through /proc: do they still work, and has a thread gone back
//! to its socket? Where /proc says nothing, nothing is known, and silence has to do.

mod rest;
mod sockets;
mod starting;
mod threads;
mod tree;
mod waiting;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rest::{Look, RESTING, Watch};
use threads::{Demand, Waits};

pub(crate) use rest::Rest;
pub(crate) use sockets::Sockets;
pub(crate) use starting::Starting;
pub use tree::descendants;
pub(crate) use tree::{ProcessLine, below, leaves, processes};
pub(crate) use waiting::Waiting;

/// The least time between the two looks that say what is usual, and the most, where
/// somebody is not at rest.
const FIRST_LOOKS: Duration = Duration::from_millis(20);
const LATER_LOOK: Duration = Duration::from_millis(200);

/// The processes of the nodes.
pub(crate) struct Processes {
    pids: BTreeSet<i32>,
    born: Instant,
    watch: Watch,
}

impl Processes {
    /// Looks at what the nodes do before anything is published, and while no statistics are asked
    /// of them: an answer to that is work.
    pub(crate) fn meet(pids: BTreeSet<i32>) -> Processes {
        let born = Instant::now();
        let first = look(&pids, born);
        let mut second = first.clone();
        for wait in [FIRST_LOOKS, LATER_LOOK] {
            if first.threads.is_empty() {
                break;
            }
            std::thread::sleep(wait.saturating_sub(born.elapsed()));
            second = look(&pids, born);
            if second.wanted_since(&first).values().all(|part| *part < RESTING) {
                break;
            }
        }
        Processes { pids, born, watch: Watch::new(&first, second) }
    }

    /// Stillness can begin now.
    pub(crate) fn begin(&mut self) {
        let now = look(&self.pids, self.born);
        self.watch.begin(now);
    }

    /// Whether the nodes rest, by their work since the last look and whether something was
    /// `received` since.
    pub(crate) fn rest(&mut self, received: bool) -> Rest {
        let now = look(&self.pids, self.born);
        self.watch.look(now, received)
    }
}

fn look(pids: &BTreeSet<i32>, born: Instant) -> Look {
    let mut found = BTreeMap::new();
    for &pid in pids {
        for task in tasks(pid) {
            let number = task.file_name().and_then(|name| name.to_str()?.parse().ok());
            if let (Some(number), Some(demand)) = (number, demand(&task)) {
                found.insert((pid, number), (demand, waits(task).unwrap_or(Waits::Else)));
            }
        }
    }
    Look { at: born.elapsed(), threads: found }
}

fn tasks(pid: i32) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten();
    entries.flatten().map(|entry| entry.path()).collect()
}

fn demand(task: &std::path::Path) -> Option<Demand> {
    threads::demand(&std::fs::read_to_string(task.join("schedstat")).ok()?)
}

fn waits(task: PathBuf) -> Option<Waits> {
    // Of another user's process it can't be read, and the state can.
    let syscall = std::fs::read_to_string(task.join("syscall")).unwrap_or_default();
    // A thread's name may be no text: the kernel cuts it within a letter.
    let stat = std::fs::read(task.join("stat")).unwrap_or_default();
    threads::waits(&syscall, &String::from_utf8_lossy(&stat))
}

#[cfg(test)]
mod tests {
    use std::process::{Command, Stdio};

    use super::*;

    /// Waits for its child as vfork(2) does, which is uninterruptible, until its input ends.
    const UNINTERRUPTIBLE: &str = r#"
import ctypes, os, platform, sys
libc = ctypes.CDLL(None)
libc.prctl(15, b"\xfcber", 0, 0, 0)
clone = {"x86_64": 56}.get(platform.machine(), 220)
if libc.syscall(clone, 0x4000 | 17, 0, 0, 0, 0) == 0:
    sys.stdin.read()
    os._exit(0)
"#;

    #[test]
    fn a_thread_that_waits_for_a_disk_is_seen_also_where_its_name_is_no_text() {
        let mut python = Command::new("/usr/bin/python3");
        python.args(["-c", UNINTERRUPTIBLE]).stdin(Stdio::piped());
        let mut process = python.spawn().unwrap();
        let pids = BTreeSet::from([i32::try_from(process.id()).unwrap()]);
        let born = Instant::now();
        let seen = || look(&pids, born).threads.values().any(|(_, waits)| *waits == Waits::Disk);
        let mut found = seen();
        while !found && born.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(10));
            found = seen();
        }
        drop(process.stdin.take());
        process.wait().unwrap();
        assert!(found);
    }
}
