//! Whether nodes rest: whether anything of theirs could still answer what they received.
//!
//! A thread works that wants a good part of a processor, more than its process wanted
//! before the first input. A thread that sleeps until some time may be in the middle of its
//! work, and is waited for until it has woken once. Both follow from the differences of two
//! looks, whatever machine they ran on: wanting a processor without getting it counts.

use std::collections::BTreeMap;
use std::time::Duration;

use super::threads::{Demand, Waits};

/// The part of a processor that a process wants while it works, beyond what it always wants.
/// Timers and the reading of /clock take a few hundredths.
pub(crate) const WORKING: f64 = 0.25;
/// A thread that waited for a processor in all but so much of the time has shown nothing, or between two looks that come
/// sooner, in most of it.
const LEAST_SEEN: Duration = Duration::from_millis(5);
/// A process that wants less than this before the first input is at rest by then.
pub(crate) const RESTING: f64 = 0.1;

/// A thread: its process and its own number.
pub(crate) type Thread = (i32, i32);

/// All threads at a moment.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Look {
    /// Since when looks began.
    pub(crate) at: Duration,
    pub(crate) threads: BTreeMap<Thread, (Demand, Waits)>,
}

/// What two looks say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Rest {
    /// Somebody works.
    Working,
    /// Nobody works, and somebody who was asleep has not woken since.
    Asleep,
    /// Nothing is going on.
    Still,
}

/// The watch over some processes.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    /// The part of a processor that each process wanted before the first input.
    usual: BTreeMap<i32, f64>,
    /// Turns of each thread then.
    before: Look,
    last: Look,
    /// When it was still since.
    still: Look,
}

impl Look {
    /// What each thread has had and wanted since an earlier look, and whether it has waited for the machine all along: the
    /// kernel adds the time of a wait for a processor once that is over.
    fn grown_since(&self, earlier: &Look) -> impl Iterator<Item = (Thread, Demand, bool)> {
        self.threads.iter().map(|(thread, (demand, waits))| {
            let before = earlier.threads.get(thread).map(|(demand, _)| *demand);
            let starved = waits.is_of_the_machine() && before == Some(*demand);
            let before = before.unwrap_or_default();
            let grown = Demand {
                nanoseconds: demand.nanoseconds.saturating_sub(before.nanoseconds),
                waited: demand.waited.saturating_sub(before.waited),
                turns: demand.turns.saturating_sub(before.turns),
            };
            (*thread, grown, starved)
        })
    }

    /// The part of a processor that each process has wanted since an earlier look.
    pub(crate) fn wanted_since(&self, earlier: &Look) -> BTreeMap<i32, f64> {
        let passed = self.at.saturating_sub(earlier.at).as_nanos() as f64;
        let mut wanted: BTreeMap<i32, f64> = BTreeMap::new();
        for (thread, grown, starved) in self.grown_since(earlier) {
            let grown = if starved { passed } else { grown.nanoseconds as f64 };
            *wanted.entry(thread.0).or_default() += if passed > 0.0 { grown / passed } else { 0.0 };
        }
        wanted
    }

    /// The part of a processor that each process has taken since an earlier look, of the time in which none of it had
    /// to wait for one. A thread that a machine starved has shown nothing of that, and takes the `unseen` part.
    fn taken_since(&self, earlier: &Look, unseen: f64) -> BTreeMap<i32, f64> {
        let passed = self.at.saturating_sub(earlier.at);
        let mut taken: BTreeMap<i32, f64> = BTreeMap::new();
        for (thread, grown, starved) in self.grown_since(earlier) {
            let seen = passed.saturating_sub(Duration::from_nanos(grown.waited));
            let ran = grown.nanoseconds.saturating_sub(grown.waited);
            let part = if starved || seen < LEAST_SEEN.min(passed / 2) {
                unseen
            } else {
                ran as f64 / seen.as_nanos().max(1) as f64
            };
            *taken.entry(thread.0).or_default() += part;
        }
        taken
    }

