//! Every process below this one: found, reaped, ended.
//!
//! The slot's process is a child subreaper: whatever a stack starts, daemons too, becomes
//! its child at the latest when its own parent dies. So nothing can hide from it, and "no
//! child left" means that nothing is left.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use rustix::event::{Timespec, poll};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitOptions, kill_process, kill_process_group, wait};

/// How a process ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ended {
    pub exit_status: Option<i32>,
    pub signal: Option<i32>,
}

impl std::fmt::Display for Ended {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match (self.exit_status, self.signal) {
            (Some(status), _) => write!(formatter, "exit status {status}"),
            (None, Some(signal)) => write!(formatter, "signal {signal}"),
            (None, None) => write!(formatter, "an unknown status"),
        }
    }
}

/// Processes below this one that are none of the stack's, such as a master; its copies are one list.
#[derive(Debug, Clone, Default)]
pub struct Spared(Arc<Mutex<Vec<Pid>>>);

impl Spared {
    pub fn add(&self, pid: Pid) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(pid);
    }

    pub fn pids(&self) -> Vec<Pid> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// How often a process that should end is looked at.
const GLANCE: Duration = Duration::from_millis(10);
/// A process that outlives SIGKILL so long is stuck in the kernel.
const KILL_PATIENCE: Duration = Duration::from_secs(10);

/// The children whose end somebody will ask for.
#[derive(Debug, Default)]
pub struct Children {
    watched: BTreeMap<i32, Option<Ended>>,
    /// How each ended that was collected here: our own, and those whose parents were gone.
    collected: BTreeMap<i32, Ended>,
}

impl Children {
    pub fn watch(&mut self, pid: Pid) {
        self.watched.insert(pid.as_raw_nonzero().get(), None);
    }

    pub fn forget_all(&mut self) {
        self.watched.clear();
        self.collected.clear();
    }

    /// How any process ended that was collected here.
    pub fn collected(&self, pid: i32) -> Option<Ended> {
        self.collected.get(&pid).copied()
    }

    /// How the watched child ended, if it has.
    pub fn ended(&mut self, pid: Pid) -> Option<Ended> {
        self.reap();
        self.watched.get(&pid.as_raw_nonzero().get()).copied().flatten()
    }

    /// Collects every child that ended; `false` when there is no child at all.
    pub fn reap(&mut self) -> bool {
        loop {
            match wait(WaitOptions::NOHANG) {
                Ok(Some((pid, status))) => {
                    let (exit_status, signal) = (status.exit_status(), status.terminating_signal());
                    let ended = Ended { exit_status, signal };
                    let pid = pid.as_raw_nonzero().get();
                    self.collected.insert(pid, ended);
                    if let Some(watched) = self.watched.get_mut(&pid) {
                        *watched = Some(ended);
                    }
                }
                Ok(None) => return true,
                Err(Errno::INTR) => {}
                Err(_) => return false,
            }
        }
    }

    /// Asks the group and then every descendant to end, and at the end of `patience` ends
    /// them; `spared` and what it started are left alone. Returns the number that had to be
    /// killed, or an error when something outlived even that.
    pub fn stop(
        &mut self,
        group: Option<Pid>,
        spared: &[Pid],
        patience: Duration,
    ) -> Result<usize, String> {
        let begun = Instant::now();
        let mut asked_all = false;
        if let Some(group) = group {
            // ROS nodes shut down in order on SIGINT.
            signal_group(group, Signal::INT);
        }
        loop {
            self.reap();
            let left = descendants(std::process::id(), spared);
            if left.is_empty() {
                return Ok(0);
            }
            if begun.elapsed() >= patience {
                return self.kill(spared);
            }
            // Only daemons left their group; they get no SIGINT, so theirs comes at once
            // when the group is gone, and for all at half time.
            let group_gone = group.is_none_or(|group| !left.contains(&group_number(group)));
            if !asked_all && (begun.elapsed() >= patience / 2 || group_gone) {
                asked_all = true;
                for pid in &left {
                    signal(*pid, Signal::TERM);
                }
            }
            pause(GLANCE);
        }
    }

    /// Kills every descendant but `spared` until none is left.
    pub fn kill(&mut self, spared: &[Pid]) -> Result<usize, String> {
        let begun = Instant::now();
        let mut killed = BTreeSet::new();
        loop {
            self.reap();
            let left = descendants(std::process::id(), spared);
            if left.is_empty() {
                return Ok(killed.len());
            }
            if begun.elapsed() > KILL_PATIENCE {
                return Err(format!("processes {left:?} outlived SIGKILL by {KILL_PATIENCE:?}"));
            }
            for pid in left {
                signal(pid, Signal::KILL);
                killed.insert(pid);
            }
            pause(Duration::from_millis(2));
        }
    }
}

