//! One node's subscriptions of a topic that is played, and what it has done with the messages.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError, RwLock};
use std::time::{Duration, Instant};

use bagpipe_graph::{LinkState, Share};
use bagpipe_ros2ledger::{
    Counts, Endpoint, EndpointId, History, Ledger, LedgerError, ProcessId, Qos, Strength,
};

use crate::qos::reaches;

/// The most messages that may wait for a node to take them, however deep its queue.
pub(crate) const MOST_WAITING: u64 = 1000;

/// How long a message is waited for beside a publisher of the stack, once what a node has taken of ours
/// is not known any more, but takes; and how often that is halved.
const UNKNOWN: Duration = Duration::from_secs(1);
const HALVED: u32 = 6;

/// How long a callback is waited for whose end is not reported.
const UNSEEN: Duration = Duration::from_secs(5);

/// A subscribing node of a topic, in one process: also after it has left the topic, and come back.
#[derive(Debug)]
pub(crate) struct Link {
    id: u64,
    pub(crate) node: String,
    /// Distinguishes nodes of one name that are there at the same time.
    pub(crate) instance: u32,
    /// `None` where the node does not count, so that nothing is known of it.
    pub(crate) counted: Option<Subscriptions>,
    open: AtomicBool,
    sent: Mutex<Totals>,
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

/// The subscriptions of one node.
#[derive(Debug)]
pub(crate) struct Subscriptions {
    pub(crate) process: ProcessId,
    now: RwLock<Now>,
    /// The stack's own publishers of the topic, whose messages it takes too, with what they had
    /// published before.
    others: RwLock<BTreeMap<EndpointId, u64>>,
    mixed: AtomicBool,
    /// Whether some of the others came after we had begun to count. What such a one publishes before
    /// it and a subscription know each other is never taken.
    late: AtomicBool,
    /// Whether some of the others did not know all subscriptions when we began to count.
    unmet: AtomicBool,
}

/// How far a node's subscriptions and the stack's own publishers of a topic were when we began to
/// count.
#[derive(Debug)]
pub(crate) struct Baseline {
    /// What each subscription had taken of which nothing counts.
    pub(crate) taken: Vec<(EndpointId, u64)>,
    /// What each publisher had published.
    pub(crate) others: BTreeMap<EndpointId, u64>,
    /// Whether some of that may have been taken later: how much of what it takes is ours is not known.
    pub(crate) mixed: bool,
    /// Whether a publisher that is there did not know all subscriptions yet.
    pub(crate) unmet: bool,
}

/// Those that are there now.
#[derive(Debug)]
struct Now {
    /// Each with what it had taken of which nothing counts here.
    taken: Vec<(EndpointId, u64)>,
    /// What those before them have taken.
    earlier: u64,
    /// What went out to those before them and nobody will take any more.
    lost: u64,
    /// What they had taken, whoever published it, when what waited for them was given up last.
    written_off: Option<u64>,
    /// How often that was.
    write_offs: u32,
    /// What each asks for.
    wanted: Vec<Qos>,
    /// Messages that the smallest of their queues holds.
    depth: u64,
    /// The weakest of them.
    strength: Strength,
    /// Whether one is given what its own process publishes without a take.
    within: bool,
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
            lead_in: self.lead_in - before.lead_in,
            window: self.window - before.window,
            window_bytes: self.window_bytes - before.window_bytes,
        }
    }
}

impl Now {
    /// What each of them has taken at least.
    fn least(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let mut least = None;
        for (id, before) in &self.taken {
            let taken = ledger.counts(*id)?.taken.saturating_sub(*before);
            least = Some(least.map_or(taken, |least: u64| least.min(taken)));
        }
        Ok(least.unwrap_or(0))
    }
}

impl Subscriptions {
    /// Of the subscriptions of one node, counted from there.
    pub(crate) fn new(subscriptions: &[&Endpoint], baseline: Baseline) -> Option<Self> {
        let Baseline { taken, others, mixed, unmet } = baseline;
        Some(Subscriptions {
            process: subscriptions.first()?.process,
            now: RwLock::new(Now {
                taken,
                earlier: 0,
                lost: 0,
                written_off: None,
                write_offs: 0,
                wanted: wanted(subscriptions),
                depth: depth(subscriptions),
                strength: subscriptions.iter().map(|one| one.strength).min()?,
                within: subscriptions.iter().any(|one| one.intra_process),
            }),
            others: RwLock::new(others),
            mixed: AtomicBool::new(mixed),
            late: AtomicBool::new(false),
            unmet: AtomicBool::new(unmet),
        })
    }

