//! Measuring the machine: a thread that wants to wake every 10 ms and says how late it was,
//! and the kernel's counters, once a second.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::Machine;
use super::busy::{Slice, busy};
use super::kernel;
use crate::processes::{ProcessLine, below, processes};

/// How often the thread wants to wake.
const TICK: Duration = Duration::from_millis(10);
/// How long a slice lasts, and the least that is one of its own.
const SLICE: Duration = Duration::from_secs(1);
const LEAST: f64 = 0.25;
/// The kernel's clock tick; Linux shows all times in hundredths of a second (time(7)).
const TICKS: f64 = 100.0;

/// A measurement that goes on.
pub(crate) struct Gauge {
    enough: Sender<()>,
    thread: Option<JoinHandle<Vec<Slice>>>,
    before: Counters,
    places: Arc<Places>,
}

/// Processes of the stack, beside what is below this process: nodes that somebody else started.
pub(crate) type Foreign = Arc<Mutex<BTreeSet<i32>>>;

/// The kernel's counters at a moment, in seconds.
#[derive(Clone, Copy, Debug)]
struct Counters {
    at: Instant,
    processors: f64,
    pressure: Option<f64>,
    throttled: Option<f64>,
    steal: Option<f64>,
    used: Option<f64>,
    cgroup: Option<f64>,
    stack: f64,
    own: f64,
}

impl Gauge {
    /// Begins to measure.
    pub(crate) fn start(foreign: &Foreign) -> Gauge {
        let places = Arc::new(Places::find(foreign));
        let before = places.read();
        let (enough, asked) = channel();
        let thread = std::thread::Builder::new().name("machine".to_owned()).spawn({
            let places = Arc::clone(&places);
            move || {
                let mut slices = Vec::new();
                let (mut begun, mut stall) = (before, 0.0);
                loop {
                    let woken = Instant::now() + TICK;
                    let answer = asked.recv_timeout(TICK);
                    stall = f64::max(stall, woken.elapsed().as_secs_f64());
                    let over = answer != Err(RecvTimeoutError::Timeout);
                    if over || begun.at.elapsed() >= SLICE {
                        let now = places.read();
                        slices.push(slice(&begun, &now, stall));
                        (begun, stall) = (now, 0.0);
                    }
                    if over {
                        return slices;
                    }
                }
            }
        });
        Gauge { enough, thread: thread.ok(), before, places }
    }

    /// Ends the measurement; `late` is the player's lateness in seconds.
    pub(crate) fn finish(self, late: f64) -> Machine {
        drop(self.enough);
        let slices = self.thread.and_then(|thread| thread.join().ok()).unwrap_or_default();
        let slices = merged(slices);
        let all = slice(&self.before, &self.places.read(), 0.0);
        let (busy, message) = busy(&slices);
        Machine {
            late_max_seconds: late,
            stall_max_seconds: slices.iter().map(|slice| slice.stall).fold(0.0, f64::max),
            cpu_pressure_seconds: all.pressure,
            throttled_seconds: all.throttled,
            steal_seconds: all.steal,
            busy,
            message,
        }
    }
}

/// What happened between two readings.
fn slice(before: &Counters, now: &Counters, stall: f64) -> Slice {
    let grown = |before: Option<f64>, now: Option<f64>| Some((now? - before?).max(0.0));
    let stack = (now.stack - before.stack).max(0.0);
    let own = (now.own - before.own).max(0.0);
    let used = grown(before.used, now.used);
    Slice {
        seconds: now.at.saturating_duration_since(before.at).as_secs_f64(),
        processors: now.processors,
        stall,
        pressure: grown(before.pressure, now.pressure),
        throttled: grown(before.throttled, now.throttled),
        steal: grown(before.steal, now.steal),
        stack,
        others: used.map(|used| (used - stack - own).max(0.0)),
        used,
        cgroup: grown(before.cgroup, now.cgroup),
    }
}

/// Joins a last slice that is too short for shares with the one before it.
fn merged(mut slices: Vec<Slice>) -> Vec<Slice> {
    if let [.., before, last] = &mut slices[..]
        && last.seconds < LEAST
    {
        let sum = |a: Option<f64>, b: Option<f64>| Some(a? + b?);
        *before = Slice {
            seconds: before.seconds + last.seconds,
            processors: before.processors,
            stall: before.stall.max(last.stall),
            pressure: sum(before.pressure, last.pressure),
            throttled: sum(before.throttled, last.throttled),
            steal: sum(before.steal, last.steal),
            stack: before.stack + last.stack,
            others: sum(before.others, last.others),
            used: sum(before.used, last.used),
            cgroup: sum(before.cgroup, last.cgroup),
        };
        slices.pop();
    }
    slices
}

/// Where this machine has its counters.
struct Places {
    pressure: Option<PathBuf>,
    limits: Option<PathBuf>,
    usage: Option<PathBuf>,
    allowed: BTreeSet<u64>,
    foreign: Foreign,
}

impl Places {
    fn find(foreign: &Foreign) -> Places {
        let cgroup = text(Path::new("/proc/self/cgroup"));
        let folders = kernel::cgroup_folders(&cgroup);
        let within = |name: &str| {
            let paths = folders.iter().map(|folder| format!("/sys/fs/cgroup{folder}/{name}"));
            paths.map(PathBuf::from).collect::<Vec<_>>()
        };
        let mut pressures = within("cpu.pressure");
        pressures.push(PathBuf::from("/proc/pressure/cpu"));
        let has_pressure = |path: &PathBuf| kernel::pressure(&text(path)).is_some();
        let limits = |path: &PathBuf| kernel::throttled(&text(path)).is_some();
        let usage = |path: &PathBuf| cgroup_use(path).is_some();
        let mut usages = within("cpuacct.usage");
        usages.extend(within("cpu.stat"));
        Places {
            pressure: pressures.into_iter().find(has_pressure),
            limits: within("cpu.stat").into_iter().find(limits),
            usage: usages.into_iter().find(usage),
            allowed: kernel::allowed(&text(Path::new("/proc/self/status"))),
            foreign: Arc::clone(foreign),
        }
    }

