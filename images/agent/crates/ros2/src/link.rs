//! What goes out to one node on a topic that is played, and what the node has done with it.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{HANGS, LinkState, Share};
use bagpipe_ros2ledger::{Counts, Endpoint, Ledger, LedgerError, Process, ProcessId, Strength};

use crate::subscriptions::{MOST_WAITING, Subscriptions};

/// How long a callback is waited for whose end is not reported.
const UNSEEN: Duration = Duration::from_secs(5);

/// Why a node takes nothing of which no callback runs.
const IDLE: &str = "none of its callbacks runs: it takes from the topic too seldom, its middleware filters \
    it by content, or it was stopped";
/// The same, where messages may be lost on their way.
const LOST_OR_IDLE: &str = "none of its callbacks runs: they were lost on their way, as it asks for best \
    effort, or it takes from the topic too seldom, its middleware filters it by content, or it was stopped";

/// A subscribing node of a topic, in one process: also after it has left the topic, and come back.
#[derive(Debug)]
pub(crate) struct Link {
    id: u64,
    pub(crate) node: String,
    /// Distinguishes nodes of one name that are there at the same time.
    pub(crate) instance: u32,
    /// `None` where the node does not count, so that nothing is known of it.
    pub(crate) counted: Option<Subscriptions>,
    /// The process of one that counts, and has not matched us.
    unmatched: Option<ProcessId>,
    open: AtomicBool,
    sent: Mutex<Totals>,
    /// What it had taken, whoever published it, when our last message went out beside others; before one
    /// did, more than anybody takes.
    taken_before: AtomicU64,
    /// How long was waited until it had room, in ns.
    held_up: AtomicU64,
    last: Mutex<Last>,
}

/// When a link was last seen to take.
#[derive(Debug)]
struct Last {
    known: u64,
    since: Instant,
    stuck: bool,
}

/// How much went out.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    lead_in: u64,
    window: u64,
    window_bytes: u64,
}

impl Totals {
    /// Takes in that a message of so many bytes goes out.
    pub(crate) fn add(&mut self, share: Share, bytes: usize) {
        match share {
            Share::LeadIn => self.lead_in += 1,
            Share::Counted => {
                self.window += 1;
                self.window_bytes += bytes as u64;
            }
        }
    }

    pub(crate) fn messages(self) -> u64 {
        self.lead_in + self.window
    }

    fn join(&mut self, more: Totals) {
        self.lead_in += more.lead_in;
        self.window += more.window;
        self.window_bytes += more.window_bytes;
    }

    /// What went out since.
    pub(crate) fn since(self, before: Totals) -> Totals {
        Totals {
            // A message that was counted and then failed may have been in `before` alone.
            lead_in: self.lead_in.saturating_sub(before.lead_in),
            window: self.window.saturating_sub(before.window),
            window_bytes: self.window_bytes.saturating_sub(before.window_bytes),
        }
    }
}

impl Link {
    /// A link to which `sent` went out before it was noticed.
    pub(crate) fn new(
        id: u64,
        (node, instance): (String, u32),
        counted: Option<Subscriptions>,
        sent: Totals,
    ) -> Link {
        let (open, sent) = (AtomicBool::new(true), Mutex::new(sent));
        let last = Mutex::new(Last { known: 0, since: Instant::now(), stuck: false });
        let taken_before = AtomicU64::new(u64::MAX);
        let (unmatched, held_up) = (None, AtomicU64::new(0));
        Link { id, node, instance, counted, unmatched, open, sent, taken_before, held_up, last }
    }

    /// A link to somebody who subscribes and has not matched us, of all that was `sent`.
    pub(crate) fn unmatched(
        id: u64,
        name: (String, u32),
        process: ProcessId,
        sent: Totals,
    ) -> Link {
        Link { unmatched: Some(process), ..Link::new(id, name, None, sent) }
    }

    /// Whether it is there, and has not matched us.
    pub(crate) fn is_unmatched(&self) -> bool {
        self.unmatched.is_some() && self.is_open()
    }

    /// Whose it is that is there and has not matched us.
    pub(crate) fn unmatched_owner(&self) -> Option<(ProcessId, String)> {
        let process = self.unmatched.filter(|_| self.is_open())?;
        Some((process, self.node.clone()))
    }

    /// Whose it is, where its process counts.
    pub(crate) fn process(&self) -> Option<ProcessId> {
        self.counted.as_ref().map(|one| one.process).or(self.unmatched)
    }

    /// Takes in which publishers of the topic the stack has by now ([`Subscriptions::learn`]).
    pub(crate) fn learn(&self, publishers: &[&Endpoint], uncounted: bool) {
        if let Some(counted) = &self.counted {
            counted.learn(publishers, uncounted);
        }
    }

