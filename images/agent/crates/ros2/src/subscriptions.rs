//! The subscriptions of a topic that one node has, and what they have taken of what is played.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{PoisonError, RwLock};
use std::time::Duration;

use bagpipe_ros2ledger::{
    Counts, Endpoint, EndpointId, History, Ledger, LedgerError, ProcessId, Qos, Strength,
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
    /// Each with what it had taken of which nothing counts here.
    taken: Vec<(EndpointId, Taken)>,
    /// What those before them have taken.
    earlier: u64,
    /// Whether of some of that it is not known whose it was.
    unclear: bool,
    /// What went out to those before them or was overwritten in their queues, and nobody will take any
    /// more.
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
}

/// What a subscription has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Taken {
    /// Whoever published it.
    all: u64,
    /// Of ours, and what may have been.
    ours: u64,
    /// Of which it is not known whose it was.
    unclear: u64,
}

impl Taken {
    fn of(counts: &Counts, known: bool) -> Taken {
        let Counts { taken: all, taken_own, taken_unknown: unclear, .. } = *counts;
        match known {
            true => Taken { all, ours: taken_own + unclear, unclear },
            false => Taken { all, ours: all, unclear: all },
        }
    }

    fn since(self, before: Taken) -> Taken {
        Taken {
            all: self.all.saturating_sub(before.all),
            ours: self.ours.saturating_sub(before.ours),
            unclear: self.unclear.saturating_sub(before.unclear),
        }
    }
}

impl Subscriptions {
    /// Of the subscriptions of one node, counted from now, or, where they are new to what has `begun` to
    /// be played, from their beginning. `known`: our publisher is.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn new(
        subscriptions: &[&Endpoint],
        ledger: &Ledger,
        (known, begun): (bool, bool),
    ) -> Result<Option<Self>, LedgerError> {
        let Some(process) = subscriptions.first().map(|one| one.process) else { return Ok(None) };
        let before = |one: &&Endpoint| match begun {
            true => Ok((one.id, Taken::default())),
            false => Ok((one.id, Taken::of(&ledger.counts(one.id)?, known))),
        };
        Ok(Some(Subscriptions {
            process,
            known,
            now: RwLock::new(Now {
                taken: subscriptions.iter().map(before).collect::<Result<_, LedgerError>>()?,
                earlier: 0,
                unclear: false,
                lost: 0,
                written_off: None,
                write_offs: 0,
                wanted: wanted(subscriptions),
                depth: depth(subscriptions),
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
        let since = |(id, before): &(EndpointId, Taken)| {
            Ok(Taken::of(&ledger.counts(*id)?, self.known).since(*before))
        };
        now.taken.iter().map(since).collect()
    }

    fn least(
        &self,
        now: &Now,
        ledger: &Ledger,
        of: impl Fn(&Taken) -> u64,
    ) -> Result<u64, LedgerError> {
        Ok(self.each(now, ledger)?.iter().map(of).min().unwrap_or(0))
    }

    /// Whether these are still all that there are.
    pub(crate) fn are(&self, subscriptions: &[&Endpoint]) -> bool {
        let ids = subscriptions.iter().map(|one| one.id);
        self.of_now(|now| now.taken.iter().map(|known| known.0).eq(ids.clone()))
    }

    /// Takes in that these are there in place of those before, to whom so many were sent: one that
    /// stays goes on to count, and one that is new has taken nothing yet.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn replace(
        &self,
        subscriptions: &[&Endpoint],
        sent: u64,
        ledger: &Ledger,
    ) -> Result<(), LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        let each = self.each(&now, ledger)?;
        let least = each.iter().map(|one| one.ours).min().unwrap_or(0);
        now.unclear |= each.iter().any(|one| one.unclear > 0);
        let before: BTreeMap<EndpointId, Taken> = now.taken.iter().copied().collect();
        let known = |one: &&Endpoint| {
            let mut taken = before.get(&one.id).copied().unwrap_or_default();
            if before.contains_key(&one.id) {
                taken.ours += least;
                taken.all += least;
            }
            (one.id, taken)
        };
        now.earlier += least;
        if !subscriptions.iter().any(|one| before.contains_key(&one.id)) {
            now.lost = sent.saturating_sub(now.earlier);
        }
        now.taken = subscriptions.iter().map(known).collect();
        now.wanted = wanted(subscriptions);
        now.depth = depth(subscriptions);
        Ok(())
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
        let reaches = |one: &&&Endpoint| {
            self.of_now(|now| now.wanted.iter().any(|wanted| reaches(&one.qos, wanted)))
        };
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
        let unclear = now.unclear || self.each(&now, ledger)?.iter().any(|one| one.unclear > 0);
        Ok(unclear && self.published.load(Ordering::Relaxed))
    }

    /// Messages of ours that each of them has taken.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        Ok(now.earlier + self.least(&now, ledger, |one| one.ours)?)
    }

    /// Messages that each of them has taken, whoever published them.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn taken_of_all(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        Ok(now.earlier + self.least(&now, ledger, |one| one.all)?)
    }

    /// What went out and is not waited for any more.
    pub(crate) fn lost(&self) -> u64 {
        self.of_now(|now| now.lost)
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
        let (write_offs, depth) = self.of_now(|now| (now.write_offs, now.depth));
        // Of who has taken a whole queue since, ours is no more in it.
        let others = if self.are_mixed(ledger)? { 1 } else { depth };
        Ok(Some((patience(write_offs), others)))
    }

    /// Has nobody be woken before each of them has taken so many more than the slowest.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn wake_after(&self, ledger: &Ledger, messages: u64) -> Result<(), LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        // What nodes count may be any number.
        let more = self.least(&now, ledger, |one| one.all)?.saturating_add(messages);
        let wake = |(id, before): &(EndpointId, Taken)| {
            ledger.wake_from(*id, before.all.saturating_add(more))
        };
        now.taken.iter().try_for_each(wake)
    }

    /// Messages that they have taken and not done with.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn in_hand(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let in_hand = |counts: Counts| counts.in_hand(now.strength);
        now.taken.iter().map(|(id, _)| Ok(in_hand(ledger.counts(*id)?))).sum()
    }

    /// Messages that the smallest of their queues holds.
    pub(crate) fn depth(&self) -> u64 {
        self.of_now(|now| now.depth)
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

fn depth(subscriptions: &[&Endpoint]) -> u64 {
    let depth = |one: &&Endpoint| match one.qos.history {
        History::KeepLast => one.qos.depth.clamp(1, MOST_WAITING),
        History::KeepAll | History::Other(_) => MOST_WAITING,
    };
    subscriptions.iter().map(depth).min().unwrap_or(MOST_WAITING)
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