    /// The longest that a thread could have run since an earlier look and had no processor.
    pub(crate) fn starved_since(&self, earlier: &Look) -> Duration {
        let passed = self.at.saturating_sub(earlier.at);
        let waited = self.threads.iter().filter_map(|(thread, (demand, waits))| {
            let (before, _) = earlier.threads.get(thread)?;
            // The kernel adds the time of a wait for a processor once that is over.
            if waits.is_of_the_machine() && before == demand {
                return Some(passed);
            }
            Some(Duration::from_nanos(demand.waited.saturating_sub(before.waited)).min(passed))
        });
        waited.max().unwrap_or_default()
    }

    fn turns(&self, thread: &Thread) -> Option<u64> {
        self.threads.get(thread).map(|(demand, _)| demand.turns)
    }

    fn waits(&self, thread: &Thread) -> Option<Waits> {
        self.threads.get(thread).map(|(_, waits)| *waits)
    }
}

impl Watch {
    /// What was usual before the first input, from two looks.
    pub(crate) fn new(first: &Look, second: Look) -> Watch {
        let usual = second.taken_since(first, 0.0);
        Watch { usual, before: second.clone(), last: second.clone(), still: second }
    }

    /// Stillness can begin now.
    pub(crate) fn begin(&mut self, now: Look) {
        self.last = now.clone();
        self.still = now;
    }

