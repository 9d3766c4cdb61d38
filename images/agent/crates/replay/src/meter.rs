//! What the replays of a process do and have done, for whoever looks on from another thread.
//!
//! Nothing here is on the way of a message: a replay tells its figures twice a second, at the
//! end of each of its stages, and, in lock-step, when it goes on after an answer.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};

use crate::Stage;
use crate::outcome::Figures;

/// Upper bounds, in seconds, of the waits that are counted together. Longer ones have a count
/// of their own.
pub const WAIT_BOUNDS: [f64; 13] =
    [0.0005, 0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 10.0];

/// Figures of all replays that were given it; they only grow, but for [`Reading::held_bytes`].
#[derive(Debug, Default)]
pub struct Meter {
    played_messages: AtomicU64,
    recorded_messages: AtomicU64,
    recorded_bytes: AtomicU64,
    held_bytes: AtomicU64,
    high_water_bytes: AtomicU64,
    realtime: AtomicU64,
    due: AtomicU64,
    unpaced: AtomicU64,
    waits: [AtomicU64; WAIT_BOUNDS.len() + 1],
    waited: AtomicU64,
    unanswered: AtomicU64,
}

/// What a [`Meter`] shows at a moment.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reading {
    /// Messages played, those of warm-ups included.
    pub played_messages: u64,
    /// Messages recorded.
    pub recorded_messages: u64,
    /// Bytes of their data.
    pub recorded_bytes: u64,
    /// Bytes of the recordings that are being made.
    pub held_bytes: u64,
    /// The most bytes that one recording has had.
    pub high_water_bytes: u64,
    /// Nanoseconds of bag time played in realtime, warm-ups not counted.
    pub realtime_nanoseconds: u64,
    /// Nanoseconds of bag time that were due meanwhile, at the rate that was asked for.
    pub due_nanoseconds: u64,
    /// Nanoseconds of bag time played in the modes that know no rate.
    pub unpaced_nanoseconds: u64,
    /// Answers in lock-step by the time they took; one more than [`WAIT_BOUNDS`].
    pub waits: [u64; WAIT_BOUNDS.len() + 1],
    /// These times' sum, in nanoseconds.
    pub waited_nanoseconds: u64,
    /// Answers in lock-step that did not come in time.
    pub unanswered: u64,
}

impl Meter {
    /// Reads all figures; replays may be a figure further than the one before.
    pub fn read(&self) -> Reading {
        let value = |figure: &AtomicU64| figure.load(Ordering::Relaxed);
        Reading {
            played_messages: value(&self.played_messages),
            recorded_messages: value(&self.recorded_messages),
            recorded_bytes: value(&self.recorded_bytes),
            held_bytes: value(&self.held_bytes),
            high_water_bytes: value(&self.high_water_bytes),
            realtime_nanoseconds: value(&self.realtime),
            due_nanoseconds: value(&self.due),
            unpaced_nanoseconds: value(&self.unpaced),
            waits: std::array::from_fn(|place| value(&self.waits[place])),
            waited_nanoseconds: value(&self.waited),
            unanswered: value(&self.unanswered),
        }
    }

    /// An answer came after `waited`.
    pub(crate) fn answered(&self, waited: Duration) {
        let seconds = waited.as_secs_f64();
        let place = WAIT_BOUNDS.iter().position(|bound| seconds <= *bound);
        add(&self.waits[place.unwrap_or(WAIT_BOUNDS.len())], 1);
        add(&self.waited, nanoseconds(waited));
    }

    /// An answer did not come in time.
    pub(crate) fn unanswered(&self) {
        add(&self.unanswered, 1);
    }

    /// A recording has had so many bytes.
    pub(crate) fn held(&self, bytes: u64) {
        self.high_water_bytes.fetch_max(bytes, Ordering::Relaxed);
    }
}

/// What a replay has done since it began.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Seen {
    /// Messages played.
    pub(crate) sent: u64,
    /// Bag time of the last one.
    pub(crate) reached: u64,
    pub(crate) recorded: Figures,
}

/// One replay's part of a meter: what it has told already, so that only what is new is added.
#[derive(Debug)]
pub(crate) struct Tally {
    meter: Arc<Meter>,
    /// The rate that was asked for, if one was.
    rate: Option<f64>,
    sent: u64,
    recorded: Figures,
    /// While the window is played: bag time and clock time up to which it has told.
    window: Option<(u64, Instant)>,
}

impl Tally {
    pub(crate) fn new(meter: Arc<Meter>, rate: Option<f64>) -> Tally {
        Tally { meter, rate, sent: 0, recorded: Figures::default(), window: None }
    }

    /// A stage begins; the window's first time is `start`.
    pub(crate) fn enter(&mut self, stage: Stage, start: u64, now: Instant) {
        self.window = (stage == Stage::Play).then_some((start, now));
    }

