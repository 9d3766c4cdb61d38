//! How the processes of a stack end, those too that are other processes' children.
//!
//! roslaunch and shells collect their own children and need not report how they ended. A pidfd
//! says at once when its process has ended, and until the parent has collected it
//! /proc/PID/stat says how. After that the pidfd does, since Linux 6.15; on an older kernel the end
//! is then known, and not its status.

use std::collections::{BTreeMap, BTreeSet};
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{EventfdFlags, PollFd, PollFlags, Timespec, eventfd, poll};
use rustix::process::{Pid, PidfdFlags, pidfd_open};

use crate::stack::exit_code::{of_collected, of_zombie};
use crate::stack::processes::{Ended, Spared, descendants, is_ending};

/// The pause between two looks for new processes, at first and later.
const FIRST_PAUSE: Duration = Duration::from_millis(10);
const LONGEST_PAUSE: Duration = Duration::from_millis(100);
/// Where there are many processes a look takes long; it may cost a fiftieth of a processor.
const REST: u32 = 50;
/// A look that takes long because the machine is busy must not blind us for long.
const LONGEST_REST: Duration = Duration::from_millis(500);

/// No process's numbers.
const ENOUGH: i32 = 0;
const MORE: i32 = -1;

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
    watcher: Watcher,
    enough: Arc<OwnedFd>,
    thread: JoinHandle<()>,
}

/// By which others show the witness a process that may end before its next look.
#[derive(Clone, Debug)]
pub struct Watcher {
    watched: Arc<Mutex<Watched>>,
    more: Arc<OwnedFd>,
}

impl Watcher {
    fn new() -> rustix::io::Result<Self> {
        Ok(Self { watched: Arc::default(), more: event()? })
    }

    /// Watches a process: once this returns its end will be noted, whenever it comes.
    pub fn watch(&self, pid: i32) {
        lock(&self.watched).watch(pid);
        // It can't fail but where the thread has not yet taken in that there is more.
        rustix::io::write(&*self.more, &1_u64.to_ne_bytes()).ok();
    }

    /// Whether a process is watched whose end was not noted yet.
    #[cfg(test)]
    pub fn watches(&self, pid: i32) -> bool {
        lock(&self.watched).alive.contains_key(&pid)
    }
}

impl Witness {
    /// Watches from now on; the `spared` processes and theirs do not count. None where the
    /// kernel refuses: ends are then known of our own children alone.
    pub fn start(spared: &Spared) -> Option<Self> {
        let (enough, watcher) = (event().ok()?, Watcher::new().ok()?);
        let watch =
            Watch { spared: spared.clone(), watcher: watcher.clone(), enough: Arc::clone(&enough) };
        let thread = std::thread::Builder::new().name("witness".to_owned());
        let thread = thread.spawn(move || watch.run()).ok()?;
        Some(Self { watcher, enough, thread })
    }

    /// What others show it processes by.
    pub fn watcher(&self) -> Watcher {
        self.watcher.clone()
    }

    /// Notes what has ended by now, also where the thread that watches got no processor.
    pub fn settle(&self) {
        let fds = lock(&self.watcher.watched).fds();
        let ended = ready(&fds, Instant::now());
        let at = Instant::now();
        lock(&self.watcher.watched).note(&ended, at);
    }

    /// Processes that end already, and take a while to.
    pub fn ending(&self) -> BTreeSet<i32> {
        let watched = lock(&self.watcher.watched);
        watched.alive.keys().copied().filter(|pid| is_ending(*pid)).collect()
    }

    /// All ends, once nothing is left that could end.
    pub fn finish(self) -> Vec<ProcessEnd> {
        // It can't fail: nobody else writes.
        rustix::io::write(&*self.enough, &1_u64.to_ne_bytes()).ok();
        self.thread.join().ok();
        std::mem::take(&mut lock(&self.watcher.watched).seen)
    }
}

/// What is known of processes, by whoever looks.
#[derive(Debug, Default)]
struct Watched {
    alive: BTreeMap<i32, (Arc<OwnedFd>, String)>,
    /// Reported already, since when, and maybe not yet collected by their parents.
    over: BTreeMap<i32, Instant>,
    seen: Vec<ProcessEnd>,
}

impl Watched {
    fn fds(&self) -> Vec<(i32, Arc<OwnedFd>)> {
        self.alive.iter().map(|(pid, (fd, _))| (*pid, Arc::clone(fd))).collect()
    }

    /// Takes in who is new of all that were there at a look that began at that time: who ended since was not in it for sure.
    fn add(&mut self, there: &BTreeSet<i32>, begun: Instant) {
        self.over.retain(|pid, at| there.contains(pid) || *at >= begun);
        there.iter().for_each(|pid| self.watch(*pid));
    }

    fn watch(&mut self, pid: i32) {
        if self.alive.contains_key(&pid) || self.over.contains_key(&pid) {
            return;
        }
        let Some(watched) = Pid::from_raw(pid) else { return };
        if let Ok(fd) = pidfd_open(watched, PidfdFlags::empty()) {
            self.alive.insert(pid, (Arc::new(fd), name_of(pid)));
        }
    }

