//! Waiting until the counts are as somebody needs them.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::SeqCst;
use std::time::{Duration, Instant};

use rustix::fs::Timespec;
use rustix::thread::futex;

use crate::layout::Header;
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
        let Header { changes, wanted, .. } = &self.memory.header;
        let (mut looked, mut wanting) = (Instant::now(), false);
        loop {
            // Read first: whoever is woken from here on has changed it, so that we don't sleep.
            let before = changes.load(SeqCst);
            if wanting {
                events.iter().for_each(|event| wanted[*event as usize].store(1, SeqCst));
            }
            if holds(self)? {
                return Ok(Waited::Held);
            }
            // Where it holds at the first question, nobody is to wake us.
            if !wanting {
                wanting = true;
                continue;
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
            // What woke us is wanted no more, unless it was not what we wait for.
            wanting = changes.load(SeqCst) == before;
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