    /// Counts from there instead, as nothing of ours has gone out.
    fn count_from(&self, baseline: Baseline) {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        (now.taken, now.earlier, now.lost) = (baseline.taken, 0, 0);
        *self.others.write().unwrap_or_else(PoisonError::into_inner) = baseline.others;
        self.mixed.store(baseline.mixed, Ordering::Relaxed);
        self.late.store(false, Ordering::Relaxed);
        self.unmet.store(baseline.unmet, Ordering::Relaxed);
    }

    /// Whether these are still all that there are.
    pub(crate) fn is_of(&self, subscriptions: &[&Endpoint]) -> bool {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        now.taken.iter().map(|known| known.0).eq(subscriptions.iter().map(|one| one.id))
    }

    /// Takes in that these are there in place of those before, to whom so many were sent: one that
    /// stays goes on to count, and one that is new has taken nothing but ours, or is given again what
    /// the stack's own publishers keep.
    fn replace(
        &self,
        subscriptions: &[&Endpoint],
        sent: u64,
        ledger: &Ledger,
    ) -> Result<(), LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        let least = now.least(ledger)?;
        let before: BTreeMap<EndpointId, u64> = now.taken.iter().copied().collect();
        if subscriptions.iter().any(|one| !before.contains_key(&one.id)) {
            let others = self.others.read().unwrap_or_else(PoisonError::into_inner);
            for id in others.keys() {
                let publishes = ledger.counts(*id)?.offered > 0;
                self.mixed.fetch_or(publishes, Ordering::Relaxed);
            }
        }
        let known =
            |one: &&Endpoint| (one.id, before.get(&one.id).map_or(0, |taken| taken + least));
        now.earlier += least;
        if !subscriptions.iter().any(|one| before.contains_key(&one.id)) {
            let ours = now.earlier.saturating_sub(self.of_others(ledger)?);
            now.lost = sent.saturating_sub(ours);
        }
        now.taken = subscriptions.iter().map(known).collect();
        now.wanted = wanted(subscriptions);
        now.depth = depth(subscriptions);
        Ok(())
    }

    /// What the stack's own publishers have published since we began to count.
    fn of_others(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let others = self.others.read().unwrap_or_else(PoisonError::into_inner);
        let of = |(id, before): (&EndpointId, &u64)| {
            Ok(ledger.counts(*id)?.offered.saturating_sub(*before))
        };
        others
            .iter()
            .map(of)
            .try_fold(0, |all: u64, of: Result<u64, LedgerError>| Ok(all.saturating_add(of?)))
    }

    /// Takes in how far they prove what they take, which a subscription shows when it is complete.
    fn note_strength(&self, subscriptions: &[&Endpoint]) {
        if let Some(weakest) = subscriptions.iter().map(|one| one.strength).min() {
            let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
            now.strength = weakest;
            now.within = subscriptions.iter().any(|one| one.intra_process);
        }
    }

    /// Takes in which publishers of the topic the stack has by now. Of one whose quality of service
    /// reaches none of them nothing is taken.
    fn learn(&self, publishers: &[&Endpoint]) {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let mut others = self.others.write().unwrap_or_else(PoisonError::into_inner);
        for one in publishers {
            let reached = now.wanted.iter().filter(|wanted| reaches(&one.qos, wanted)).count();
            if reached == 0 {
                continue;
            }
            self.late.fetch_or(!others.contains_key(&one.id), Ordering::Relaxed);
            let before = *others.entry(one.id).or_insert(0);
            // Its calls are counted, and nothing of it is taken by some.
            let within = now.within && one.process == self.process;
            let untaken = (within || reached < now.wanted.len()) && one.counts.offered > before;
            self.mixed.fetch_or(untaken, Ordering::Relaxed);
        }
    }
}