    /// Adds what is new.
    pub(crate) fn note(&mut self, seen: Seen, now: Instant) {
        let (meter, recorded) = (&self.meter, seen.recorded);
        add(&meter.played_messages, seen.sent.saturating_sub(self.sent));
        let messages = recorded.messages.saturating_sub(self.recorded.messages);
        add(&meter.recorded_messages, messages);
        add(&meter.recorded_bytes, recorded.bytes.saturating_sub(self.recorded.bytes));
        meter.held_bytes.store(recorded.held, Ordering::Relaxed);
        meter.held(recorded.held);
        (self.sent, self.recorded) = (seen.sent, recorded);
        let Some((reached, since)) = &mut self.window else { return };
        let played = seen.reached.saturating_sub(*reached);
        *reached = seen.reached.max(*reached);
        match self.rate {
            Some(rate) => {
                add(&meter.realtime, played);
                // A cast of what no integer holds ends at the largest one.
                add(&meter.due, (now.duration_since(*since).as_nanos() as f64 * rate) as u64);
                *since = now;
            }
            None => add(&meter.unpaced, played),
        }
    }
}

impl Drop for Tally {
    fn drop(&mut self) {
        self.meter.held_bytes.store(0, Ordering::Relaxed);
    }
}

fn add(figure: &AtomicU64, more: u64) {
    figure.fetch_add(more, Ordering::Relaxed);
}

fn nanoseconds(time: Duration) -> u64 {
    u64::try_from(time.as_nanos()).unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn tally(meter: &Arc<Meter>, rate: Option<f64>) -> Tally {
        Tally::new(Arc::clone(meter), rate)
    }

    fn seen(sent: u64, reached: u64, bytes: u64) -> Seen {
        Seen { sent, reached, recorded: Figures { messages: bytes / 10, bytes, held: 2 * bytes } }
    }

    #[test]
    fn what_two_replays_do_adds_up_and_is_added_once() {
        let meter = Arc::new(Meter::default());
        let now = Instant::now();
        for _ in 0..2 {
            let mut tally = tally(&meter, None);
            tally.note(seen(5, 0, 100), now);
            tally.note(seen(5, 0, 100), now);
            tally.note(seen(8, 0, 120), now);
            let read = meter.read();
            assert_eq!((read.held_bytes, read.high_water_bytes), (240, 240));
        }
        let read = meter.read();
        assert_eq!((read.played_messages, read.recorded_messages), (16, 24));
        assert_eq!((read.recorded_bytes, read.held_bytes, read.high_water_bytes), (240, 0, 240));
    }

    #[test]
    fn a_late_replay_has_played_less_than_was_due() {
        let meter = Arc::new(Meter::default());
        let mut tally = tally(&meter, Some(2.0));
        let begun = Instant::now();
        let after = |seconds| begun + Duration::from_secs(seconds);
        // A warm-up is played at a rate too, and is not what was asked for.
        tally.enter(Stage::LeadIn, 10 * SECOND, begun);
        tally.note(seen(1, 9 * SECOND, 0), after(4));
        tally.enter(Stage::Play, 10 * SECOND, after(4));
        tally.note(seen(2, 9 * SECOND, 0), after(5));
        tally.note(seen(3, 13 * SECOND, 0), after(6));
        tally.enter(Stage::Drain, 10 * SECOND, after(6));
        tally.note(seen(3, 13 * SECOND, 0), after(9));
        let read = meter.read();
        assert_eq!((read.realtime_nanoseconds, read.due_nanoseconds), (3 * SECOND, 4 * SECOND));
        assert_eq!(read.unpaced_nanoseconds, 0);
    }

    #[test]
    fn without_a_rate_nothing_is_due() {
        let meter = Arc::new(Meter::default());
        let mut tally = tally(&meter, None);
        let begun = Instant::now();
        tally.enter(Stage::Play, SECOND, begun);
        tally.note(seen(9, 4 * SECOND, 0), begun + Duration::from_secs(1));
        let read = meter.read();
        assert_eq!((read.unpaced_nanoseconds, read.realtime_nanoseconds), (3 * SECOND, 0));
        assert_eq!(read.due_nanoseconds, 0);
    }

    #[test]
    fn a_wait_is_counted_below_the_bound_that_it_does_not_exceed() {
        let meter = Meter::default();
        for milliseconds in [0, 1, 2, 600, 10_000, 10_001] {
            meter.answered(Duration::from_millis(milliseconds));
        }
        meter.unanswered();
        let read = meter.read();
        assert_eq!(read.waits, [1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 1, 1]);
        assert_eq!((read.waited_nanoseconds, read.unanswered), (20_604_000_000, 1));
    }
}