    /// Takes in the node's subscriptions as they are now, of which one that comes late is given so many
    /// that are `kept`, and returns whether they are others.
    pub(crate) fn replace(
        &self,
        subscriptions: &[&Endpoint],
        kept: u64,
        ledger: &Ledger,
    ) -> Result<bool, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(false) };
        let others = !counted.are(subscriptions);
        if others {
            counted.replace(subscriptions, (self.sent(), kept), ledger)?;
        }
        counted.note_strength(subscriptions);
        Ok(others)
    }

    /// Takes in how far it proves what it takes ([`Subscriptions::note_strength_in`]).
    pub(crate) fn note_strength(&self, endpoints: &[Endpoint]) {
        if let Some(counted) = &self.counted {
            counted.note_strength_in(endpoints);
        }
    }

    /// Whether it is of this node in this process.
    pub(crate) fn is_of(&self, (process, node): &(ProcessId, String)) -> bool {
        self.node == *node && self.counted.as_ref().is_some_and(|one| one.process == *process)
    }

    /// Whether what it takes of ours can't be distinguished from what it takes of the stack's own.
    pub(crate) fn is_mixed(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        self.counted.as_ref().map_or(Ok(false), |counted| counted.are_mixed(ledger))
    }

    /// Whether what its subscriptions have taken can't be known ([`Subscriptions::are_confused`]).
    pub(crate) fn is_confused(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        self.counted.as_ref().map_or(Ok(false), |counted| counted.are_confused(ledger))
    }

    /// Whether it is not known for either reason.
    pub(crate) fn is_unknown(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        Ok(self.is_confused(ledger)? || self.is_mixed(ledger)?)
    }

    /// Whether somebody publishes the topic beside us, or has done so.
    pub(crate) fn is_shared(&self) -> bool {
        self.counted.as_ref().is_some_and(Subscriptions::are_shared)
    }

    /// Takes in what it has taken beside others before a message of ours goes out.
    pub(crate) fn note_taken(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        if self.is_shared() {
            self.taken_before.store(self.taken_of_all(ledger)?, Ordering::Relaxed);
        }
        Ok(())
    }

    /// What it had taken by then.
    pub(crate) fn taken_before(&self) -> u64 {
        self.taken_before.load(Ordering::Relaxed)
    }

    /// Messages that its subscriptions have taken in all, whoever published them.
    pub(crate) fn taken_of_all(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        self.counted.as_ref().map_or(Ok(0), |counted| counted.taken_of_all(ledger))
    }

    /// Waits for nothing more of what went out by now ([`Subscriptions::write_off`]).
    pub(crate) fn write_off(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let (waiting, all) = (self.waiting(ledger)?, self.taken_of_all(ledger)?);
        Ok(self.counted.as_ref().is_some_and(|counted| counted.write_off(waiting, all)))
    }

    /// How long a message is waited for that may be lost ([`Subscriptions::patience`]).
    pub(crate) fn patience(&self, ledger: &Ledger) -> Result<Option<(Duration, u64)>, LedgerError> {
        self.counted.as_ref().map_or(Ok(None), |counted| counted.patience(ledger))
    }

    /// Whether it is there, and nothing is known of it.
    pub(crate) fn is_uncounted(&self) -> bool {
        self.counted.is_none() && self.unmatched.is_none() && self.is_open()
    }

    /// Takes in that a message of so many bytes goes out.
    pub(crate) fn count(&self, share: Share, bytes: usize) {
        self.totals().add(share, bytes);
    }

    /// Takes in how long was waited until it had room. Before the first message of the window nobody
    /// is held up.
    pub(crate) fn hold_up(&self, time: Duration) {
        if self.totals().window > 0 {
            let nanoseconds = u64::try_from(time.as_nanos()).unwrap_or(u64::MAX);
            self.held_up.fetch_add(nanoseconds, Ordering::Relaxed);
        }
    }

    fn totals(&self) -> MutexGuard<'_, Totals> {
        self.sent.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn state(&self) -> LinkState {
        let Totals { lead_in, window, window_bytes } = *self.totals();
        LinkState {
            id: self.id,
            node: self.node.clone(),
            instance: self.instance,
            lead_in,
            counted: window,
            counted_bytes: window_bytes,
            open: self.is_open(),
            held_up: Duration::from_nanos(self.held_up.load(Ordering::Relaxed)),
            room: None,
        }
    }

    pub(crate) fn id(&self) -> u64 {
        self.id
    }

    pub(crate) fn is_open(&self) -> bool {
        self.open.load(Ordering::Relaxed)
    }

    /// Its subscriptions are gone.
    pub(crate) fn close(&self) {
        self.open.store(false, Ordering::Relaxed);
    }

    /// It has subscriptions again; so much went out that it could have had of late.
    pub(crate) fn open(&self, sent: Totals) {
        self.totals().join(sent);
        self.open.store(true, Ordering::Relaxed);
    }

    /// Messages that went out while it was there.
    pub(crate) fn sent(&self) -> u64 {
        self.totals().messages()
    }

    /// Messages of ours that each of its subscriptions has taken; `None` where nobody counts.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<Option<u64>, LedgerError> {
        self.counted.as_ref().map(|counted| counted.taken(ledger)).transpose()
    }

    /// Messages that wait in the middleware or are on their way to it; 0 where nobody counts.
    pub(crate) fn waiting(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        self.counted.as_ref().map_or(Ok(0), |counted| counted.waiting(self.sent(), ledger))
    }

    /// Has nobody be woken before each of its subscriptions has taken so many more than the slowest.
    pub(crate) fn wake_after(&self, ledger: &Ledger, messages: u64) -> Result<(), LedgerError> {
        self.counted.as_ref().map_or(Ok(()), |counted| counted.wake_after(ledger, messages))
    }

    /// Messages that it has taken and not done with.
    pub(crate) fn in_hand(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let (begun, done) = self.begun_and_done(ledger)?;
        Ok(begun.saturating_sub(done))
    }

    /// Messages that it has taken, whoever published them, and those that it has done with.
    pub(crate) fn begun_and_done(&self, ledger: &Ledger) -> Result<(u64, u64), LedgerError> {
        self.counted.as_ref().map_or(Ok((0, 0)), |counted| counted.begun_and_done(ledger))
    }

    /// Whether it has taken nothing more for `UNSEEN`, by which the thread of an executor with several
    /// may be back that does not take again. Once it was so, it is. A single thread takes again or waits.
    fn is_stuck(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let process = self.counted.as_ref().map(|counted| counted.process);
        let several = |one: &Process| Some(one.id) == process && one.spinners > 1;
        if !ledger.processes()?.iter().any(several) {
            return Ok(false);
        }
        let taken = self.taken(ledger)?.unwrap_or(0);
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        let Last { known, since, stuck } = &mut *last;
        if *known != taken {
            (*known, *since) = (taken, Instant::now());
        }
        *stuck |= since.elapsed() >= UNSEEN;
        Ok(*stuck)
    }

    /// Messages that the smallest of its queues holds.
    pub(crate) fn depth(&self) -> u64 {
        self.counted.as_ref().map_or(MOST_WAITING, Subscriptions::depth)
    }

    /// Whether its library reports when callbacks end.
    pub(crate) fn reports_calls(&self) -> bool {
        self.counted.as_ref().is_some_and(|counted| counted.strength() == Strength::Called)
    }

    /// Whether the callbacks of all that was sent have ended; `None` where it can't be known, or
    /// something may have been lost. Of who does not report calls it is known that one runs, until
    /// that has taken so long that it may have ended unseen. What waits while a callback of something
    /// else runs may be taken behind it.
    pub(crate) fn called_back(&self, ledger: &Ledger) -> Result<Option<bool>, LedgerError> {
        let (in_hand, waiting) = (self.in_hand(ledger)?, self.waiting(ledger)?);
        let known = match (in_hand > 0, self.reports_calls()) {
            (true, true) => Some(false),
            (true, false) => (!self.is_stuck(ledger)?).then_some(false),
            (false, true) if waiting == 0 && self.is_level(ledger)? => Some(true),
            (false, _) => None,
        };
        let behind = known.is_none() && waiting > 0 && self.calls_something(ledger)?;
        Ok(if behind { Some(false) } else { known })
    }

    /// Whether each of its subscriptions has as many. Where one lacks something of the lead-in, the least of
    /// all that they have is not the least that they have of the window.
    fn is_level(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        self.counted.as_ref().map_or(Ok(true), |counted| counted.are_level(ledger))
    }

    /// What it may be that keeps it from taking anything, as a clause.
    pub(crate) fn why_it_takes_nothing(
        &self,
        ledger: &Ledger,
    ) -> Result<&'static str, LedgerError> {
        if self.in_hand(ledger)? > 0 || self.calls_something(ledger)? {
            return Ok(HANGS);
        }
        let best_effort = self.counted.as_ref().is_some_and(Subscriptions::may_lose);
        Ok(if best_effort { LOST_OR_IDLE } else { IDLE })
    }

    /// Whether a callback is seen to run in its process.
    fn calls_something(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let Some(process) = self.counted.as_ref().map(|counted| counted.process) else {
            return Ok(false);
        };
        let own = ledger.processes()?.into_iter().find(|one| one.id == process && one.alive);
        if own.is_none_or(|one| one.others_started > one.others_ended) {
            return Ok(own.is_some());
        }
        let of_it = |one: &Endpoint| one.process == process && one.strength == Strength::Called;
        let runs = |one: &Endpoint| {
            let Counts { started, ended, intra_started, intra_ended, .. } = one.counts;
            started > ended || intra_started > intra_ended
        };
        Ok(ledger.endpoints()?.iter().any(|one| of_it(one) && runs(one)))
    }
}