/// How long a message is waited for that may be none, after so many that were: each time half as long, so
/// that a recording does not wait a second for each of its messages.
fn patience(write_offs: u32) -> Duration {
    UNKNOWN / (1 << write_offs.min(HALVED))
}

fn wanted(subscriptions: &[&Endpoint]) -> Vec<Qos> {
    subscriptions.iter().map(|one| one.qos).collect()
}

fn depth(subscriptions: &[&Endpoint]) -> u64 {
    let depth = |one: &&Endpoint| match one.qos.history {
        History::KeepLast => one.qos.depth.clamp(1, MOST_WAITING),
        History::KeepAll | History::Other(_) => MOST_WAITING,
    };
    subscriptions.iter().map(depth).min().unwrap_or(MOST_WAITING)
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
        Link { id, node, instance, counted, open, sent, last }
    }

    /// Takes in which publishers of the topic the stack has by now. One that came later was not
    /// there to publish before.
    pub(crate) fn learn(&self, publishers: &[&Endpoint]) {
        if let Some(counted) = &self.counted {
            counted.learn(publishers);
        }
    }

    /// Takes in the node's subscriptions as they are now, and returns whether they are others.
    pub(crate) fn replace(
        &self,
        subscriptions: &[&Endpoint],
        ledger: &Ledger,
    ) -> Result<bool, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(false) };
        let others = !counted.is_of(subscriptions);
        if others {
            counted.replace(subscriptions, self.sent(), ledger)?;
        }
        counted.note_strength(subscriptions);
        Ok(others)
    }

    /// Whether it is of this node in this process.
    pub(crate) fn is_of(&self, (process, node): &(ProcessId, String)) -> bool {
        self.node == *node && self.counted.as_ref().is_some_and(|one| one.process == *process)
    }

    /// Whether what it takes of ours can't be distinguished from what it takes of the stack's own.
    pub(crate) fn is_mixed(&self) -> bool {
        self.counted.as_ref().is_some_and(|one| one.mixed.load(Ordering::Relaxed))
    }

    /// Whether somebody publishes the topic beside us, or has done so.
    pub(crate) fn is_shared(&self) -> bool {
        self.counted.as_ref().is_some_and(|one| {
            !one.others.read().unwrap_or_else(PoisonError::into_inner).is_empty()
        })
    }

    /// Whether somebody publishes the topic beside us who came after we had begun to count.
    pub(crate) fn is_beside_late(&self) -> bool {
        self.counted.as_ref().is_some_and(|one| one.late.load(Ordering::Relaxed))
    }

    /// Whether what seems to be lost of ours may be what somebody published who came late, or did not
    /// know the node yet.
    pub(crate) fn may_lack_another_s(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(false) };
        let may = self.is_beside_late() || counted.unmet.load(Ordering::Relaxed);
        Ok(may && self.taken(ledger)?.is_some_and(|taken| taken < self.sent()))
    }

    /// Messages that each of its subscriptions has taken, whoever published them.
    pub(crate) fn taken_of_all(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(0) };
        let now = counted.now.read().unwrap_or_else(PoisonError::into_inner);
        Ok(now.earlier + now.least(ledger)?)
    }

    /// Waits for nothing more of what went out by now: beside another publisher one of ours or of
    /// theirs was lost, and whether ours were taken can't be known. Whether something was given up: of
    /// who has taken nothing since the last time it is not believed again.
    pub(crate) fn write_off(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let (waiting, all) = (self.waiting(ledger)?, self.taken_of_all(ledger)?);
        let Some(counted) = self.counted.as_ref().filter(|_| waiting > 0) else { return Ok(false) };
        let mut now = counted.now.write().unwrap_or_else(PoisonError::into_inner);
        if !self.is_shared() || now.written_off == Some(all) {
            return Ok(false);
        }
        (now.lost, now.written_off) = (now.lost + waiting, Some(all));
        now.write_offs += 1;
        counted.mixed.store(true, Ordering::Relaxed);
        Ok(true)
    }

    /// How long a message is waited for at it, as long as it takes others, where what it has taken of
    /// ours is not known; `None` where it is.
    pub(crate) fn patience(&self) -> Option<Duration> {
        let write_offs = self.of_now(|now| now.write_offs).unwrap_or(0);
        self.is_mixed().then(|| patience(write_offs))
    }

    /// Counts from there instead, as nothing of ours has gone out.
    pub(crate) fn count_from(&self, baseline: Baseline) {
        if let Some(counted) = &self.counted {
            counted.count_from(baseline);
        }
    }

    /// Whether it is there, and nothing is known of it.
    pub(crate) fn is_uncounted(&self) -> bool {
        self.counted.is_none() && self.is_open()
    }

    /// Takes in that a message of so many bytes goes out.
    pub(crate) fn count(&self, share: Share, bytes: usize) {
        self.totals().add(share, bytes);
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

    /// Messages of ours that each of its subscriptions has taken; `None` where nobody counts. Of a
    /// topic that the stack publishes too, what it took of the others is taken off, as if it had lost
    /// none of them.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<Option<u64>, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(None) };
        let all = self.taken_of_all(ledger)?;
        Ok(Some(all.saturating_sub(counted.of_others(ledger)?)))
    }

    /// Messages that wait in the middleware or are on their way to it; 0 where nobody counts.
    pub(crate) fn waiting(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let Some(taken) = self.taken(ledger)? else { return Ok(0) };
        let lost = self.of_now(|now| now.lost).unwrap_or(0);
        Ok(self.sent().saturating_sub(taken + lost))
    }

    /// Has nobody be woken before each of its subscriptions has taken so many more than the slowest.
    pub(crate) fn wake_after(&self, ledger: &Ledger, messages: u64) -> Result<(), LedgerError> {
        let Some(counted) = &self.counted else { return Ok(()) };
        let now = counted.now.read().unwrap_or_else(PoisonError::into_inner);
        // What nodes count may be any number.
        let more = now.least(ledger)?.saturating_add(messages);
        let wake =
            |(id, before): &(EndpointId, u64)| ledger.wake_from(*id, before.saturating_add(more));
        now.taken.iter().try_for_each(wake)
    }

    /// Messages that it has taken and not done with.
    pub(crate) fn in_hand(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let Some(counted) = &self.counted else { return Ok(0) };
        let now = counted.now.read().unwrap_or_else(PoisonError::into_inner);
        let in_hand = |counts: Counts| counts.in_hand(now.strength);
        now.taken.iter().map(|(id, _)| Ok(in_hand(ledger.counts(*id)?))).sum()
    }

    /// Whether it has taken nothing more for `UNSEEN`, by which the thread of an executor with several
    /// may be back that does not take again. Once it was so, it is.
    fn is_stuck(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
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
        self.of_now(|now| now.depth).unwrap_or(MOST_WAITING)
    }

    fn of_now<T>(&self, read: impl Fn(&Now) -> T) -> Option<T> {
        let counted = self.counted.as_ref()?;
        Some(read(&counted.now.read().unwrap_or_else(PoisonError::into_inner)))
    }

    /// Whether its library reports when callbacks end.
    pub(crate) fn reports_calls(&self) -> bool {
        self.of_now(|now| now.strength) == Some(Strength::Called)
    }

    /// Whether the callbacks of all that was sent have ended; `None` where it can't be known, or
    /// something may have been lost. Of who does not report calls it is known that one runs, until
    /// that has taken so long that it may have ended unseen.
    pub(crate) fn called_back(&self, ledger: &Ledger) -> Result<Option<bool>, LedgerError> {
        if !self.reports_calls() {
            let in_hand = self.in_hand(ledger)? > 0;
            return Ok((in_hand && !self.is_stuck(ledger)?).then_some(false));
        }
        match (self.in_hand(ledger)?, self.waiting(ledger)?) {
            (0, 0) => Ok(Some(true)),
            (0, _) => Ok(None),
            _ => Ok(Some(false)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_messages_that_are_none_are_waited_for_17_s_in_all() {
        let each: Vec<Duration> = (0..1000).map(patience).collect();
        let s = |seconds: f64| Duration::from_secs_f64(seconds);
        assert_eq!(each[..8], [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625, 0.015625].map(s));
        assert_eq!(each.iter().sum::<Duration>(), s(17.5));
    }
}
