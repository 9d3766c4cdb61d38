//! The nodes' processes, seen through /proc: do they still work, and has a thread gone back
//! to its socket? Where /proc says nothing, nothing is known, and silence has to do.

mod rest;
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
pub(crate) use starting::Starting;
pub use tree::descendants;
pub(crate) use tree::{ProcessLine, below, processes};
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
    /// Looks at what the nodes do before they are told anything, and while they are not asked:
    /// an answer is work.
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

    /// What has gone on since the last look, and whether something was `heard` since.
    pub(crate) fn rest(&mut self, heard: bool) -> Rest {
        let now = look(&self.pids, self.born);
        self.watch.look(now, heard)
    }
}

/// Whether a thread of a process waits for bytes of a socket; `None` if that can't be seen.
pub(crate) fn waits_at(pid: i32, inode: u32) -> Option<bool> {
    let descriptor = descriptor(pid, inode)?;
    let all: Vec<Waits> = tasks(pid).into_iter().filter_map(waits).collect();
    (!all.is_empty()).then(|| all.contains(&Waits::Bytes(descriptor)))
}

/// By which number a process knows a socket.
fn descriptor(pid: i32, inode: u32) -> Option<u64> {
    let wanted = format!("socket:[{inode}]");
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd")).ok()?;
    entries.flatten().find_map(|entry| {
        let target = std::fs::read_link(entry.path()).ok()?;
        let number = || entry.file_name().to_str()?.parse().ok();
        (target.to_str() == Some(&wanted)).then(number).flatten()
    })
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
    threads::waits(&std::fs::read_to_string(task.join("syscall")).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net::{TcpListener, TcpStream};
    use std::sync::mpsc::channel;

    fn ourselves() -> i32 {
        i32::try_from(std::process::id()).unwrap()
    }

    #[test]
    fn a_thread_that_has_gone_back_to_its_socket_is_seen_there() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let mut near = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let (mut far, _) = listener.accept().unwrap();
        let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&far));
        let name = std::fs::read_link(name).unwrap().to_str().unwrap().to_owned();
        let inode: u32 = name.trim_start_matches("socket:[").trim_end_matches(']').parse().unwrap();
        if waits_at(ourselves(), inode).is_none() {
            eprintln!("skipped: this kernel does not show system calls");
            return;
        }
        assert_eq!(waits_at(ourselves(), inode), Some(false));
        let (go, wait) = channel::<()>();
        let reader = std::thread::spawn(move || {
            far.read_exact(&mut [0; 1]).unwrap();
            wait.recv().unwrap_err();
            far.read_exact(&mut [0; 1]).unwrap();
        });
        let until = |expected: bool| {
            let begun = Instant::now();
            while waits_at(ourselves(), inode) != Some(expected) {
                assert!(begun.elapsed() < Duration::from_secs(60));
                std::thread::yield_now();
            }
        };
        until(true);
        // It has taken the byte and works on it: on its own wait, it is not at the socket.
        near.write_all(&[1]).unwrap();
        until(false);
        drop(go);
        until(true);
        near.write_all(&[1]).unwrap();
        reader.join().unwrap();
        assert_eq!(waits_at(ourselves(), 0), None);
        assert_eq!(waits_at(0, inode), None);
    }
}
