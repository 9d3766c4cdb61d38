//! The subscriptions of a topic that one node has, and what they have taken of what is played.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{PoisonError, RwLock};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{
    Endpoint, EndpointId, Ledger, LedgerError, ProcessId, Qos, Reliability, Strength,
};

use crate::absence::{Absence, RENEWED};
use crate::qos::{depth, given_again, keeps, reaches};
use crate::succession::{Left, is_clear, never_comes};
use crate::taken::Taken;

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
    /// Those that are gone, and whose place none has taken yet.
    left: BTreeMap<EndpointId, Left>,
    /// What each had taken of ours when none was left.
    reached: u64,
    /// What those that are gone have taken, whoever published it.
    before: Taken,
    /// What was overwritten in their queues, and nobody will take any more.
    lost: u64,
    /// What they had taken, whoever published it, when what waited for them was given up last.
    written_off: Option<u64>,
    /// How often that was.
    write_offs: u32,
    /// What each asks for.
    wanted: Vec<Qos>,
    /// The weakest of them.
    strength: Strength,
    /// Whether one went for good while others stayed, so that one that comes may have been away.
    deserted: bool,
    /// Whether one came or went whose messages can't be separated from another's.
    confused: bool,
    /// Whether one was given what is kept, of which a message's publisher has to be known.
    given_kept: bool,
}

