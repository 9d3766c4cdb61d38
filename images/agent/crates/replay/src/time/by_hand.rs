//! A clock that stands until somebody sleeps, and what happens meanwhile.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use super::Time;

/// How often the time may be asked for while it stands: who asks more often sleeps never.
const MOST_QUESTIONS: u32 = 100_000;

/// A clock of which sleeping is the only way on: what is planned happens on the way, at its
/// moment. Nothing waits for real time, so that each figure comes out the same every time, and a
/// loop that never ends fails its test at once.
pub(crate) struct ByHand {
    began: Instant,
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    passed: Duration,
    /// By moment, and in the order in which they were planned.
    plans: BTreeMap<(Duration, usize), Box<dyn FnOnce() + Send>>,
    planned: usize,
    /// How often the time was asked for since it last moved.
    questions: u32,
}

impl fmt::Debug for ByHand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ByHand").field("passed", &self.passed()).finish_non_exhaustive()
    }
}

impl ByHand {
    /// A clock of which nothing has passed.
    pub(crate) fn new() -> Arc<ByHand> {
        Arc::new(ByHand { began: Instant::now(), state: Mutex::default() })
    }

    /// The source of time that it is.
    pub(crate) fn time(self: &Arc<ByHand>) -> Time {
        Time::ByHand(Arc::clone(self))
    }

    pub(crate) fn now(&self) -> Instant {
        let mut state = self.state();
        state.questions += 1;
        assert!(state.questions <= MOST_QUESTIONS, "nobody sleeps: the clock stands for ever");
        self.began + state.passed
    }

    /// What has passed since it was made.
    pub(crate) fn passed(&self) -> Duration {
        self.state().passed
    }

    /// When so much will have passed.
    pub(crate) fn moment(&self, passed: Duration) -> Instant {
        self.began + passed
    }

    /// Does something once so much has passed: while somebody sleeps, just before that one wakes.
    pub(crate) fn at(&self, passed: Duration, then: impl FnOnce() + Send + 'static) {
        let mut state = self.state();
        state.planned += 1;
        let key = (passed, state.planned);
        state.plans.insert(key, Box::new(then));
    }

    /// From then on the machine stands still for so long: whoever sleeps wakes late.
    pub(crate) fn stall(self: &Arc<ByHand>, passed: Duration, time: Duration) {
        let clock = Arc::clone(self);
        self.at(passed, move || clock.state().passed += time);
    }

    pub(crate) fn sleep(&self, time: Duration) {
        let until = self.passed() + time;
        while self.step(until) {}
    }

    pub(crate) fn wait_while(&self, limit: Duration, mut waits: impl FnMut() -> bool) {
        let until = self.passed() + limit;
        while waits() && self.step(until) {}
    }

    /// On to what happens next, `until` then at the latest; whether there was anything.
    fn step(&self, until: Duration) -> bool {
        let mut state = self.state();
        state.questions = 0;
        let next = state.plans.first_entry().filter(|plan| plan.key().0 <= until);
        let Some(plan) = next else {
            let before = state.passed;
            state.passed = before.max(until);
            return before < until;
        };
        let ((moment, _), then) = plan.remove_entry();
        state.passed = state.passed.max(moment);
        // It may ask for the time, and plan more.
        drop(state);
        then();
        true
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Condvar;

    use super::*;

    const fn ms(milliseconds: u64) -> Duration {
        Duration::from_millis(milliseconds)
    }

    #[test]
    fn what_is_planned_happens_at_its_moment_while_somebody_sleeps() {
        let clock = ByHand::new();
        let seen = Arc::new(Mutex::new(Vec::new()));
        for moment in [30, 10, 20, 50] {
            let (at, seen) = (Arc::clone(&clock), Arc::clone(&seen));
            clock.at(ms(moment), move || seen.lock().unwrap().push((moment, at.passed())));
        }
        clock.sleep(ms(30));
        assert_eq!(*seen.lock().unwrap(), [(10, ms(10)), (20, ms(20)), (30, ms(30))]);
        assert_eq!((clock.passed(), clock.now()), (ms(30), clock.moment(ms(30))));
    }

    #[test]
    fn who_sleeps_while_the_machine_stands_still_wakes_late() {
        let clock = ByHand::new();
        clock.stall(ms(15), ms(100));
        clock.sleep(ms(20));
        assert_eq!(clock.passed(), ms(115));
        clock.sleep(ms(20));
        assert_eq!(clock.passed(), ms(135));
    }

    #[test]
    #[should_panic(expected = "nobody sleeps")]
    fn who_waits_without_sleeping_fails_in_place_of_waiting_for_ever() {
        let clock = ByHand::new();
        while clock.now() < clock.moment(ms(1)) {}
    }

    #[test]
    fn a_wait_ends_with_what_it_waits_for_or_with_its_limit() {
        let clock = ByHand::new();
        let received = Arc::new(Mutex::new(0));
        let sender = Arc::clone(&received);
        clock.at(ms(7), move || *sender.lock().unwrap() += 1);
        let wait = |enough| {
            let notified = Condvar::new();
            clock.time().wait_while(&received, &notified, ms(10), |received| *received < enough);
            clock.passed()
        };
        assert_eq!((wait(0), wait(1), wait(2)), (ms(0), ms(7), ms(17)));
    }
}
