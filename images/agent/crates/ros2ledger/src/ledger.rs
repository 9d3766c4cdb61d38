//! The ledger as its reader has it.

use std::ffi::{OsStr, OsString};
use std::os::fd::AsRawFd;
use std::path::Path;
use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::SeqCst;

use crate::endpoint::{self, Wrong};
use crate::layout::{
    ENDPOINTS, EXITED, EndpointSlot, Layout, OWNER_SHIFT, PHASE_CLAIMED, PHASE_DESTROYED,
    PHASE_FREE, PHASE_LIVE, PROCESS_FREE, PROCESS_LIVE, PROCESS_REPLACED, PROCESSES, ProcessEntry,
    phase,
};
use crate::memory::Memory;
use crate::process::{awake, is_alive, uses_ros2};
use crate::{
    Awake, Counts, Endpoint, EndpointId, LedgerError, Process, ProcessId, Strength, library,
};

/// A ledger: the nodes that are started with its [`environment`](Ledger::environment) count in it.
/// Dropping it leaves them uncounted; they run on.
pub struct Ledger {
    pub(crate) memory: Memory,
    /// Odd while matches are watched; each watch has another number.
    watches: AtomicU32,
}

/// What found no room. While all of it is 0, everything that counts is listed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Unlisted {
    /// Processes beyond the 512 that a ledger has room for: nothing of theirs is counted.
    pub processes: u32,
    /// Endpoints beyond 4096, and callbacks of them; [`Process::unlisted`] has whose.
    pub endpoints: u32,
}

impl Ledger {
    /// An empty ledger.
    ///
    /// # Errors
    /// [`LedgerError::Memory`] if the kernel gives none, which needs 2.9 MiB at the most.
    pub fn new() -> Result<Ledger, LedgerError> {
        Ok(Ledger { memory: Memory::new()?, watches: AtomicU32::new(0) })
    }