    /// Those that ended, each once.
    fn note(&mut self, ended: &[i32], at: Instant) {
        for &pid in ended {
            // Before anything else: its parent collects it any moment.
            let stat = std::fs::read(format!("/proc/{pid}/stat")).unwrap_or_default();
            let Some((fd, name)) = self.alive.remove(&pid) else { continue };
            self.over.insert(pid, at);
            let ended = of_zombie(&String::from_utf8_lossy(&stat)).or_else(|| of_collected(&fd));
            self.seen.push(ProcessEnd { pid, name, ended, at });
        }
    }
}

struct Watch {
    spared: Spared,
    watcher: Watcher,
    enough: Arc<OwnedFd>,
}

impl Watch {
    fn run(&self) {
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
    fn look(&self) {
        let begun = Instant::now();
        let there = descendants(std::process::id(), &self.spared.pids());
        lock(&self.watcher.watched).add(&there, begun);
    }

    /// Notes what ends until a time, or until there is more to watch; `true` when it is enough.
    fn wait(&self, until: Instant) -> bool {
        let mut fds = lock(&self.watcher.watched).fds();
        fds.push((MORE, Arc::clone(&self.watcher.more)));
        fds.push((ENOUGH, Arc::clone(&self.enough)));
        let mut ready = ready(&fds, until);
        let at = Instant::now();
        let enough = ready.pop_if(|pid| *pid == ENOUGH).is_some();
        if ready.pop_if(|pid| *pid == MORE).is_some() {
            rustix::io::read(&*self.watcher.more, &mut [0; 8]).ok();
        }
        lock(&self.watcher.watched).note(&ready, at);
        enough
    }
}

fn event() -> rustix::io::Result<Arc<OwnedFd>> {
    eventfd(0, EventfdFlags::CLOEXEC | EventfdFlags::NONBLOCK).map(Arc::new)
}

fn lock(watched: &Mutex<Watched>) -> MutexGuard<'_, Watched> {
    watched.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Those whose file is readable, once one is or it is time.
fn ready(fds: &[(i32, Arc<OwnedFd>)], until: Instant) -> Vec<i32> {
    let left = until.saturating_duration_since(Instant::now());
    let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(left.subsec_nanos()) };
    let mut polled: Vec<_> = fds.iter().map(|(_, fd)| PollFd::new(fd, PollFlags::IN)).collect();
    if poll(&mut polled, Some(&timeout)).is_err() {
        return Vec::new();
    }
    let ready = fds.iter().zip(&polled).filter(|(_, fd)| !fd.revents().is_empty());
    ready.map(|((pid, _), _)| *pid).collect()
}

fn name_of(pid: i32) -> String {
    let name = std::fs::read(format!("/proc/{pid}/comm")).unwrap_or_default();
    String::from_utf8_lossy(&name).trim_end().to_owned()
}

#[cfg(test)]
mod tests {
    use std::process::Command;

    use super::*;

    #[test]
    fn what_ended_is_noted_at_once_where_the_thread_that_watches_gets_no_processor() {
        let mut child = Command::new("/bin/sh").args(["-c", "exit 3"]).spawn().unwrap();
        let pid = i32::try_from(child.id()).unwrap();
        let watcher = Watcher::new().unwrap();
        watcher.watch(pid);
        let fds = lock(&watcher.watched).fds();
        while ready(&fds, Instant::now() + LONGEST_REST).is_empty() {}
        let thread = std::thread::spawn(|| ());
        let witness = Witness { watcher, enough: event().unwrap(), thread };
        let before = Instant::now();
        witness.settle();
        witness.settle();
        let after = Instant::now();
        let ends = witness.finish();
        child.wait().unwrap();
        assert_eq!(ends.len(), 1);
        assert_eq!(ends[0].ended, Some(Ended { exit_status: Some(3), signal: None }));
        assert!((before..=after).contains(&ends[0].at));
    }

    #[test]
    fn who_ended_while_a_look_was_taken_is_noted_once() {
        let mut child = Command::new("/bin/true").spawn().unwrap();
        let pid = i32::try_from(child.id()).unwrap();
        let mut watched = Watched::default();
        let begun = Instant::now();
        watched.watch(pid);
        while ready(&watched.fds(), Instant::now() + LONGEST_REST).is_empty() {}
        watched.note(&[pid], Instant::now());
        // It had begun before the process was there, and the next one finds what nobody has collected.
        watched.add(&BTreeSet::new(), begun);
        watched.add(&BTreeSet::from([pid]), Instant::now());
        assert!(watched.alive.is_empty());
        child.wait().unwrap();
        watched.add(&BTreeSet::new(), Instant::now());
        assert!(watched.over.is_empty());
    }

    #[test]
    fn who_is_shown_is_noted_though_no_look_has_found_it() {
        let mut child = Command::new("/bin/sh")
            .args(["-c", "read line; exit 3"])
            .stdin(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // No look finds who is spared.
        let spared = Spared::default();
        spared.add(Pid::from_child(&child));
        let witness = Witness::start(&spared).unwrap();
        witness.watcher().watch(i32::try_from(child.id()).unwrap());
        drop(child.stdin.take());
        let deadline = Instant::now() + Duration::from_secs(60);
        while lock(&witness.watcher.watched).seen.is_empty() {
            assert!(Instant::now() < deadline, "its end was not noted");
            std::thread::sleep(Duration::from_millis(1));
        }
        let ends = witness.finish();
        child.wait().unwrap();
        assert_eq!(ends.len(), 1);
        assert_eq!(ends[0].ended, Some(Ended { exit_status: Some(3), signal: None }));
    }
}