    fn read(&self) -> Counters {
        let stat = kernel::processors(&text(Path::new("/proc/stat")), &self.allowed);
        let (own, stack) = self.shares();
        let of = |path: &Option<PathBuf>, read: fn(&str) -> Option<f64>| {
            path.as_deref().map(text).and_then(|text| read(&text))
        };
        Counters {
            at: Instant::now(),
            processors: stat.map_or(1.0, |stat| stat.number as f64),
            pressure: of(&self.pressure, kernel::pressure),
            throttled: of(&self.limits, kernel::throttled),
            steal: stat.map(|stat| stat.steal as f64 / TICKS),
            used: stat.map(|stat| stat.used as f64 / TICKS),
            cgroup: self.usage.as_deref().and_then(cgroup_use),
            own,
            stack,
        }
    }

    /// The processor time of this process, and of the stack's.
    fn shares(&self) -> (f64, f64) {
        let ourselves = i32::try_from(std::process::id()).unwrap_or_default();
        let foreign = self.foreign.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let (own, stack) = shares(&processes(), ourselves, &foreign);
        (own as f64 / TICKS, stack as f64 / TICKS)
    }
}

/// Ticks of a process, and of all that it started or that is foreign, ended ones too.
fn shares(
    processes: &BTreeMap<i32, ProcessLine>,
    ourselves: i32,
    foreign: &BTreeSet<i32>,
) -> (u64, u64) {
    let mine = processes.get(&ourselves).copied().unwrap_or_default();
    let roots: Vec<i32> = foreign.iter().copied().chain([ourselves]).collect();
    let mut theirs = below(processes, &roots, &BTreeSet::new());
    theirs.extend(foreign);
    theirs.remove(&ourselves);
    let lines = theirs.iter().filter_map(|pid| processes.get(pid));
    let stack = mine.reaped + lines.map(|line| line.ticks + line.reaped).sum::<u64>();
    (mine.ticks, stack)
}

/// What a cgroup has used, in seconds: `cpuacct.usage` or a version 2 cpu.stat.
fn cgroup_use(path: &Path) -> Option<f64> {
    let text = text(path);
    let nanoseconds = text.trim().parse::<u64>().ok().map(|ns| ns as f64 / 1e9);
    nanoseconds.or_else(|| kernel::usage(&text))
}

/// A file's text; empty if there is none, or if it is gone a moment later.
fn text(path: &Path) -> String {
    let bytes = std::fs::read(path).unwrap_or_default();
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_stack_is_what_is_below_us_ended_or_not_and_what_is_named() {
        let line = |parent, ticks, reaped| ProcessLine { parent, ticks, reaped };
        let processes = BTreeMap::from([
            (1, line(0, 1_000, 9_000)),
            (10, line(1, 7, 100)),
            (11, line(10, 20, 3)),
            (12, line(11, 40, 0)),
            (13, line(1, 500, 0)),
            (14, line(13, 600, 60)),
        ]);
        assert_eq!(shares(&processes, 10, &BTreeSet::new()), (7, 163));
        assert_eq!(shares(&processes, 10, &BTreeSet::from([14])), (7, 823));
        // A node that is below us and named counts once; one that is gone, not at all.
        assert_eq!(shares(&processes, 10, &BTreeSet::from([12, 99])), (7, 163));
    }

    #[test]
    fn a_last_slice_that_is_short_is_judged_with_the_one_before() {
        let long =
            Slice { seconds: 1.0, stack: 0.5, stall: 0.01, others: Some(0.2), ..Slice::default() };
        let short =
            Slice { seconds: 0.1, stack: 0.1, stall: 0.02, others: Some(0.1), ..Slice::default() };
        let joined = merged(vec![long, long, short]);
        assert_eq!(joined.len(), 2);
        assert_eq!((joined[1].seconds, joined[1].stall), (1.1, 0.02));
        assert_eq!((joined[1].stack, joined[1].pressure), (0.6, None));
        assert_eq!(merged(vec![short]), [short]);
        assert_eq!(merged(vec![long, long]).len(), 2);
    }

    #[test]
    fn this_machine_can_be_measured() {
        let foreign = Foreign::default();
        let gauge = Gauge::start(&foreign);
        let before = gauge.before;
        // On a busy machine it takes a while to be given that much of a processor.
        let used = || {
            let text = text(Path::new("/proc/thread-self/schedstat"));
            Duration::from_nanos(text.split(' ').next().unwrap().parse().unwrap())
        };
        let (enough, mut spun) = (used() + Duration::from_millis(60), 0u64);
        while used() < enough {
            (0..100_000).for_each(|_| spun = std::hint::black_box(spun + 1));
        }
        let machine = gauge.finish(0.25);
        assert!(machine.late_max_seconds == 0.25 && !machine.message.is_empty());
        assert!(machine.stall_max_seconds >= 0.0 && machine.stall_max_seconds < 60.0);
        // Our own work is neither the stack's nor anybody else's.
        let now = Places::find(&foreign).read();
        assert!(now.own - before.own >= 0.01, "{before:?} {now:?}");
        assert!(before.processors >= 1.0 && before.used.is_some_and(|used| used > 0.0));
    }
}