    /// What to put into a node's environment. `library` is the absolute path of a file with
    /// [`crate::LIBRARY`], `preload` the LD_PRELOAD that the node has anyway.
    ///
    /// The node has to run as this process' user, or with more rights: it opens the memory by
    /// this process' descriptor.
    pub fn environment(
        &self,
        library: &Path,
        preload: Option<&OsStr>,
    ) -> [(&'static str, OsString); 2] {
        let (pid, file) = (std::process::id(), self.memory.file().as_raw_fd());
        library::environment(format!("/proc/{pid}/fd/{file}").into(), library, preload)
    }

    /// The processes that have created an endpoint, in no order.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`].
    pub fn processes(&self) -> Result<Vec<Process>, LedgerError> {
        let listed = (0..PROCESSES).map(|entry| self.entry(entry)).filter_map(Result::transpose);
        listed.map(|one| one.map(|one| Process { alive: self.runs(one.id), ..one })).collect()
    }

    /// The threads that are not asleep of every process that counts, and of these others: they run, wait for a
    /// processor or a disk, or were stopped. What a process has not done while it is not asleep, it may still
    /// do.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`].
    pub fn awake(&self, others: &[u32]) -> Result<Vec<Awake>, LedgerError> {
        let alive = self.processes()?.into_iter().filter(|one| one.alive).map(|one| one.id.pid);
        Ok(alive.chain(others.iter().copied()).flat_map(awake).collect())
    }

    /// The subscriptions and publishers, also those that were destroyed or whose process ended,
    /// until they are retired.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`].
    pub fn endpoints(&self) -> Result<Vec<Endpoint>, LedgerError> {
        self.endpoints_like(&[])
    }

    /// The same, for who has read most of them before, in the order of their slots.
    pub(crate) fn endpoints_like(&self, before: &[Endpoint]) -> Result<Vec<Endpoint>, LedgerError> {
        let mut before = before.iter().peekable();
        let mut all = Vec::new();
        for at in 0..self.used() {
            while before.next_if(|one| one.id.slot < at).is_some() {}
            let known = before.peek().copied().filter(|one| one.id.slot == at);
            all.extend(self.endpoint(at, known)?);
        }
        Ok(all)
    }

    /// Callbacks of timers and services in each process: those that ended, and those that began.
    pub(crate) fn others(&self) -> Result<Vec<(ProcessId, u64, u64)>, LedgerError> {
        let mut all = Vec::new();
        for entry in 0..PROCESSES {
            let Some(one) = self.entry(entry)? else { continue };
            all.push((one.id, one.others_ended, one.others_started));
        }
        Ok(all)
    }

    /// What one endpoint has done by now: a few loads, for who asks often.
    ///
    /// # Errors
    /// [`LedgerError::Retired`], and [`LedgerError::Damaged`].
    pub fn counts(&self, id: EndpointId) -> Result<Counts, LedgerError> {
        let slot = self.slot(id)?;
        let counts = endpoint::counts(slot).map_err(|wrong| self.damaged(slot, wrong))?;
        // Another use of the slot may have begun in between.
        self.slot(id).map(|_| counts)
    }

    /// Has the nodes report how many publishers their subscriptions have matched, and how many
    /// subscriptions their publishers, or no longer: [`Endpoint::matched`] and
    /// [`Event::Matched`](crate::Event::Matched). Each watch begins without figures.
    ///
    /// A player needs both: that its writer has matched the readers, which it knows itself, and
    /// that they have matched it; so does a recorder of the writers. Either may be the first, by
    /// milliseconds; what goes out before both is lost to a volatile reader.
    ///
    /// Meanwhile a node's waits are cut into pieces of 20 ms; it is asked all the same if it waits
    /// without end, unless it began to before the watch: then not until something wakes it. So
    /// begin before the nodes start, and end when all are matched.
    pub fn watch_matches(&self, watch: bool) {
        let change = |number: u32| (watch != (number % 2 == 1)).then(|| number.wrapping_add(1));
        let _as_it_was = self.watches.fetch_update(SeqCst, SeqCst, change);
        let number = watch_number(self.watches.load(SeqCst));
        self.memory.header.watch_matches.store(number, SeqCst);
    }

    /// How many endpoints were ever listed: while it is the same, none is new. One load, for who asks
    /// often.
    pub fn listed(&self) -> u32 {
        self.memory.header.listings.load(SeqCst)
    }

    /// Has the takes of a subscription wake nobody before it has taken so many in all: a wake for
    /// each message costs the node some µs of each.
    ///
    /// # Errors
    /// [`LedgerError::Retired`].
    pub fn wake_from(&self, id: EndpointId, taken: u64) -> Result<(), LedgerError> {
        self.slot(id)?.wake_from.store(taken, SeqCst);
        Ok(())
    }

    /// What found no room.
    pub fn unlisted(&self) -> Unlisted {
        let header = &self.memory.header;
        Unlisted {
            processes: header.unlisted_processes.load(SeqCst),
            endpoints: header.unlisted_endpoints.load(SeqCst),
        }
    }

    /// What can be proved of a process at the most; `None` if it uses no ROS 2 that can be seen. A
    /// program into which ROS 2 is linked statically looks like one without.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`]; [`LedgerError::Memory`] if the process is another user's.
    pub fn strength_of(&self, pid: u32) -> Result<Option<Strength>, LedgerError> {
        let counting = |process: &Process| process.id.pid == pid && process.alive;
        let Some(process) = self.processes()?.into_iter().find(counting) else {
            return Ok(uses_ros2(pid)?.then_some(Strength::Received));
        };
        let of_it = self.endpoints()?.into_iter().filter(|one| one.process == process.id);
        Ok(Some(of_it.map(|one| one.strength).max().unwrap_or(Strength::Taken)))
    }

    /// Gives the slots of endpoints free that will never count again, and returns their last
    /// figures: endpoints of processes that ended, and destroyed ones with nothing in hand. A
    /// destroyed one whose callback still runs stays until that has ended.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`]; nothing is given free then.
    pub fn retire(&self) -> Result<Vec<Endpoint>, LedgerError> {
        // Who has ended is asked before the figures are read, which are the last ones then.
        let ended: Vec<ProcessId> =
            self.processes()?.iter().filter(|one| !one.alive).map(|one| one.id).collect();
        let mut last = self.endpoints()?;
        last.retain(|one| ended.contains(&one.process) || one.is_at_rest());
        for one in &last {
            self.memory.endpoint[one.id.slot].state.store(PHASE_FREE, SeqCst);
        }
        for id in ended {
            self.free_claimed(id.entry);
            let process = &self.memory.process[id.entry];
            process.state.store(PROCESS_FREE, SeqCst);
            process.start.store(0, SeqCst);
            process.stack.store(0, SeqCst);
            process.pid.store(0, SeqCst);
        }
        Ok(last)
    }

    /// Slots that a process had begun to fill when it ended.
    fn free_claimed(&self, entry: usize) {
        let claimed = PHASE_CLAIMED | (entry as u32) << OWNER_SHIFT;
        for slot in &self.memory.endpoint {
            let _another_phase = slot.state.compare_exchange(claimed, PHASE_FREE, SeqCst, SeqCst);
        }
    }

    /// Slots that were ever used, never more than there are.
    fn used(&self) -> usize {
        (self.memory.header.endpoints_used.load(SeqCst) as usize).min(ENDPOINTS)
    }

    /// `None` of an entry that nobody has, or has not filled in yet; whether it runs is not asked.
    fn entry(&self, entry: usize) -> Result<Option<Process>, LedgerError> {
        let process: &ProcessEntry = &self.memory.process[entry];
        let state = process.state.load(SeqCst);
        let pid = process.pid.load(SeqCst);
        if state == PROCESS_FREE || pid == 0 {
            return Ok(None);
        }
        if !matches!(state, PROCESS_LIVE | PROCESS_REPLACED) {
            let at = std::mem::offset_of!(ProcessEntry, state);
            return Err(self.damaged(process, (at, format!("{state} is no state of a process"))));
        }
        let id = ProcessId { pid, start: process.start.load(SeqCst), entry };
        let unlisted = process.unlisted_endpoints.load(SeqCst);
        // Before the starts, so that a node that counts meanwhile is not taken for one that lies.
        let others_ended = process.others_ended.load(SeqCst);
        let others_started = process.others_started.load(SeqCst);
        if others_ended > others_started {
            let at = std::mem::offset_of!(ProcessEntry, others_ended);
            let what = format!("{others_ended} ends of {others_started} starts");
            return Err(self.damaged(process, (at, what)));
        }
        let spinners = process.spinners.load(SeqCst);
        let machine_timers = process.machine_timers.load(SeqCst);
        let exit_status = self.exit_status(process)?;
        let alive = false;
        Ok(Some(Process {
            id,
            alive,
            unlisted,
            spinners,
            others_started,
            others_ended,
            machine_timers,
            exit_status,
        }))
    }

    fn exit_status(&self, process: &ProcessEntry) -> Result<Option<u8>, LedgerError> {
        let noted = process.exit_status.load(SeqCst);
        match (noted.checked_sub(EXITED).map(u8::try_from), noted) {
            (Some(Ok(status)), _) => Ok(Some(status)),
            (None, 0) => Ok(None),
            _ => {
                let at = std::mem::offset_of!(ProcessEntry, exit_status);
                Err(self.damaged(process, (at, format!("{noted} is no exit status"))))
            }
        }
    }

    /// Whether this program runs: its process does, and has become no other one.
    pub(crate) fn runs(&self, id: ProcessId) -> bool {
        let process = &self.memory.process[id.entry];
        process.pid.load(SeqCst) == id.pid
            && process.start.load(SeqCst) == id.start
            && process.state.load(SeqCst) == PROCESS_LIVE
            && is_alive(id, process.stack.load(SeqCst))
    }

    /// The process of a slot's state, without asking the kernel for it.
    fn owner(&self, slot: &EndpointSlot, state: u32) -> Result<ProcessId, LedgerError> {
        let entry = (state >> OWNER_SHIFT) as usize;
        let known = self.memory.process.get(entry);
        let Some(process) = known.filter(|one| one.pid.load(SeqCst) != 0) else {
            let what = format!("process {entry} has it, which there is not");
            return Err(self.damaged(slot, (0, what)));
        };
        let (pid, start) = (process.pid.load(SeqCst), process.start.load(SeqCst));
        Ok(ProcessId { pid, start, entry })
    }

    /// `None` of a slot that is free or not filled in yet. `known` is what it was, if it was read.
    fn endpoint(
        &self,
        at: usize,
        known: Option<&Endpoint>,
    ) -> Result<Option<Endpoint>, LedgerError> {
        let slot = &self.memory.endpoint[at];
        let generation = slot.generation.load(SeqCst);
        let state = slot.state.load(SeqCst);
        let phase = match phase(state) {
            PHASE_FREE | PHASE_CLAIMED => return Ok(None),
            phase @ (PHASE_LIVE | PHASE_DESTROYED) => phase,
            other => {
                return Err(self.damaged(slot, (0, format!("{other} is no phase of an endpoint"))));
            }
        };
        let process = self.owner(slot, state)?;
        let id = EndpointId { slot: at, generation };
        let read = match known.filter(|one| one.id == id && one.process == process) {
            Some(known) => endpoint::again(slot, known, phase),
            None => {
                let watch = watch_number(self.watches.load(SeqCst));
                endpoint::read(slot, id, process, phase, watch)
            }
        };
        let mut read = read.map_err(|wrong| self.damaged(slot, wrong))?;
        let replaced = &self.memory.process[process.entry].state;
        read.destroyed |= replaced.load(SeqCst) == PROCESS_REPLACED;
        Ok(Some(read))
    }

    /// The slot of an endpoint that is not retired.
    pub(crate) fn slot(&self, id: EndpointId) -> Result<&EndpointSlot, LedgerError> {
        let slot = &self.memory.endpoint[id.slot];
        let same =
            slot.generation.load(SeqCst) == id.generation && slot.state.load(SeqCst) != PHASE_FREE;
        if same { Ok(slot) } else { Err(LedgerError::Retired(id)) }
    }

    /// An error about a field of `part`, which lies in the shared memory.
    fn damaged<T>(&self, part: &T, (at, what): Wrong) -> LedgerError {
        let layout: &Layout = &self.memory;
        let offset = std::ptr::from_ref(part).addr() - std::ptr::from_ref(layout).addr() + at;
        LedgerError::Damaged { offset, what }
    }
}

impl Drop for Ledger {
    fn drop(&mut self) {
        // The nodes would cut their waits for as long as they live.
        self.watch_matches(false);
    }
}

/// The number of a watch that goes on, otherwise 0.
fn watch_number(watches: u32) -> u32 {
    if watches % 2 == 1 { watches } else { 0 }
}
