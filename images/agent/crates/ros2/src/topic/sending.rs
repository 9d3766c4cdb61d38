//! How a message goes out: once there is room for it, by whoever sets the pace.

use std::collections::BTreeMap;
use std::sync::atomic::Ordering;
use std::sync::{Arc, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{Cancelled, Outlet, PacedBy, SendError, Share, Waits};
use bagpipe_ros2ledger::{Event, Ledger, LedgerError, Waited};
use bagpipe_ros2player::{PlayerError, Staged};

use super::Topic;
use super::look::Look;
use crate::clock::source_now;
use crate::link::Link;

/// How often somebody who waits asks whether to give up.
const ASK: Duration = Duration::from_millis(20);
/// How long a node without tracepoints may take to come back for more, after it has taken all: of
/// several threads some never show it.
const COMES_BACK: Duration = Duration::from_millis(100);
/// How long half of a queue is waited for where there is room: no longer than a wait goes without a
/// look at the counts.
const HALF: Duration = Duration::from_millis(20);
/// So many times as long as for who has stopped is waited for who works off what others have published.
const AT_WORK: u32 = 10;
/// Bytes of a message whose copy takes longer than to ask for it beforehand.
const LARGE: usize = 64 << 10;

impl Topic {
    /// Waits until there is room for a message of so many bytes at each subscriber; at one that has
    /// none, until it has taken half of what waits, so that it wakes us once for many messages. One
    /// that takes some and then no more for a while gets the next one all the same: threads of an
    /// executor may all sleep although messages wait, until another one comes.
    fn await_room(&self, bytes: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        loop {
            let begun = Instant::now();
            let mut full: BTreeMap<u64, u64> = BTreeMap::new();
            let mut waits = Waits::default();
            let room = |link: &Link, ledger: &Ledger| {
                let waiting = link.waiting(ledger)?;
                let mut room = self.sent().has_room(waiting, self.room_at(link), bytes);
                if let Some(half) = full.get(&link.id()) {
                    room &= waiting <= *half || begun.elapsed() >= HALF;
                } else if !room {
                    full.insert(link.id(), waiting / 2);
                    link.wake_after(ledger, waiting - waiting / 2)?;
                }
                if !room {
                    waits.for_room(link.id(), Instant::now());
                }
                Ok(room)
            };
            let waited = self.wait(&[Event::Taken], room, cancelled);
            self.hold_up(waits);
            waited?;
            // Meanwhile one may have been replaced that had none.
            if !self.has_strangers() {
                return Ok(());
            }
            self.meet(cancelled)?;
        }
    }

    /// The most messages that may wait at a subscriber.
    pub(super) fn room_at(&self, link: &Link) -> u64 {
        // What another publishes when ours have filled a queue would overwrite one of them.
        let depth = if link.is_shared() { link.depth().div_ceil(2) } else { link.depth() };
        depth.min(self.means.most_waiting)
    }

    /// Takes in, once a wait is over, for whom it was.
    fn hold_up(&self, mut waits: Waits) {
        waits.end(Instant::now());
        for (id, time) in waits.into_all() {
            self.links().iter().filter(|link| link.id() == id).for_each(|link| link.hold_up(time));
        }
    }

    /// By the clock: a lead-in waits for its subscribers, as long as all of it may, so that a first
    /// callback that takes its time loses nothing of it. What is lost of a lead-in can't be separated
    /// from what is lost of the window: which messages a queue has overwritten is not known.
    fn await_first(&self, message: &[u8], cancelled: Cancelled<'_>) -> Result<(), SendError> {
        let mut patience = self.means.patience.lock().unwrap_or_else(PoisonError::into_inner);
        let begun = Instant::now();
        let mut over = || cancelled() || begun.elapsed() >= *patience;
        let waited = match patience.is_zero() {
            true => Ok(()),
            false => self.await_room(message.len() as u64, &mut over),
        };
        *patience = patience.saturating_sub(begun.elapsed());
        match waited {
            Err(SendError::Cancelled | SendError::Stalled { .. }) if !cancelled() => Ok(()),
            other => other,
        }
    }

    /// Copies a large message before there is room for it, so that its copy is none of the time in
    /// which nothing is under way.
    fn stage(&self, message: &[u8]) -> Result<Option<Staged>, SendError> {
        if message.len() < LARGE {
            return Ok(None);
        }
        self.means.player.stage(self.publisher, &[message]).map_err(|error| failed(&error))
    }

    /// Takes in that a message goes out; false where somebody has come meanwhile who is to be met first.
    fn count(&self, share: Share, bytes: usize) -> Result<bool, SendError> {
        // Whoever looks at the subscribers meanwhile waits, so that none has it twice.
        let mut looked = self.looked.lock().unwrap_or_else(PoisonError::into_inner);
        if self.has_strangers() {
            return Ok(false);
        }
        self.means.ledger.note_published();
        let by_the_clock = self.means.paced_by == PacedBy::Schedule;
        // Where nobody is new, nobody has missed what went out by now.
        if by_the_clock && self.listed.load(Ordering::Relaxed) == self.means.ledger.listed() {
            looked.counted = self.sent().totals;
            looked.handed = looked.counted;
            looked.handed.add(share, bytes);
            looked.handed_at = source_now();
        }
        for link in self.links().iter().filter(|link| link.is_open()) {
            link.count(share, bytes);
            link.note_taken(&self.means.ledger).map_err(|error| failed(&error))?;
        }
        self.sent().add(share, bytes);
        self.note_unmatched();
        Ok(true)
    }

    fn publish(
        &self,
        share: Share,
        message: &[u8],
        staged: Option<Staged>,
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        if share == Share::Counted && self.means.watching.swap(false, Ordering::Relaxed) {
            self.means.ledger.watch_matches(false);
        }
        let player = &self.means.player;
        let sent = match staged.map_or(Ok(false), |staged| player.release(staged)) {
            Ok(false) => player.publish(self.publisher, &[message], cancelled),
            released => released.map(drop),
        };
        match sent {
            Ok(()) => Ok(()),
            Err(PlayerError::Cancelled) => Err(SendError::Cancelled),
            Err(error) => Err(failed(&error)),
        }
    }

    /// Until it can go out, and is counted; what was copied of it by then.
    fn await_turn(
        &self,
        share: Share,
        message: &[u8],
        cancelled: Cancelled<'_>,
    ) -> Result<Option<Staged>, SendError> {
        loop {
            self.meet(cancelled)?;
            if let Some(why) = self.misread() {
                return Err(SendError::Failed { reason: "BagUnreadable", what: why.to_owned() });
            }
            let mut staged = None;
            match (self.means.paced_by, share) {
                (PacedBy::Subscribers, _) => {
                    staged = self.stage(message)?;
                    self.await_room(message.len() as u64, cancelled)?;
                }
                // By the clock, time waits for nobody, nor what would be due meanwhile.
                (PacedBy::Schedule, Share::LeadIn) if !self.is_clock() => {
                    self.await_first(message, cancelled)?;
                }
                (PacedBy::Schedule, _) => {}
            }
            if self.count(share, message.len())? {
                return Ok(staged);
            }
        }
    }

    /// Waits for `holds`, which is asked of each open link that counts, as long as each of which it
    /// does not hold takes or ends something now and then.
    fn wait(
        &self,
        events: &[Event],
        mut holds: impl FnMut(&Link, &Ledger) -> Result<bool, LedgerError>,
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        let ledger = &self.means.ledger;
        let mut progress: BTreeMap<u64, Progress> = BTreeMap::new();
        loop {
            let links = self.links();
            let there: Vec<&Arc<Link>> =
                links.iter().filter(|link| link.is_open() && link.counted.is_some()).collect();
            let mut all = |ledger: &Ledger| {
                there.iter().try_fold(true, |held, link| Ok(held && holds(link, ledger)?))
            };
            if all(ledger).map_err(|error| failed(&error))? {
                return Ok(());
            }
            match ledger.wait(events, &[], Instant::now() + ASK, all) {
                Ok(Waited::Held) => return Ok(()),
                Ok(Waited::Late | Waited::Ended(_)) => {}
                Err(error) => return Err(failed(&error)),
            }
            // Nobody wakes us for who has ended.
            let look = Look::at(ledger).map_err(|error| failed(&error))?;
            self.refresh(&look, None).map_err(|error| failed(&error))?;
            if cancelled() {
                return Err(SendError::Cancelled);
            }
            progress.retain(|id, _| there.iter().any(|link| link.id() == *id && link.is_open()));
            for link in there.iter().filter(|link| link.is_open()) {
                if holds(link, ledger).map_err(|error| failed(&error))? {
                    progress.remove(&link.id());
                } else {
                    self.may_wait_for(link, progress.entry(link.id()).or_default())?;
                }
            }
        }
    }

    /// Takes in how far somebody is who is waited for. Fails if it has stopped; what another publisher has
    /// overwritten is not waited for any more.
    fn may_wait_for(&self, link: &Link, progress: &mut Progress) -> Result<(), SendError> {
        let (ledger, failed) = (&self.means.ledger, |error: LedgerError| failed(&error));
        let (done, all) = (done(link, ledger), link.taken_of_all(ledger).map_err(failed)?);
        let (waited, idle) = progress.look(Instant::now(), done.map_err(failed)?, all);
        let seen = Seen { waited, idle, since_sent: all.saturating_sub(link.taken_before()) };
        let patience = link.patience(ledger).map_err(failed)?;
        if !seen.lacks(self.means.stall, patience) {
            return Ok(());
        }
        if link.write_off(ledger).map_err(failed)? {
            *progress = Progress::default();
        } else if seen.has_stopped(self.means.stall) {
            let (node, topic) = (link.node.clone(), self.info.topic.clone());
            let why = link.why_it_takes_nothing(ledger).map_err(failed)?;
            return Err(SendError::Stalled { node, topic, waited, why });
        }
        Ok(())
    }
}

/// How far somebody was who is waited for.
#[derive(Default)]
struct Progress {
    /// With the last message of ours that was taken or done with, and since when.
    done: Option<(i128, Instant)>,
    /// Messages that were taken at the last look, whoever published them, and since when.
    all: Option<(u64, Instant)>,
}

impl Progress {
    /// Takes in how far it is now; how long none of ours was taken or done with, and how long nothing was
    /// taken at all.
    fn look(&mut self, now: Instant, done: i128, all: u64) -> (Duration, Duration) {
        if self.done.is_none_or(|(before, _)| done > before) {
            (self.done, self.all) = (Some((done, now)), None);
        }
        if self.all.is_none_or(|(before, _)| all != before) {
            self.all = Some((all, now));
        }
        let since = |at: Option<Instant>| at.map_or(Duration::ZERO, |at| now - at);
        let (done, all) = (self.done.map(|(_, at)| at), self.all.map(|(_, at)| at));
        (since(done), since(all))
    }
}

/// What is seen of somebody who is waited for.
#[derive(Clone, Copy)]
struct Seen {
    /// How long no message of ours was taken or done with.
    waited: Duration,
    /// How long nothing at all was taken.
    idle: Duration,
    /// What it has taken since our last message went out, whoever published it.
    since_sent: u64,
}

impl Seen {
    /// Whether what is waited for may never come. `patience`: beside other publishers, how long a message
    /// is waited for that may be lost, once so many have been taken after it.
    fn lacks(self, stall: Duration, patience: Option<(Duration, u64)>) -> bool {
        let is_lost = |(patience, others)| self.waited >= patience && self.since_sent >= others;
        patience.is_some_and(is_lost) || self.has_stopped(stall)
    }

    /// Whether it takes nothing, or for long nothing but what others publish.
    fn has_stopped(self, stall: Duration) -> bool {
        self.idle >= stall || self.waited >= AT_WORK * stall
    }
}

/// A figure that grows with each message of ours that is taken or done with. With one of the stack's own
/// it goes down for a moment.
fn done(link: &Link, ledger: &Ledger) -> Result<i128, LedgerError> {
    let taken = i128::from(link.taken(ledger)?.unwrap_or(0));
    Ok(2 * taken - i128::from(link.in_hand(ledger)?))
}

pub(super) fn failed(error: &dyn std::error::Error) -> SendError {
    SendError::Failed { reason: "Ros2Failed", what: error.to_string() }
}

impl Outlet for Topic {
    fn topic(&self) -> &str {
        &self.info.topic
    }

    /// The middleware keeps what a transient-local publisher has sent.
    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(
        &self,
        share: Share,
        frames: &[&[u8]],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        for frame in frames {
            let message = frame.get(4..).unwrap_or_default();
            let staged = self.await_turn(share, message, cancelled)?;
            self.publish(share, message, staged, cancelled)?;
        }
        Ok(())
    }

    /// With a window of 0: until the callbacks of all that was sent have ended. Else the credit of
    /// each message is the window.
    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        if window > 0 || self.means.paced_by == PacedBy::Schedule {
            return Ok(());
        }
        let mut taken_since = BTreeMap::new();
        let done = |link: &Link, ledger: &Ledger| {
            if link.waiting(ledger)? > 0 {
                return Ok(false);
            }
            let (begun, done) = link.begun_and_done(ledger)?;
            // What is taken of others after ours is not waited for.
            let (since, taken) =
                *taken_since.entry(link.id()).or_insert_with(|| (Instant::now(), begun));
            let gives_up = !link.reports_calls() && since.elapsed() >= COMES_BACK;
            Ok(done >= taken || gives_up)
        };
        self.wait(&[Event::Taken, Event::Ended], done, cancelled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STALL: Duration = Duration::from_secs(10);

    #[test]
    fn progress_is_a_message_of_ours_and_who_takes_others_is_not_idle() {
        let (begun, mut progress) = (Instant::now(), Progress::default());
        let s = Duration::from_secs;
        let mut look = |seconds, done, all| progress.look(begun + s(seconds), done, all);
        assert_eq!(look(0, -1, 7), (s(0), s(0)));
        assert_eq!(look(3, -1, 9), (s(3), s(0)));
        // One of the stack's own in hand, and done with.
        assert_eq!(look(4, -2, 10), (s(4), s(0)));
        assert_eq!(look(6, -1, 10), (s(6), s(2)));
        assert_eq!(look(7, 0, 10), (s(0), s(0)));
        assert_eq!(look(9, 0, 10), (s(2), s(2)));
    }

    #[test]
    fn who_takes_nothing_has_stopped_and_who_takes_others_alone_has_ten_times_as_long() {
        let seen = |waited, idle| Seen { waited, idle, since_sent: 9 };
        let moment = Duration::from_nanos(1);
        for (waited, idle, has) in [
            (STALL, STALL, true),
            (STALL, STALL - moment, false),
            (10 * STALL - moment, STALL - moment, false),
            (10 * STALL, Duration::ZERO, true),
        ] {
            assert_eq!(seen(waited, idle).has_stopped(STALL), has, "{waited:?} {idle:?}");
            assert_eq!(seen(waited, idle).lacks(STALL, None), has, "{waited:?} {idle:?}");
        }
    }

    #[test]
    fn beside_others_a_message_is_lost_once_as_many_were_taken_after_it() {
        let second = Duration::from_secs(1);
        let lacks = |waited, since_sent| {
            Seen { waited, idle: Duration::ZERO, since_sent }.lacks(STALL, Some((second, 5)))
        };
        assert!(lacks(second, 5));
        assert!(!lacks(second, 4));
        assert!(!lacks(second - Duration::from_nanos(1), 9));
    }
}
