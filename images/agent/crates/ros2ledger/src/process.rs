//! The processes of the ledger, and what the kernel knows of them.

use std::io::{BufRead, BufReader, ErrorKind};
use std::time::Duration;

/// One program in a process: neither one that gets its number later, nor one that it becomes by
/// `exec`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ProcessId {
    /// Its number.
    pub pid: u32,
    /// When it began, in clock ticks since the machine's start.
    pub start: u64,
    pub(crate) entry: usize,
}

/// A process that counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Process {
    /// Which one.
    pub id: ProcessId,
    /// Whether it runs: neither ended, nor a zombie, nor another program by `exec`.
    pub alive: bool,
    /// Endpoints, or their callbacks, that it could not list: of these nothing is counted.
    pub unlisted: u32,
    /// Threads that have taken or waited by now, also those that have ended. Where there are several,
    /// and no tracepoints, that a callback has ended may show late or never.
    pub spinners: u32,
    /// Callbacks that began and are no listed subscription's: of timers, and of services.
    pub others_started: u64,
    /// Those that ended.
    pub others_ended: u64,
    /// Calls of timers that go by the machine's clock, whatever time the process is shown: wall timers,
    /// and those of ROS' time where nobody simulates it. Not those of a process without an endpoint yet.
    pub machine_timers: u64,
    /// What it has called exit(3) with by now, of which a parent is given 8 bits: what it ends with, unless it breaks
    /// on its way out.
    pub exit_status: Option<u8>,
}

/// How far a delivery to an endpoint is proved; the stronger is the greater.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Strength {
    /// Its process uses ROS 2 without counting: that it has the message is the middleware's word.
    Received,
    /// The node took the message from the middleware.
    Taken,
    /// The node's callback was called with it, and came to its end.
    Called,
}

/// Whether this very process runs still, and the program in it whose stack began at `stack`.
pub(crate) fn is_alive(process: ProcessId, stack: u64) -> bool {
    let stat = std::fs::read(format!("/proc/{}/stat", process.pid)).unwrap_or_default();
    let Some(now) = began(&stat) else { return false };
    // Of a process whose first thread has ended, and others not, the kernel shows no stack.
    let goes_on = match state(&stat) {
        Some(b'Z') => has_other_threads(process.pid),
        state => !matches!(state, Some(b'X' | b'x')),
    };
    if !goes_on {
        return false;
    }
    // The kernel hides the stack of a process that does not let itself be read.
    let known = stack != 0 && now.stack != 0;
    now.start == process.start && (!known || now.stack == stack)
}

/// Whether a process whose first thread has ended goes on by another.
fn has_other_threads(pid: u32) -> bool {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    threads
        .map(|thread| std::fs::read(thread.path().join("stat")).unwrap_or_default())
        .any(|stat| state(&stat).is_some_and(|state| !matches!(state, b'Z' | b'X' | b'x')))
}

/// A thread that is not asleep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Awake {
    /// Its number.
    pub thread: u32,
    /// For how long a processor has run it since it began, in the kernel's ticks: of 10 ms on most machines.
    pub ran: Duration,
}

/// The threads of a process that want to go on: they run, wait for a processor or a disk, or were stopped. What
/// has ended sleeps.
pub(crate) fn awake(pid: u32) -> impl Iterator<Item = Awake> {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).into_iter().flatten().flatten();
    threads.filter_map(|thread| {
        let stat = std::fs::read(thread.path().join("stat")).unwrap_or_default();
        let is_awake = matches!(state(&stat), Some(b'R' | b'D' | b'T' | b't'));
        let number = thread.file_name().to_str()?.parse().ok()?;
        is_awake.then(|| Awake { thread: number, ran: ran(&stat) })
    })
}

/// How long it ran in its own code and in the kernel, fields 14 and 15.
fn ran(stat: &[u8]) -> Duration {
    let name_ends = stat.iter().rposition(|byte| *byte == b')').unwrap_or(stat.len());
    let fields = std::str::from_utf8(stat.get(name_ends + 1..).unwrap_or_default());
    let both = fields.unwrap_or_default().split_ascii_whitespace().skip(11).take(2);
    let ticks: u64 = both.filter_map(|ticks| ticks.parse::<u64>().ok()).sum();
    Duration::from_secs_f64(ticks as f64 / rustix::param::clock_ticks_per_second() as f64)
}

/// The state of a process or thread, by its line of proc(5)'s `stat`, field 3.
fn state(stat: &[u8]) -> Option<u8> {
    // The name, in brackets, may have any bytes.
    let name_ends = stat.iter().rposition(|byte| *byte == b')')?;
    stat.get(name_ends + 2).copied()
}

/// When a process began, and where its stack does: 0 if that is hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Began {
    start: u64,
    stack: u64,
}

/// As `/proc/PID/stat` has it; `None` of a process that is gone.
fn began(stat: &[u8]) -> Option<Began> {
    // The name, in brackets, may have any bytes.
    let name_ends = stat.iter().rposition(|byte| *byte == b')')?;
    let mut fields = std::str::from_utf8(&stat[name_ends + 1..]).ok()?.split_ascii_whitespace();
    let start = fields.nth(19)?.parse().ok()?;
    let stack = fields.nth(5)?.parse().ok()?;
    Some(Began { start, stack })
}

