//! What a stack uses: the CPU time of all its processes, and the most memory that they had.
//!
//! CPU time is exact to a clock tick: whoever ends below the slot's process is reaped by it or
//! by its own parent, and the kernel adds what it and its reaped children used to the slot's
//! count of its children. Memory is sampled: the sum of the resident sets, in which a page that
//! two processes share counts twice, and never less than one process's own high-water mark.

use std::collections::BTreeSet;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::stack::processes::{Spared, descendants};

/// A program that starts is looked at soon; one that runs on, twice a second.
const FIRST_PAUSE: Duration = Duration::from_millis(20);
const LONGEST_PAUSE: Duration = Duration::from_millis(500);
/// Where there are many processes a look takes long; it may cost a fiftieth of a processor.
const REST: u32 = 50;
/// A look that takes long because the machine is busy must not blind us for long.
const LONGEST_REST: Duration = Duration::from_secs(1);

/// The map `stack.usage` of RESULT.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Usage {
    /// From the stack's start until the last of its processes was gone.
    pub seconds: f64,
    /// User and system time of all its processes, those that ended early too.
    pub cpu_seconds: f64,
    pub peak_memory_bytes: u64,
}

/// A measurement that goes on.
#[derive(Debug)]
pub struct UsageSampler {
    begun: Instant,
    cpu_before: f64,
    /// Dropped, it ends the sampler.
    enough: Sender<()>,
    sampler: Option<JoinHandle<u64>>,
}

impl UsageSampler {
    /// Measures what is below this process, but not the `spared` processes and theirs.
    pub fn start(spared: &Spared) -> Self {
        let (enough, asked) = channel();
        let spared = spared.clone();
        let sampler = std::thread::Builder::new()
            .name("usage".to_owned())
            .spawn(move || {
                let (mut peak, mut pause) = (0, FIRST_PAUSE);
                loop {
                    let begun = Instant::now();
                    peak = peak.max(memory(&descendants(std::process::id(), &spared.pids())));
                    let rest = pause.max((begun.elapsed() * REST).min(LONGEST_REST));
                    pause = (pause * 2).min(LONGEST_PAUSE);
                    if asked.recv_timeout(rest) != Err(RecvTimeoutError::Timeout) {
                        return peak;
                    }
                }
            })
            .ok();
        Self { begun: Instant::now(), cpu_before: reaped_cpu_seconds(), enough, sampler }
    }

    /// Ends the sampling, after a last look: to be called while the stack still runs.
    pub fn stop_sampling(self, spared: &Spared) -> Sampled {
        let Self { begun, cpu_before, enough, sampler } = self;
        drop(enough);
        let last = memory(&descendants(std::process::id(), &spared.pids()));
        let sampled = sampler.and_then(|thread| thread.join().ok()).unwrap_or_default();
        Sampled { begun, cpu_before, peak: sampled.max(last) }
    }
}

/// A measurement whose memory is known.
#[derive(Debug, Clone, Copy)]
pub struct Sampled {
    begun: Instant,
    cpu_before: f64,
    peak: u64,
}

impl Sampled {
    /// To be called when every process that was measured has been reaped.
    pub fn finish(self) -> Usage {
        Usage {
            seconds: self.begun.elapsed().as_secs_f64(),
            cpu_seconds: (reaped_cpu_seconds() - self.cpu_before).max(0.0),
            peak_memory_bytes: self.peak,
        }
    }
}

/// User and system time of all children that this process has reaped so far, and of theirs.
fn reaped_cpu_seconds() -> f64 {
    let stat = std::fs::read("/proc/self/stat").unwrap_or_default();
    reaped_ticks(&String::from_utf8_lossy(&stat)) as f64
        / rustix::param::clock_ticks_per_second() as f64
}

/// `cutime` and `cstime` of a line of /proc/PID/stat (proc(5), fields 16 and 17).
fn reaped_ticks(stat: &str) -> u64 {
    // The command's name stands in parentheses and may hold anything.
    let after = stat.rsplit(')').next().unwrap_or_default();
    after.split_whitespace().skip(13).take(2).filter_map(|field| field.parse::<u64>().ok()).sum()
}

/// Bytes that processes have resident, or the most that one of them ever had if that is more.
fn memory(processes: &BTreeSet<i32>) -> u64 {
    let (mut together, mut highest) = (0, 0);
    for pid in processes {
        // It may have ended a moment ago; a zombie has no memory either.
        // The name in it may be no text.
        let status = std::fs::read(format!("/proc/{pid}/status")).unwrap_or_default();
        let status = String::from_utf8_lossy(&status);
        together += kibibytes(&status, "VmRSS:");
        highest = highest.max(kibibytes(&status, "VmHWM:"));
    }
    together.max(highest) * 1024
}

fn kibibytes(status: &str, key: &str) -> u64 {
    let line = status.lines().find_map(|line| line.strip_prefix(key)).unwrap_or_default();
    line.split_whitespace().next().and_then(|number| number.parse().ok()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStrExt;
    use std::process::Command;

    use super::*;

    #[test]
    fn the_kernels_lines_are_read_by_their_fields() {
        let stat = "7 (a) b) c) S 1 7 7 0 -1 4194560 10 20 30 40 111 222 333 444 20 0 1 0 5";
        assert_eq!(reaped_ticks(stat), 333 + 444);
        assert_eq!(reaped_ticks(""), 0);
        let status = "Name:\tx\nVmHWM:\t    2048 kB\nVmRSS:\t    1024 kB\n";
        assert_eq!((kibibytes(status, "VmRSS:"), kibibytes(status, "VmHWM:")), (1024, 2048));
        assert_eq!(kibibytes("Name:\tzombie\n", "VmRSS:"), 0);
    }

    #[test]
    fn a_process_is_measured_whatever_its_name_is() {
        let name = std::ffi::OsStr::from_bytes(b"\xfcber");
        let program = std::env::temp_dir().join(format!("usage-{}", std::process::id()));
        std::fs::create_dir_all(&program).unwrap();
        let program = program.join(name);
        std::os::unix::fs::symlink("/bin/sleep", &program).unwrap();
        let mut sleeps = Command::new(&program).arg("60").spawn().unwrap();
        let used = memory(&BTreeSet::from([i32::try_from(sleeps.id()).unwrap()]));
        sleeps.kill().unwrap();
        sleeps.wait().unwrap();
        std::fs::remove_dir_all(program.parent().unwrap()).unwrap();
        assert!(used > 0);
    }
}
