//! Programs of DDS that are no nodes: the graph has no names of them, and the middleware matches them all
//! the same.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often the middleware is asked.
pub(crate) const EVERY: Duration = Duration::from_millis(200);
/// Looks in a row at which more are matched than are known: a node is matched a moment before it is listed.
pub(crate) const LOOKS: u32 = 3;

/// Those that are matched at one topic.
#[derive(Debug, Default)]
pub(crate) struct Unnamed(Mutex<State>);

#[derive(Debug, Default)]
struct State {
    asked: Option<Instant>,
    in_a_row: u32,
    least: u64,
    seen: u64,
}

impl Unnamed {
    /// Takes in a look at a moment, if the last one is not just over: `matched` says how many more are
    /// matched than are known.
    pub(crate) fn look(&self, now: Instant, matched: impl FnOnce() -> u64) {
        let mut state = self.state();
        if state.asked.is_some_and(|asked| now - asked < EVERY) {
            return;
        }
        state.asked = Some(now);
        let more = matched();
        if more == 0 {
            state.in_a_row = 0;
            return;
        }
        state.least = if state.in_a_row == 0 { more } else { state.least.min(more) };
        state.in_a_row += 1;
        if state.in_a_row >= LOOKS {
            state.seen = state.seen.max(state.least);
        }
    }

    /// How many there were at the least.
    pub(crate) fn seen(&self) -> u64 {
        self.state().seen
    }

    /// When the last look was.
    pub(crate) fn asked(&self) -> Option<Instant> {
        self.state().asked
    }

    /// Whether there were some at the last look.
    pub(crate) fn is_suspected(&self) -> bool {
        self.state().in_a_row > 0
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many are seen after these looks, so many milliseconds apart.
    fn seen(apart: u64, looks: &[u64]) -> u64 {
        let (unnamed, begun) = (Unnamed::default(), Instant::now());
        for (at, more) in (0..).zip(looks) {
            unnamed.look(begun + Duration::from_millis(at * apart), || *more);
        }
        unnamed.seen()
    }

    #[test]
    fn who_is_matched_at_three_looks_in_a_row_is_there() {
        assert_eq!(seen(200, &[1, 1]), 0);
        assert_eq!(seen(200, &[1, 1, 1]), 1);
        assert_eq!(seen(200, &[1, 1, 0, 1, 1]), 0);
        assert_eq!(seen(200, &[2, 5, 3, 0]), 2);
        assert_eq!(seen(200, &[1, 1, 1, 0, 4, 3, 3]), 3);
    }

    #[test]
    fn looks_within_a_fifth_of_a_second_are_one() {
        assert_eq!(seen(100, &[1, 0, 1, 0, 1]), 1);
        assert_eq!(seen(99, &[1, 1, 1, 1, 1]), 0);
    }
}
