//! The subscriptions of a topic that one node has, and what they have taken of what is played.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use bagpipe_ros2ledger::{
    Counts, Durability, Endpoint, EndpointId, History, Ledger, LedgerError, ProcessId, Qos,
    Reliability, Strength,
};

use crate::qos::reaches;

/// The most messages that may wait for a node to take them, however deep its queue.
pub(crate) const MOST_WAITING: u64 = 1000;

/// How long a message is waited for that may have been lost beside a publisher of the stack, while the
/// node takes others; and how often that is halved.
const UNKNOWN: Duration = Duration::from_secs(1);
const HALVED: u32 = 6;

/// The subscriptions of one node.
#[derive(Debug)]
pub(crate) struct Subscriptions {
    pub(crate) process: ProcessId,
    /// Whether our publisher is known by what comes with its messages.
    known: bool,
    now: RwLock<Now>,
    /// Whether the stack has a publisher of the topic that reaches one of them, or had one.
    shared: AtomicBool,
    /// Whether such a one has published.
    published: AtomicBool,
}

/// Those that are there now.
#[derive(Debug)]
struct Now {
    counted: Vec<Counted>,
    /// What each of a node's had taken of ours when there were others of them last.
    earlier: u64,
    /// What all had taken by then, whoever published it.
    before: Taken,
    /// What went out to those before them or was overwritten in their queues, and nobody will take any
    /// more.
    lost: u64,
    /// What they had taken, whoever published it, when what waited for them was given up last.
    written_off: Option<u64>,
    /// How often that was.
    write_offs: u32,
    /// Those before them, while there are none.
    left: Vec<EndpointId>,
    /// What each asks for.
    wanted: Vec<Qos>,
    /// The weakest of them.
    strength: Strength,
}

/// What a subscription has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Taken {
    /// Whoever published it.
    all: u64,
    /// Of which it is known that it was ours.
    own: u64,
    /// Of which it is not known whose it was.
    unclear: u64,
}

impl Taken {
    fn of(counts: &Counts, known: bool) -> Taken {
        let Counts { taken: all, taken_own: own, taken_unknown: unclear, .. } = *counts;
        match known {
            true => Taken { all, own, unclear },
            false => Taken { all, own: 0, unclear: all },
        }
    }

    fn since(self, before: Taken) -> Taken {
        Taken {
            all: self.all.saturating_sub(before.all),
            own: self.own.saturating_sub(before.own),
            unclear: self.unclear.saturating_sub(before.unclear),
        }
    }

    /// Messages of ours. A middleware that says of none whose it is gives ours like all others; one that
    /// says it of some says it of ours, as our publisher is there.
    fn ours(self) -> u64 {
        if self.unclear == self.all { self.all } else { self.own }
    }

    /// Whether others' may be among them, beside somebody who has `published`; or where somebody was there
    /// whom nobody has seen.
    fn is_unclear(self, published: bool) -> bool {
        self.unclear > 0 && (published || self.unclear < self.all)
    }
}

/// A subscription.
#[derive(Clone, Copy, Debug)]
struct Counted {
    id: EndpointId,
    /// What it had taken of which nothing counts here.
    before: Taken,
    /// Messages of ours that count as taken: those that it was ahead of the slowest of its node, or that
    /// went out before it was there.
    spared: u64,
    /// Those that lay in the queue of the one whose place it took, and never come.
    never: u64,
}

impl Counted {
    /// One that has taken nothing yet.
    fn new(id: EndpointId) -> Counted {
        Counted { id, before: Taken::default(), spared: 0, never: 0 }
    }
}