/// Waits; a signal ends it early.
pub fn pause(time: Duration) {
    let time = Timespec {
        tv_sec: i64::try_from(time.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(time.subsec_nanos()),
    };
    // The only error is EINTR, which is as good as the end of the wait.
    poll(&mut [], Some(&time)).ok();
}

fn group_number(group: Pid) -> i32 {
    group.as_raw_nonzero().get()
}

fn signal_group(group: Pid, signal: Signal) {
    // It may have ended a moment ago.
    kill_process_group(group, signal).ok();
}

/// Signals a process that may have ended a moment ago.
pub fn signal(pid: i32, signal: Signal) {
    if let Some(pid) = Pid::from_raw(pid) {
        kill_process(pid, signal).ok();
    }
}

/// Whether a process runs, and is no zombie: a thread of it does, which need not be its first.
pub fn is_alive(pid: i32) -> bool {
    let runs = |thread: PathBuf| {
        let stat = std::fs::read(thread.join("stat")).unwrap_or_default();
        let text = String::from_utf8_lossy(&stat);
        let state = text.rsplit(')').next().and_then(|after| after.split_whitespace().next());
        state.is_some_and(|state| !matches!(state, "Z" | "X"))
    };
    threads(pid).any(runs)
}

/// The folder of each thread in /proc.
fn threads(pid: i32) -> impl Iterator<Item = PathBuf> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    threads.map(|thread| thread.path())
}

/// Whether a process ends already, however it is asked to: the kernel writes its core, which SIGKILL
/// alone ends sooner, or its threads go one after another, and its memory.
pub fn is_ending(pid: i32) -> bool {
    let mut threads = threads(pid).peekable();
    let ends = |thread: PathBuf| {
        let read = |file: &str| std::fs::read(thread.join(file)).unwrap_or_default();
        let text = |file: &str| String::from_utf8_lossy(&read(file)).into_owned();
        says_ending(&text("stat"), &text("status"))
    };
    threads.peek().is_some() && threads.all(ends)
}

/// Reads a thread's stat and status (proc(5)); the flags of the ninth field are those of
/// include/linux/sched.h. One that has gone meanwhile has none.
fn says_ending(stat: &str, status: &str) -> bool {
    const EXITING: u32 = 0x4;
    // A signal ends it.
    const SIGNALED: u32 = 0x400;
    // SIGKILL, which each other thread gets where one ends the process.
    const KILLED: u64 = 1 << 8;
    let of = |name: &str| status.lines().find_map(|line| line.strip_prefix(name)).map(str::trim);
    let fields = stat.rsplit_once(')').map_or("", |(_, fields)| fields);
    let flags = fields.split_whitespace().nth(6).and_then(|flags| flags.parse::<u32>().ok());
    let pending = of("SigPnd:").and_then(|set| u64::from_str_radix(set, 16).ok());
    flags.is_none_or(|flags| flags & (EXITING | SIGNALED) != 0)
        || of("CoreDumping:") == Some("1")
        || pending.is_some_and(|set| set & KILLED != 0)
}

/// Which process below this one has a socket of this number: of several the newest.
pub fn holder(socket: u32) -> Option<i32> {
    let wanted = format!("socket:[{socket}]");
    let has = |pid: &i32| {
        let files = std::fs::read_dir(format!("/proc/{pid}/fd")).into_iter().flatten().flatten();
        let mut targets = files.filter_map(|file| std::fs::read_link(file.path()).ok());
        targets.any(|target| target.as_os_str() == wanted.as_str())
    };
    descendants(std::process::id(), &[]).into_iter().rev().find(has)
}

/// Every process below `root`, without `spared` and what is below those.
pub fn descendants(root: u32, spared: &[Pid]) -> BTreeSet<i32> {
    let spared = spared.iter().map(|pid| group_number(*pid)).collect();
    bagpipe_replay::descendants(root, &spared)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_that_ends_already_is_seen() {
        let stat = |flags: u32| format!("7 (a) S) R 1 7 7 0 -1 {flags} 8423 0");
        let living = "Name:\tCoreDumping:\t1\nCoreDumping:\t0\nSigPnd:\t0000000000004000\n";
        // A core is written; then the memory goes, as it does after exit().
        for flags in [0x40_0600, 0x44_060c, 0x40_000c] {
            assert!(says_ending(&stat(flags), living), "{flags:x}");
        }
        assert!(!says_ending(&stat(0x40_0000), living));
        assert!(says_ending(&stat(0x40_0000), "Name:\ta\nCoreDumping:\t1\n"));
        // Another thread ends the process, and this one got no processor yet.
        assert!(says_ending(&stat(0x40_0000), "SigPnd:\t0000000000004100\n"));
        assert!(says_ending("", ""));
        assert!(!is_ending(i32::try_from(std::process::id()).unwrap()));
        assert!(!is_ending(i32::MAX));
    }

    #[test]
    fn a_process_whose_first_thread_alone_has_ended_goes_on() {
        // exit_thread(2), as by pthread_exit() in main().
        let program = "import ctypes, os, threading, time
threading.Thread(target=time.sleep, args=(60,)).start()
ctypes.CDLL(None).syscall({'x86_64': 60, 'aarch64': 93}[os.uname().machine], 0)";
        let mut child =
            std::process::Command::new("/usr/bin/python3").args(["-c", program]).spawn().unwrap();
        let pid = i32::try_from(child.id()).unwrap();
        let deadline = Instant::now() + Duration::from_secs(20);
        let has_ended = || {
            let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
            stat.rsplit_once(')').unwrap().1.starts_with(" Z")
        };
        while !has_ended() && Instant::now() < deadline {
            pause(Duration::from_millis(5));
        }
        assert!(has_ended(), "its first thread has not ended");
        assert!(is_alive(pid) && !is_ending(pid));
        child.kill().unwrap();
        child.wait().unwrap();
        assert!(!is_alive(pid) && !is_ending(pid));
    }
}