/// A subscription.
#[derive(Clone, Copy, Debug)]
struct Counted {
    id: EndpointId,
    wanted: Qos,
    /// Whether it came after we had published, and took no other's place.
    late: bool,
    /// What it had taken of which nothing counts here.
    before: Taken,
    /// Messages of ours that count as taken besides: by the one whose place it took, or those that went out
    /// before it was there.
    begun_with: u64,
    /// Those that lay in the queue of the one whose place it took, and never come.
    never: u64,
    /// Whether it is late, and nothing was sent to it yet.
    is_new: bool,
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
            let (wanted, late) = (one.qos, one.late);
            Ok(Counted { id: one.id, wanted, late, before, begun_with: 0, never: 0, is_new: false })
        };
        Ok(Some(Subscriptions {
            process,
            known,
            now: RwLock::new(Now {
                counted: subscriptions.iter().map(counted).collect::<Result<_, LedgerError>>()?,
                left: BTreeMap::new(),
                reached: 0,
                before: Taken::default(),
                lost: 0,
                written_off: None,
                write_offs: 0,
                wanted: wanted(subscriptions),
                strength: weakest(subscriptions).unwrap_or(Strength::Taken),
                deserted: false,
                confused: false,
                given_kept: subscriptions.iter().any(|one| one.late && keeps(&one.qos)),
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

    /// What each has taken of ours, with what it began with.
    fn of_ours(&self, now: &Now, ledger: &Ledger) -> Result<Vec<u64>, LedgerError> {
        let ours = |(taken, one): (&Taken, &Counted)| taken.ours() + one.begun_with;
        Ok(self.each(now, ledger)?.iter().zip(&now.counted).map(ours).collect())
    }

    /// The least of that.
    fn least(&self, now: &Now, ledger: &Ledger) -> Result<u64, LedgerError> {
        Ok(self.of_ours(now, ledger)?.into_iter().min().unwrap_or(now.reached))
    }

    /// Whether each has taken as many of ours.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn are_level(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let ours = self.of_ours(&now, ledger)?;
        Ok(ours.windows(2).all(|two| two[0] == two[1]))
    }

    /// Whether these are still all that there are.
    pub(crate) fn are(&self, subscriptions: &[&Endpoint]) -> bool {
        let ids = subscriptions.iter().map(|one| one.id);
        self.of_now(|now| now.counted.iter().map(|known| known.id).eq(ids.clone()))
    }

    /// Takes in that these are there in place of those before, to whom so many were sent: one that
    /// stays goes on to count, and one that is new goes on where the one was whose place it takes, and is
    /// given again what is `kept`, so many at the most.
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
        now.reached = self.least(&now, ledger)?;
        let gone = self.leave(&mut now, subscriptions, sent, ledger)?;
        if now.counted.is_empty() {
            now.lost = 0;
        }
        let mut counted: Vec<Counted> = Vec::new();
        for one in subscriptions {
            counted.push(match now.counted.iter().find(|known| known.id == one.id) {
                Some(stays) => *stays,
                None => {
                    now.given_kept |= keeps(&one.qos);
                    now.confused |= sent > 0 && !is_clear(&now.left, one);
                    let others = !now.counted.is_empty();
                    let (came, in_a_place) = come(&mut now, one, sent, kept);
                    now.confused |= sent > 0 && others && now.deserted && !in_a_place;
                    came
                }
            });
        }
        // What lay in the queue of one that goes may have come to one that was created before it went.
        now.confused |= sent > 0 && gone && counted.iter().any(|one| one.late);
        now.counted = counted;
        now.wanted = wanted(subscriptions);
        Ok(())
    }

    /// Takes in which of them are gone, and returns whether any is.
    fn leave(
        &self,
        now: &mut Now,
        subscriptions: &[&Endpoint],
        sent: u64,
        ledger: &Ledger,
    ) -> Result<bool, LedgerError> {
        let is_there = |id| subscriptions.iter().any(|one| one.id == id);
        let (stay, gone): (Vec<Counted>, Vec<Counted>) =
            now.counted.drain(..).partition(|one| is_there(one.id));
        let any = !gone.is_empty();
        for one in gone {
            let since = Taken::of(&ledger.counts(one.id)?, self.known).since(one.before);
            now.before.all += since.all;
            now.before.unclear += since.unclear;
            let (taken, latest) = (one.begun_with + since.ours(), ledger.latest(one.id)?);
            let (wanted, away) = (one.wanted, Absence::begin(Instant::now()));
            now.left.insert(one.id, Left { taken, latest, sent, wanted, away });
        }
        now.counted = stay;
        Ok(any)
    }

    /// Takes in that somebody looks at this moment: who takes no place for a while takes none any more. Of
    /// the time since the look before at `most` so much counts.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn look(
        &self,
        at: Instant,
        most: Duration,
        ledger: &Ledger,
    ) -> Result<(), LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        let mut gone = Vec::new();
        let Now { left, counted, deserted, confused, .. } = &mut *now;
        left.retain(|id, left| {
            let stays = left.away.look(at, most) < RENEWED;
            gone.extend((!stays).then_some(*id));
            // What it lacks of what was sent to it is in no other's count.
            *confused |= !stays && left.sent > left.taken && !counted.is_empty();
            *deserted |= !stays && !counted.is_empty();
            stays
        });
        gone.into_iter().try_for_each(|id| ledger.end(id))
    }

    /// What is sent from now on goes to all that are there: late ones count from here.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn begin(&self, ledger: &Ledger) -> Result<(), LedgerError> {
        let mut now = self.now.write().unwrap_or_else(PoisonError::into_inner);
        for one in now.counted.iter_mut().filter(|one| one.is_new) {
            one.before = Taken::of(&ledger.counts(one.id)?, self.known);
            one.is_new = false;
        }
        Ok(())
    }

    /// Takes in how far they prove what they take, which a subscription shows when it is complete.
    pub(crate) fn note_strength(&self, subscriptions: &[&Endpoint]) {
        if let Some(weakest) = weakest(subscriptions) {
            self.now.write().unwrap_or_else(PoisonError::into_inner).strength = weakest;
        }
    }

    /// The same of those that count, by what the ledger has by now.
    pub(crate) fn note_strength_in(&self, endpoints: &[Endpoint]) {
        let counts = |id| self.of_now(|now| now.counted.iter().any(|one| one.id == id));
        let those: Vec<&Endpoint> = endpoints.iter().filter(|one| counts(one.id)).collect();
        self.note_strength(&those);
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

    /// Whether one came or went so that what each has taken can't be known: in nobody's place for certain,
    /// or given what is kept by a middleware that does not say whose it is.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn are_confused(&self, ledger: &Ledger) -> Result<bool, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        let mut each = self.each(&now, ledger)?.into_iter().chain([now.before]);
        // Of one that went of late nobody has looked yet whether another takes its place.
        let lacks = !now.counted.is_empty() && now.left.values().any(|left| left.sent > left.taken);
        Ok(now.confused || lacks || (now.given_kept && each.any(|one| one.unclear > 0)))
    }

    /// Messages of ours that each of them has taken.
    ///
    /// # Errors
    /// The ledger can't be read.
    pub(crate) fn taken(&self, ledger: &Ledger) -> Result<u64, LedgerError> {
        let now = self.now.read().unwrap_or_else(PoisonError::into_inner);
        self.least(&now, ledger)
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
        let each = ours.iter().zip(&now.counted);
        let left = each.map(|(ours, one)| sent.saturating_sub(ours + one.never)).max().unwrap_or(0);
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

    /// Whether one of them asks for best effort, of which what is lost on its way does not come again.
    pub(crate) fn may_lose(&self) -> bool {
        self.of_now(|now| now.wanted.iter().any(|one| one.reliability == Reliability::BestEffort))
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

/// A subscription that comes when so many were `sent` to its node, of which so many are `kept`: it takes the
/// place of one that is gone, if it does. To one that takes none, nothing was sent yet.
fn come(now: &mut Now, subscription: &Endpoint, sent: u64, kept: u64) -> (Counted, bool) {
    let is_replaced = |left: &Left| !subscription.late && left.latest == subscription.after;
    let replaced = now.left.iter().find(|(_, left)| is_replaced(left)).map(|(id, _)| *id);
    let in_a_place = replaced.is_some();
    let (begun_with, never) = match replaced.and_then(|id| now.left.remove(&id)) {
        Some(left) => {
            let again = kept.min(given_again(&subscription.qos));
            (left.taken, never_comes(left.taken, (sent, again), now.lost))
        }
        None if now.counted.is_empty() => (now.reached, sent.saturating_sub(now.reached)),
        None => (sent, 0),
    };
    let came = Counted {
        id: subscription.id,
        wanted: subscription.qos,
        late: subscription.late,
        before: Taken::default(),
        begun_with,
        never,
        is_new: subscription.late,
    };
    (came, in_a_place)
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