impl Subscriptions {
    /// Of the subscriptions of one node, counted from now, or `at_once`: from when they were there, as
    /// what has gone out to them since counts as well. `known`: our publisher is.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn new(
        subscriptions: &[&Endpoint],
        ledger: &Ledger,
        (known, at_once): (bool, bool),
    ) -> Result<Option<Self>, LedgerError> {
        let Some(process) = subscriptions.first().map(|one| one.process) else { return Ok(None) };
        let counted = |one: &&Endpoint| {
            let before = match at_once {
                true => Taken::default(),
                false => Taken::of(&ledger.counts(one.id)?, known),
            };
            Ok(Counted { before, ..Counted::new(one.id) })
        };
        Ok(Some(Subscriptions {
            process,
            known,
            now: RwLock::new(Now {
                counted: subscriptions.iter().map(counted).collect::<Result<_, LedgerError>>()?,
                earlier: 0,
                before: Taken::default(),
                lost: 0,
                written_off: None,
                write_offs: 0,
                left: Vec::new(),
                wanted: wanted(subscriptions),
                strength: weakest(subscriptions).unwrap_or(Strength::Taken),
            }),
            shared: AtomicBool::new(false),
            published: AtomicBool::new(false),
        }))
    }

    fn of_now<T>(&self, read: impl Fn(&Now) -> T) -> T {
        read(&self.now.read().unwrap_or_else(PoisonError::into_inner))
    }

    /// What each of them has taken since it was counted.
    fn each(&self, now: &Now, ledger: &Ledger) -> Result<Vec<Taken>, LedgerError> {
        let since =
            |one: &Counted| Ok(Taken::of(&ledger.counts(one.id)?, self.known).since(one.before));
        now.counted.iter().map(since).collect()
    }

    /// What each has taken of ours, with what it is spared.
    fn of_ours(&self, now: &Now, ledger: &Ledger) -> Result<Vec<u64>, LedgerError> {
        let each = self.each(now, ledger)?;
        Ok(each.iter().zip(&now.counted).map(|(taken, one)| taken.ours() + one.spared).collect())
    }

    /// The least of that.
    fn least(&self, now: &Now, ledger: &Ledger) -> Result<u64, LedgerError> {
        Ok(self.of_ours(now, ledger)?.into_iter().min().unwrap_or(0))
    }

    /// Whether these are still all that there are.
    pub(crate) fn are(&self, subscriptions: &[&Endpoint]) -> bool {
        let ids = subscriptions.iter().map(|one| one.id);
        self.of_now(|now| now.counted.iter().map(|known| known.id).eq(ids.clone()))
    }

    /// Takes in that these are there in place of those before, to whom so many were sent: one that
    /// stays goes on to count, and one that is new has taken nothing yet. Who comes late is given so many
    /// that are `kept`.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn replace(
        &self,
        subscriptions: &[&Endpoint],
        (sent, kept): (u64, u64),
        ledger: &Ledger,
    ) -> Result<(), LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        let before = self.leave(&mut now, ledger)?;
        let waits = sent.saturating_sub(now.earlier);
        let some_stay = subscriptions.iter().any(|one| before.contains_key(&one.id));
        let waits = if some_stay { waits.saturating_sub(now.lost) } else { waits };
        let counted = |one: &&Endpoint| match before.get(&one.id) {
            Some((stays, _)) => *stays,
            None => {
                let replaced = before.values().filter(|(_, latest)| *latest == one.after);
                let ahead = replaced.map(|(replaced, _)| replaced.spared).max();
                let again = if one.late { 0 } else { kept.min(given_again(&one.qos)) };
                let (spared, never) = comes(ahead, some_stay, waits, again);
                Counted { spared, never, ..Counted::new(one.id) }
            }
        };
        now.counted = subscriptions.iter().map(counted).collect();
        if !some_stay {
            // What is given to none of them again is lost.
            let never = now.counted.iter_mut().map(|one| std::mem::take(&mut one.never));
            now.lost = never.max().unwrap_or(waits);
        }
        now.left = if subscriptions.is_empty() { before.into_keys().collect() } else { Vec::new() };
        now.wanted = wanted(subscriptions);
        Ok(())
    }

    /// Counts what they have taken by now as taken before others: each as it goes on from here if it stays,
    /// and the latest stamp of what it has taken.
    fn leave(
        &self,
        now: &mut Now,
        ledger: &Ledger,
    ) -> Result<BTreeMap<EndpointId, (Counted, i64)>, LedgerError> {
        let least = self.least(now, ledger)?;
        let mut before = BTreeMap::new();
        for one in &now.counted {
            let counts = Taken::of(&ledger.counts(one.id)?, self.known);
            let since = counts.since(one.before);
            now.before.all += since.all;
            now.before.unclear += since.unclear;
            let spared = (since.ours() + one.spared).saturating_sub(least);
            let goes_on = Counted { before: counts, spared, ..*one };
            before.insert(one.id, (goes_on, ledger.latest(one.id)?));
        }
        now.earlier += least;
        Ok(before)
    }

    /// Nobody takes the place of those that there were last.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn end(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        self.of_now(|now| now.left.iter().try_for_each(|id| ledger.end(*id)))
    }

    /// Takes in how far they prove what they take, which a subscription shows when it is complete.
    pub(crate) fn note_strength(&self, subscriptions: &[&Endpoint]) {
        if let Some(weakest) = weakest(subscriptions) {
            self.now.write().unwrap_or_else(PoisonError::into_inner).strength = weakest;
        }
    }

    /// Takes in which publishers of the topic the stack has by now, and whether there are `uncounted` ones,
    /// of which it is not known what they reach.
    pub(crate) fn learn(&self, publishers: &[&Endpoint], uncounted: bool) {
        self.shared.fetch_or(uncounted, Ordering::Relaxed);
        self.published.fetch_or(uncounted, Ordering::Relaxed);
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let reaches = |one: &&&Endpoint| now.wanted.iter().any(|wanted| reaches(&one.qos, wanted));
        for one in publishers.iter().filter(reaches) {
            self.shared.store(true, Ordering::Relaxed);
            self.published.fetch_or(one.counts.offered > 0, Ordering::Relaxed);
        }
    }

    /// Whether the stack publishes the topic beside us, or has done so.
    pub(crate) fn are_shared(&self) -> bool {
        self.shared.load(Ordering::Relaxed)
    }

    /// Whether of what they took of ours some may be what the stack has published.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn are_mixed(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let published = self.published.load(Ordering::Relaxed);
        let mut each = self.each(&now, ledger)?.into_iter().chain([now.before]);
        Ok(each.any(|one| one.is_unclear(published)))
    }

    /// Messages of ours that each of them has taken.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        Ok(now.earlier + self.least(&now, ledger)?)
    }

    /// Messages that they have taken in all, whoever published them.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn taken_of_all(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let there: u64 = self.each(&now, ledger)?.iter().map(|one| one.all).sum();
        Ok(now.before.all + there)
    }

    /// Messages that wait for the slowest of them, of so many that were sent. What was written off and has
    /// been taken after all is written off no more.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn waiting(&self, sent: u64, ledger: &Ledger) -> Result<u64, LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        let ours = self.of_ours(&now, ledger)?;
        let sent = sent.saturating_sub(now.earlier);
        let each = ours.iter().zip(&now.counted);
        let left = each.map(|(ours, one)| sent.saturating_sub(ours + one.never)).max();
        let left = left.unwrap_or(sent);
        now.lost = now.lost.min(left);
        Ok(left - now.lost)
    }

    /// Waits for none of so many any more that wait: beside another publisher they were overwritten. Of
    /// who has taken nothing since the last time it is not believed again, when `all` had been taken.
    /// Whether they were given up.
    pub(crate) fn write_off(&self, waiting: u64, all: u64) -> bool {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        if waiting == 0 || !self.are_shared() || now.written_off == Some(all) {
            return false;
        }
        (now.lost, now.written_off) = (now.lost + waiting, Some(all));
        now.write_offs += 1;
        true
    }

    /// How long a message is waited for that may have been overwritten by what the stack publishes, and
    /// how many are taken after it by then; `None` where nobody else publishes.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn patience(&self, ledger: &Ledger) -> Result<Option<(Duration, u64)>, LedgerError> {
        if !self.are_shared() {
            return Ok(None);
        }
        // Of who has taken a whole queue by each, ours is no more in it.
        let queues = |now: &Now| {
            let deepest = now.wanted.iter().map(|one| depth(one).unwrap_or(u64::MAX)).max();
            deepest.unwrap_or(0).saturating_mul(now.counted.len() as u64)
        };
        let others = if self.are_mixed(ledger)? { 1 } else { self.of_now(queues) };
        Ok(Some((patience(self.of_now(|now| now.write_offs)), others)))
    }

    /// Has nobody be woken before each of them has taken so many more.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn wake_after(&self, ledger: &Ledger, messages: u64) -> Result<(), LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let ours = self.of_ours(&now, ledger)?;
        let least = ours.iter().copied().min().unwrap_or(0);
        for (one, ours) in now.counted.iter().zip(ours) {
            // Who is ahead of the slowest is not waited for as long.
            let more = messages.saturating_sub(ours - least);
            ledger.wake_from(one.id, ledger.counts(one.id)?.taken.saturating_add(more))?;
        }
        Ok(())
    }

    /// Messages that they have taken, and those that they have done with.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn begun_and_done(&self, ledger: &Ledger) -> Result<(u64, u64), LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let (mut begun, mut done) = (0_u64, 0_u64);
        for one in &now.counted {
            let counts = ledger.counts(one.id)?;
            // What nodes count may be any number.
            begun = begun.saturating_add(counts.taken).saturating_add(counts.intra_started);
            done = done.saturating_add(counts.done(now.strength));
        }
        Ok((begun, done))
    }

    /// Messages that the smallest of their queues holds, as far as so many may wait.
    pub(crate) fn depth(&self) -> u64 {
        self.of_now(|now| now.wanted.iter().filter_map(depth).fold(MOST_WAITING, u64::min))
    }

    /// What the weakest of them proves.
    pub(crate) fn strength(&self) -> Strength {
        self.of_now(|now| now.strength)
    }
}

