//! Waiting until the counts are as somebody needs them.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use rustix::fs::Timespec;
use rustix::thread::futex;

use crate::{Ledger, LedgerError, ProcessId};

/// How long a wait may go without a look at the processes: nobody wakes us for one that was killed.
const LOOK: Duration = Duration::from_millis(20);

/// What somebody waits for. Nodes wake for no other event, and once for each time that somebody
/// begins to sleep: a wake costs them some µs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Event {
    /// A message was taken.
    Taken,
    /// A callback began.
    Started,
    /// A callback ended, or a thread came back with what it took.
    Ended,
    /// A message was published.
    Published,
    /// An endpoint was created or destroyed.
    Listed,
    /// A subscription or publisher has matched another number of the other kind, while these are
    /// watched.
    Matched,
}

/// How a wait ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Waited {
    /// It holds.
    Held,
    /// It did not hold until the deadline.
    Late,
    /// It does not hold, and this process has ended.
    Ended(ProcessId),
}

impl Ledger {
    /// Waits until `holds`, asked after each of `events` and every 20 ms, returns true, one of
    /// `processes` has ended, or the deadline is past. It sleeps between, and `holds` is asked
    /// once more after the end of a process was noticed.
    ///
    /// # Errors
    /// Those of `holds`; [`LedgerError::Memory`] if the kernel can't wait.
    pub fn wait(
        &self,
        events: &[Event],
        processes: &[ProcessId],
        deadline: Instant,
        mut holds: impl FnMut(&Ledger) -> Result<bool, LedgerError>,
    ) -> Result<Waited, LedgerError> {
        let changes = &self.memory.header.changes;
        let mut looked = Instant::now();
        loop {
            for event in events {
                self.memory.header.wanted[*event as usize].store(1, SeqCst);
            }
            let before = changes.load(SeqCst);
            if holds(self)? {
                return Ok(Waited::Held);
            }
            let now = Instant::now();
            if now >= deadline {
                return Ok(Waited::Late);
            }
            if now >= looked + LOOK {
                looked = now;
                if let Some(ended) = processes.iter().find(|one| !self.runs(**one)) {
                    return Ok(if holds(self)? { Waited::Held } else { Waited::Ended(*ended) });
                }
            }
            sleep(changes, before, LOOK.min(deadline - now))?;
        }
    }
}

/// Sleeps while `changes` is `before`, at most for `limit`.
fn sleep(changes: &AtomicU32, before: u32, limit: Duration) -> Result<(), LedgerError> {
    use rustix::io::Errno;
    let limit = Timespec::try_from(limit).map_err(std::io::Error::other)?;
    match futex::wait(changes, futex::Flags::empty(), before, Some(&limit)) {
        Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => Ok(()),
        Err(other) => Err(LedgerError::Memory(other.into())),
    }
}