/// Whether a process has loaded ROS 2's client library or a middleware of it.
///
/// # Errors
/// Its memory map can't be read, as another user's can't.
pub(crate) fn uses_ros2(pid: u32) -> std::io::Result<bool> {
    let maps = match std::fs::File::open(format!("/proc/{pid}/maps")) {
        Ok(maps) => BufReader::new(maps),
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(false),
        Err(error) => return Err(error),
    };
    for line in maps.split(b'\n') {
        let line = line?;
        let name = line.rsplit(|byte| *byte == b'/').next().unwrap_or_default();
        if name.starts_with(b"librcl.so") || name.starts_with(b"librmw_") {
            return Ok(true);
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAT: &str = "7 (a) (b c) S 1 7 7 0 -1 4194560 1 2 3 4 5 6 7 8 20 0 1 0 991 1000 50 9 1 2 \
        77 0 0";

    #[test]
    fn who_waits_is_asleep_and_who_runs_is_not() {
        let is_asleep = |pid: u32| awake(pid).next().is_none();
        assert_eq!(state(STAT.as_bytes()), Some(b'S'));
        assert_eq!(state(b"7 (a"), None);
        // This very thread runs.
        assert!(!is_asleep(std::process::id()));
        let mut waits = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while !is_asleep(waits.id()) {
            assert!(std::time::Instant::now() < deadline);
            std::thread::yield_now();
        }
        waits.kill().unwrap();
        waits.wait().unwrap();
        assert!(is_asleep(waits.id()));
    }

    #[test]
    fn how_long_a_thread_ran_is_fields_14_and_15_and_none_of_what_is_cut_off() {
        let tick = 1.0 / rustix::param::clock_ticks_per_second() as f64;
        assert_eq!(ran(STAT.as_bytes()), Duration::from_secs_f64(11.0 * tick));
        assert_eq!(ran(b"7 (a) R 1"), Duration::ZERO);
        assert_eq!(ran(b"7 (a"), Duration::ZERO);
        let thread = rustix::thread::gettid().as_raw_nonzero().get().unsigned_abs();
        let own = || awake(std::process::id()).find(|one| one.thread == thread).unwrap().ran;
        let (before, begun) = (own(), std::time::Instant::now());
        while own() < before + Duration::from_millis(50) {
            assert!(begun.elapsed() < Duration::from_secs(60), "it does not count what it runs");
        }
        assert!(begun.elapsed() >= Duration::from_millis(20));
    }

    #[test]
    fn the_start_time_is_field_22_behind_any_name_and_the_stack_field_28() {
        let whole = Began { start: 991, stack: 77 };
        assert_eq!(began(STAT.as_bytes()), Some(whole));
        assert_eq!(began(STAT.replace(") S", ") Z").as_bytes()), Some(whole));
        for length in 0..STAT.find("77 0 0").unwrap() {
            assert_eq!(began(&STAT.as_bytes()[..length]), None, "{length}");
        }
    }

    #[test]
    fn a_process_runs_whose_first_thread_alone_has_ended_and_a_zombie_does_not() {
        // exit_thread(2), as by pthread_exit() in main().
        let program = "import ctypes, os, threading, time
threading.Thread(target=time.sleep, args=(60,)).start()
ctypes.CDLL(None).syscall({'x86_64': 60, 'aarch64': 93}[os.uname().machine], 0)";
        let mut child =
            std::process::Command::new("/usr/bin/python3").args(["-c", program]).spawn().unwrap();
        let pid = child.id();
        let stat = || std::fs::read(format!("/proc/{pid}/stat")).unwrap();
        let Began { start, .. } = began(&stat()).unwrap();
        let id = ProcessId { pid, start, entry: 0 };
        let deadline = std::time::Instant::now() + std::time::Duration::from_secs(60);
        while state(&stat()) != Some(b'Z') {
            assert!(std::time::Instant::now() < deadline, "its first thread has not ended");
            std::thread::sleep(std::time::Duration::from_millis(5));
        }
        assert!(is_alive(id, 0) && is_alive(id, 77));
        child.kill().unwrap();
        while is_alive(id, 0) {
            assert!(std::time::Instant::now() < deadline, "it was killed, and runs");
            std::thread::yield_now();
        }
        assert_eq!(state(&stat()), Some(b'Z'), "nobody has collected it");
        child.wait().unwrap();
        assert!(!is_alive(id, 0));
    }

    #[test]
    fn this_process_runs_and_uses_no_ros() {
        let pid = std::process::id();
        let Began { start, stack } = began(&std::fs::read("/proc/self/stat").unwrap()).unwrap();
        let own = ProcessId { pid, start, entry: 0 };
        assert!(stack != 0 && is_alive(own, stack) && is_alive(own, 0));
        assert!(!is_alive(own, stack + 1));
        assert!(!is_alive(ProcessId { start: start + 1, ..own }, stack));
        assert!(!uses_ros2(pid).unwrap());
        assert!(!uses_ros2(u32::MAX).unwrap());
    }
}