/// How long a message is waited for that may be lost, after so many that were: each time half as long, so
/// that a recording does not wait a second for each of its messages.
fn patience(write_offs: u32) -> Duration {
    UNKNOWN / (1 << write_offs.min(HALVED))
}

fn wanted(subscriptions: &[&Endpoint]) -> Vec<Qos> {
    subscriptions.iter().map(|one| one.qos).collect()
}

fn weakest(subscriptions: &[&Endpoint]) -> Option<Strength> {
    subscriptions.iter().map(|one| one.strength).min()
}

/// Messages that a subscription's queue holds; `None` without a bound.
fn depth(wanted: &Qos) -> Option<u64> {
    match wanted.history {
        History::KeepLast => Some(wanted.depth.max(1)),
        History::KeepAll | History::Other(_) => None,
    }
}

/// What a new subscription is spared, and what never comes to it, when so many wait for the slowest before it,
/// and it is given so many of them again. It goes on where the one was whose place it takes, so far `ahead`
/// of the slowest. Beside others, what waits for them was never sent to one that takes no place.
fn comes(ahead: Option<u64>, some_stay: bool, waits: u64, again: u64) -> (u64, u64) {
    match ahead {
        None if some_stay => (waits.saturating_sub(again), 0),
        _ => {
            let spared = ahead.unwrap_or(0);
            (spared, waits.saturating_sub(spared + again))
        }
    }
}