    /// Whether the nodes rest. Work since the last look restarts the time of stillness, and so does
    /// a received message: a thread that sleeps after that has to wake once more.
    pub(crate) fn look(&mut self, now: Look, received: bool) -> Rest {
        let taken = now.taken_since(&self.last, 1.0);
        let usual = |process: &i32| self.usual.get(process).copied().unwrap_or_default();
        // Who reads a slow disk hardly needs a processor in between, and who was stopped needs none.
        let held_up = now.threads.iter().any(|(thread, (_, waits))| {
            waits.is_held_up() && self.before.waits(thread) != Some(*waits)
        });
        let works =
            held_up || taken.iter().any(|(process, part)| *part >= usual(process) + WORKING);
        self.last = now;
        if works || received {
            self.still = self.last.clone();
        }
        if works {
            return Rest::Working;
        }
        let asleep = self.last.threads.iter().any(|(thread, (demand, waits))| {
            let since = self.still.turns(thread) == Some(demand.turns);
            // Who has not woken since before the first input has nothing to do with it.
            let parked = self.before.turns(thread) == Some(demand.turns);
            *waits == Waits::Time && since && !parked
        });
        if asleep { Rest::Asleep } else { Rest::Still }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MS: u64 = 1_000_000;

    /// A look at (process, thread, milliseconds wanted, turns, what it waits for).
    fn look(at: u64, threads: &[(i32, i32, u64, u64, Waits)]) -> Look {
        let one = |&(process, thread, wanted, turns, waits): &(i32, i32, u64, u64, Waits)| {
            (
                (process, thread),
                (Demand { nanoseconds: wanted * MS, turns, ..Demand::default() }, waits),
            )
        };
        Look { at: Duration::from_millis(at), threads: threads.iter().map(one).collect() }
    }

    #[test]
    fn what_a_process_had_to_wait_for_is_none_of_its_habits() {
        let thread = |at, ran: u64, waited: u64| Look {
            at: Duration::from_millis(at),
            threads: BTreeMap::from([(
                (1, 1),
                (
                    Demand { nanoseconds: (ran + waited) * MS, waited: waited * MS, turns: at },
                    Waits::Else,
                ),
            )]),
        };
        let works = |ran, waited| {
            let mut watch = Watch::new(&thread(0, 0, 0), thread(200, ran, waited));
            watch.begin(thread(300, ran, waited));
            // A callback that computes, once it gets its processor.
            watch.look(thread(400, ran + 90, waited), false)
        };
        assert_eq!(works(4, 150), Rest::Working);
        assert_eq!(works(2, 198), Rest::Working, "it has not been seen at all");
        let idle = thread(200, 0, 0);
        let soon = Look { at: idle.at + Duration::from_millis(1), ..idle.clone() };
        assert_eq!(soon.taken_since(&idle, 1.0), BTreeMap::from([(1, 0.0)]), "not starved");
        assert_eq!(idle.taken_since(&idle, 1.0), BTreeMap::from([(1, 0.0)]));
        // It always takes a processor, as far as it gets one.
        assert_eq!(works(50, 150), Rest::Still);
        assert_eq!(works(200, 0), Rest::Still);
    }

    #[test]
    fn a_process_works_that_wants_more_than_it_always_did() {
        let idle = Waits::Else;
        let mut watch = Watch::new(
            &look(0, &[(1, 1, 0, 0, idle), (2, 2, 0, 0, idle)]),
            look(100, &[(1, 1, 90, 9, idle), (2, 2, 1, 9, idle)]),
        );
        let at = |at, one, two| look(at, &[(1, 1, one, 9, idle), (2, 2, two, 9, idle)]);
        watch.begin(at(200, 180, 2));
        // The first always burns most of a processor; the second begins to.
        assert_eq!(watch.look(at(250, 225, 3), false), Rest::Still);
        assert_eq!(watch.look(at(300, 270, 23), false), Rest::Working);
        assert_eq!(watch.look(at(350, 315, 24), false), Rest::Still);
    }

    #[test]
    fn who_could_run_and_had_no_processor_is_starved_by_the_longest_wait() {
        let look = |at, threads: &[(i32, u64, Waits)]| Look {
            at: Duration::from_millis(at),
            threads: threads
                .iter()
                .map(|&(thread, waited, waits)| {
                    let nanoseconds = waited * MS;
                    ((1, thread), (Demand { nanoseconds, waited: nanoseconds, turns: 1 }, waits))
                })
                .collect(),
        };
        let starved = |later: &[(i32, u64, Waits)]| {
            let before = look(0, &[(1, 50, Waits::Else), (2, 20, Waits::Else)]);
            look(100, later).starved_since(&before).as_millis()
        };
        assert_eq!(starved(&[(1, 60, Waits::Else), (2, 63, Waits::Else)]), 43);
        assert_eq!(starved(&[(1, 50, Waits::Else), (2, 20, Waits::Else)]), 0);
        // The kernel adds a wait once it is over: it may be longer than between the looks, or not be
        // there yet.
        assert_eq!(starved(&[(1, 500, Waits::Else)]), 100);
        assert_eq!(starved(&[(1, 50, Waits::Processor)]), 100);
        // One that is new was not seen to wait.
        assert_eq!(starved(&[(3, 90, Waits::Processor)]), 0);
    }

    #[test]
    fn work_that_is_shared_by_threads_is_one_process_s() {
        let both = |at, wanted| {
            look(at, &[(1, 1, wanted, 1, Waits::Else), (1, 2, wanted, 1, Waits::Else)])
        };
        let mut watch = Watch::new(&both(0, 0), both(100, 0));
        assert_eq!(watch.look(both(150, 7), false), Rest::Working);
        // A thread that is new counts from nothing.
        let new = look(200, &[(1, 1, 7, 1, Waits::Else), (1, 9, 40, 1, Waits::Else)]);
        assert_eq!(watch.look(new, false), Rest::Working);
    }

    // Promise: recording-ends-by-nodes
    #[test]
    fn who_gets_no_processor_between_two_looks_works() {
        let at = |at, waits| look(at, &[(1, 1, 40, 3, waits)]);
        let mut watch = Watch::new(&at(0, Waits::Else), at(100, Waits::Else));
        watch.begin(at(200, Waits::Else));
        assert_eq!(watch.look(at(250, Waits::Processor), false), Rest::Working);
        assert_eq!(watch.look(at(300, Waits::Else), false), Rest::Still);
    }

    // Promise: recording-ends-by-nodes
    #[test]
    fn who_waits_for_a_disk_works_unless_it_always_does() {
        let at = |at, wanted, waits| look(at, &[(1, 1, wanted, wanted, waits)]);
        let mut watch = Watch::new(&at(0, 1, Waits::Else), at(100, 1, Waits::Else));
        watch.begin(at(200, 2, Waits::Else));
        // A page at a time: of each 50 ms it needs one of a processor.
        assert_eq!(watch.look(at(250, 3, Waits::Disk), false), Rest::Working);
        assert_eq!(watch.look(at(300, 4, Waits::Disk), false), Rest::Working);
        assert_eq!(watch.look(at(350, 5, Waits::Else), false), Rest::Still);
        // One that writes logs all the time.
        let mut watch = Watch::new(&at(0, 1, Waits::Disk), at(100, 2, Waits::Disk));
        assert_eq!(watch.look(at(150, 3, Waits::Disk), false), Rest::Still);
    }

    // Promise: recording-ends-by-nodes
    #[test]
    fn who_was_stopped_since_the_first_input_is_no_node_at_rest() {
        let at = |at, waits| look(at, &[(1, 1, 40, 3, waits)]);
        let mut watch = Watch::new(&at(0, Waits::Else), at(100, Waits::Else));
        watch.begin(at(200, Waits::Else));
        assert_eq!(watch.look(at(250, Waits::Leave), false), Rest::Working);
        assert_eq!(watch.look(at(300, Waits::Else), false), Rest::Still);
        // It is no work of the machine's, whose load explains a loss.
        assert_eq!(at(300, Waits::Leave).starved_since(&at(200, Waits::Leave)), Duration::ZERO);
        // One that was stopped before the first input.
        let mut watch = Watch::new(&at(0, Waits::Leave), at(100, Waits::Leave));
        assert_eq!(watch.look(at(150, Waits::Leave), false), Rest::Still);
    }

    #[test]
    fn a_sleeper_is_waited_for_until_it_has_woken_unless_it_never_does() {
        let at = |at, turns| look(at, &[(1, 1, 0, turns, Waits::Time), (1, 2, 0, 4, Waits::Time)]);
        let mut watch = Watch::new(&at(0, 1), at(10, 1));
        watch.begin(at(100, 5));
        assert_eq!(watch.look(at(150, 5), false), Rest::Asleep);
        assert_eq!(watch.look(at(200, 6), false), Rest::Still);
        // It published something, and sleeps again.
        assert_eq!(watch.look(at(220, 7), true), Rest::Asleep);
        assert_eq!(watch.look(at(240, 7), false), Rest::Asleep);
        assert_eq!(watch.look(at(260, 8), false), Rest::Still);
        // The other thread has slept since before the play.
        watch.begin(at(300, 8));
        assert_eq!(watch.look(at(350, 8), false), Rest::Asleep);
        assert_eq!(watch.look(look(400, &[(1, 2, 0, 4, Waits::Time)]), false), Rest::Still);
    }

    proptest! {
        #[test]
        fn a_look_at_nothing_or_back_in_time_is_still(at in 0..10_000u64, back in 0..10_000u64) {
            let mut watch = Watch::new(&Look::default(), Look::default());
            prop_assert_eq!(watch.look(look(at, &[]), false), Rest::Still);
            prop_assert_eq!(watch.look(look(back, &[]), true), Rest::Still);
        }

        #[test]
        fn whoever_wants_a_whole_processor_works_however_long_the_looks_are_apart(
            apart in 1..5_000u64, turns in 0..100u64,
        ) {
            let at = |at| look(at, &[(1, 1, at, turns, Waits::Else)]);
            let mut watch = Watch::new(&look(0, &[]), look(0, &[]));
            watch.begin(at(1));
            prop_assert_eq!(watch.look(at(1 + apart), false), Rest::Working);
        }
    }
}
