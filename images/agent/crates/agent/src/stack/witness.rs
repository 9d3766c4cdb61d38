//! How the processes of a stack end, those too that are other processes' children.
//!
//! roslaunch and shells collect their own children and need not report how they ended. A pidfd
//! says at once when its process has ended, and until the parent has collected it
//! /proc/PID/stat says how. Where the parent is faster the end is known, and not its status.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::stack::processes::{Ended, Spared, descendants};

/// The pause between two looks for new processes, at first and later.
const FIRST_PAUSE: Duration = Duration::from_millis(10);
const LONGEST_PAUSE: Duration = Duration::from_millis(100);
/// Where there are many processes a look takes long; it may cost a fiftieth of a processor.
const REST: u32 = 50;
/// A look that takes long because the machine is busy must not blind us for long.
const LONGEST_REST: Duration = Duration::from_millis(500);

/// The end of a process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProcessEnd {
    pub pid: i32,
    pub name: String,
    /// None if its parent was faster than we.
    pub ended: Option<Ended>,
    pub at: Instant,
}

/// Watches everything below this process.
#[derive(Debug)]
pub struct Witness {
    seen: Arc<Mutex<Vec<ProcessEnd>>>,
    enough: Arc<OwnedFd>,
    thread: JoinHandle<()>,
}

impl Witness {
    /// Watches from now on; the `spared` processes and theirs do not count. None where the
    /// kernel refuses: ends are then known of our own children alone.
    pub fn start(spared: &Spared) -> Option<Self> {
        let enough = Arc::new(eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).ok()?);
        let seen = Arc::default();
        let mut watch = Watch {
            spared: spared.clone(),
            alive: BTreeMap::new(),
            over: BTreeSet::new(),
            seen: Arc::clone(&seen),
            enough: Arc::clone(&enough),
        };
        let thread = std::thread::Builder::new().name("witness".to_owned());
        let thread = thread.spawn(move || watch.run()).ok()?;
        Some(Self { seen, enough, thread })
    }

    /// All ends, once nothing is left that could end.
    pub fn finish(self) -> Vec<ProcessEnd> {
        // It can't fail: nobody else writes.
        rustix::io::write(&*self.enough, &1_u64.to_ne_bytes()).ok();
        self.thread.join().ok();
        std::mem::take(&mut *self.seen.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

struct Watch {
    spared: Spared,
    alive: BTreeMap<i32, (OwnedFd, String)>,
    /// Reported already, and maybe not yet collected by their parents.
    over: BTreeSet<i32>,
    seen: Arc<Mutex<Vec<ProcessEnd>>>,
    enough: Arc<OwnedFd>,
}

impl Watch {
    fn run(&mut self) {
        let mut pause = FIRST_PAUSE;
        loop {
            let begun = Instant::now();
            self.look();
            let rest = pause.max((begun.elapsed() * REST).min(LONGEST_REST));
            pause = (pause * 2).min(LONGEST_PAUSE);
            let until = Instant::now() + rest;
            while Instant::now() < until {
                if self.wait(until) {
                    self.wait(Instant::now());
                    return;
                }
            }
        }
    }

    /// Begins to watch what is new.
    fn look(&mut self) {
        let there = descendants(std::process::id(), &self.spared.pids());
        self.over.retain(|pid| there.contains(pid));
        for pid in there {
            if self.alive.contains_key(&pid) || self.over.contains(&pid) {
                continue;
            }
            let Some(watched) = Pid::from_raw(pid) else { continue };
            if let Ok(fd) = pidfd_open(watched, PidfdFlags::empty()) {
                self.alive.insert(pid, (fd, name_of(pid)));
            }
        }
    }

    /// Notes what ends until a time; `true` when it is enough.
    fn wait(&mut self, until: Instant) -> bool {
        let left = until.saturating_duration_since(Instant::now());
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(left.subsec_nanos()) };
        let mut fds = vec![PollFd::new(&*self.enough, PollFlags::IN)];
        fds.extend(self.alive.values().map(|(fd, _)| PollFd::new(fd, PollFlags::IN)));
        if poll(&mut fds, Some(&timeout)).is_err() {
            return false;
        }
        let at = Instant::now();
        let is_ready = |fd: &PollFd<'_>| !fd.revents().is_empty();
        let enough = is_ready(&fds[0]);
        let ended = self.alive.keys().zip(&fds[1..]).filter(|(_, fd)| is_ready(fd));
        let ended: Vec<i32> = ended.map(|(pid, _)| *pid).collect();
        drop(fds);
        for pid in ended {
            // Before anything else: its parent collects it any moment.
            let stat = std::fs::read(format!("/proc/{pid}/stat")).unwrap_or_default();
            let Some((_, name)) = self.alive.remove(&pid) else { continue };
            self.over.insert(pid);
            let ended = exit_code(&String::from_utf8_lossy(&stat));
            let end = ProcessEnd { pid, name, ended, at };
            self.seen.lock().unwrap_or_else(PoisonError::into_inner).push(end);
        }
        enough
    }
}

fn name_of(pid: i32) -> String {
    let name = std::fs::read_to_string(format!("/proc/{pid}/comm")).unwrap_or_default();
    name.trim_end().to_owned()
}

/// How a zombie ended, by its line of /proc/PID/stat (proc(5), fields 3 and 52).
fn exit_code(stat: &str) -> Option<Ended> {
    // The command's name stands in parentheses and may hold anything.
    let mut fields = stat.rsplit(')').next()?.split_whitespace();
    if !matches!(fields.next()?, "Z" | "X") {
        return None;
    }
    let code: i32 = fields.nth(48)?.parse().ok()?;
    let signal = code & 0x7f;
    Some(match signal {
        0 => Ended { exit_status: Some((code >> 8) & 0xff), signal: None },
        _ => Ended { exit_status: None, signal: Some(signal) },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_zombies_line_says_how_it_ended() {
        let line = |state: &str, code: i32| {
            let between = vec!["0"; 48].join(" ");
            format!("7 (a) b) {state} {between} {code}")
        };
        let ended = |exit_status, signal| Some(Ended { exit_status, signal });
        assert_eq!(exit_code(&line("Z", 3 << 8)), ended(Some(3), None));
        assert_eq!(exit_code(&line("Z", 0x80 | 11)), ended(None, Some(11)));
        assert_eq!(exit_code(&line("Z", 0)), ended(Some(0), None));
        assert_eq!(exit_code(&line("S", 0)), None);
        assert_eq!(exit_code(""), None);
    }
}