/// How many a subscription takes at the most of those that are kept, in the place of one before it: none,
/// where it does not confirm what it has.
fn given_again(wanted: &Qos) -> u64 {
    match (wanted.durability, wanted.reliability) {
        (Durability::TransientLocal, Reliability::Reliable) => depth(wanted).unwrap_or(u64::MAX),
        _ => 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_takes_another_s_place_goes_on_where_that_was_and_who_takes_none_is_spared_what_waits() {
        let (waits, again) = (7, 4);
        assert_eq!(comes(Some(2), true, waits, again), (2, 1));
        assert_eq!(comes(Some(2), false, waits, again), (2, 1));
        assert_eq!(comes(Some(2), true, waits, 50), (2, 0));
        assert_eq!(comes(Some(0), true, waits, 0), (0, 7));
        assert_eq!(comes(None, false, waits, again), (0, 3));
        assert_eq!(comes(None, true, waits, 0), (7, 0));
        assert_eq!(comes(None, true, waits, again), (3, 0));
    }

    #[test]
    fn a_thousand_messages_that_are_none_are_waited_for_17_s_in_all() {
        let each: Vec<Duration> = (0..1000).map(patience).collect();
        let s = |seconds: f64| Duration::from_secs_f64(seconds);
        assert_eq!(each[..8], [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125, 0.015625, 0.015625].map(s));
        assert_eq!(each.iter().sum::<Duration>(), s(17.5));
    }
}
