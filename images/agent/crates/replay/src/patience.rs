//! How long a settling is waited for.

use std::time::{Duration, Instant};

use crate::time::Time;

/// When a settling ends that does not come to an end of itself.
pub(crate) struct Patience {
    /// When to give up on those of whom nothing can be seen.
    pub(crate) deadline: Instant,
    /// When to give up on those that are seen to be busy.
    pub(crate) busy: Instant,
    /// Without a change for this time, nothing more is expected.
    pub(crate) stable: Duration,
}

/// How an attempt to see everything received ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Settled {
    /// No open connection's figures can change any more.
    Complete,
    /// Some have not, but nothing has changed for a while.
    Stable,
    /// Time ran out.
    Unsettled,
}

/// What a round of questions has found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Round<F> {
    /// What the nodes said.
    pub(crate) figures: F,
    /// Whether none of it can change any more.
    pub(crate) complete: bool,
    /// Whether somebody is seen to be on its way to more.
    pub(crate) busy: bool,
}

impl Patience {
    /// Asks until the answers are complete, or do not change any more, or time runs out, or
    /// `pause` (which may also sleep between two rounds) says so.
    pub(crate) fn settle<F: PartialEq, E>(
        &self,
        time: &Time,
        mut ask: impl FnMut() -> Round<F>,
        mut pause: impl FnMut() -> Result<bool, E>,
    ) -> Result<Settled, E> {
        let mut before = None;
        let mut changed = time.now();
        loop {
            let Round { figures, complete, busy } = ask();
            let same = before.as_ref() == Some(&figures);
            if same && complete {
                // Twice the same: roscpp counts a message before it counts its drop.
                return Ok(Settled::Complete);
            }
            let now = time.now();
            if !same {
                (before, changed) = (Some(figures), now);
            }
            if !busy && now.duration_since(changed) >= self.stable {
                return Ok(Settled::Stable);
            }
            let deadline = if busy { self.busy } else { self.deadline };
            if now >= deadline || pause()? {
                return Ok(Settled::Unsettled);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::time::ByHand;

    const fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    /// Settles with what `answer` says at each time, asked every 10 ms: how it ended, and when.
    /// It gives up after 1 s, on the busy after 3 s; without a change after half a second.
    fn settled(answer: impl Fn(Duration) -> Round<u64>) -> (Settled, Duration) {
        let clock = ByHand::new();
        let (deadline, busy) = (clock.moment(ms(1_000)), clock.moment(ms(3_000)));
        let patience = Patience { deadline, busy, stable: ms(500) };
        let pause = || {
            clock.sleep(ms(10));
            Ok::<bool, ()>(false)
        };
        let end = patience.settle(&clock.time(), || answer(clock.passed()), pause).unwrap();
        (end, clock.passed())
    }

    fn round(figures: u64, complete: bool, busy: bool) -> Round<u64> {
        Round { figures, complete, busy }
    }

    #[test]
    fn what_is_complete_is_asked_for_twice() {
        assert_eq!(settled(|_| round(7, true, false)), (Settled::Complete, ms(10)));
        // A drop that is counted a moment after its message.
        let late = |passed| round(if passed < ms(10) { 7 } else { 6 }, true, false);
        assert_eq!(settled(late), (Settled::Complete, ms(20)));
    }

    #[test]
    fn what_has_not_changed_for_half_a_second_will_not() {
        assert_eq!(settled(|_| round(7, false, false)), (Settled::Stable, ms(500)));
        let changes_once = |passed| round(u64::from(passed >= ms(490)), false, false);
        assert_eq!(settled(changes_once), (Settled::Stable, ms(990)));
    }

    #[test]
    fn who_changes_without_end_is_given_up_at_the_deadline_and_the_busy_at_theirs() {
        let figures = |passed: Duration| u64::try_from(passed.as_millis()).unwrap();
        let restless = |passed| round(figures(passed), false, false);
        assert_eq!(settled(restless), (Settled::Unsettled, ms(1_000)));
        // Who is busy may stand still for as long as it likes.
        assert_eq!(settled(|_| round(7, false, true)), (Settled::Unsettled, ms(3_000)));
        let rests_at_last = |passed| round(7, false, passed < ms(2_000));
        assert_eq!(settled(rests_at_last), (Settled::Stable, ms(2_000)));
    }

    #[test]
    fn a_pause_may_end_it_or_fail() {
        let clock = ByHand::new();
        let now = clock.now();
        let patience = Patience { deadline: now + ms(9), busy: now + ms(9), stable: ms(5) };
        let ask = || round(7, false, false);
        let end = patience.settle(&clock.time(), ask, || Ok::<bool, &str>(true));
        assert_eq!(end, Ok(Settled::Unsettled));
        let end = patience.settle(&clock.time(), ask, || Err::<bool, &str>("stopped"));
        assert_eq!(end, Err("stopped"));
        assert_eq!(clock.passed(), ms(0));
    }
}
