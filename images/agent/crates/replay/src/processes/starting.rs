//! Whether a stack still starts: whether any process of it works before anything is published.
//!
//! A node that loads its libraries is not in the graph yet, so nothing there says that somebody
//! is still to come.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use super::rest::{Look, WORKING};
use super::threads::Waits;
use super::{descendants, leaves, look};

/// The time in which all must have rested.
const QUIET: Duration = Duration::from_millis(100);
/// Where somebody had to wait longer for a processor in it, all must rest once more: who works in turns with another
/// works less there than it would, and the threads of one look are seen one after the other.
const STARVED: Duration = Duration::from_millis(5);

/// The watch over all processes below one.
pub(crate) struct Starting {
    root: Option<u32>,
    born: Instant,
    last: Option<Look>,
    /// Whether all rested between the last two looks, and whether that is believed.
    rested: bool,
    rests: bool,
    over: bool,
    starved: Duration,
}

impl Starting {
    /// Without a root there is nothing that can be seen to start.
    pub(crate) fn below(root: Option<u32>) -> Starting {
        let born = Instant::now();
        let starved = Duration::ZERO;
        Starting { root, born, last: None, rested: false, rests: false, over: false, starved }
    }

    /// Whether nobody has worked for a while. `changed`, whether the graph has changed since the
    /// last call, restarts that while.
    pub(crate) fn is_over(&mut self, changed: bool) -> bool {
        self.over = (self.over && !changed) || self.rests(changed);
        self.over
    }

    /// The same, also where somebody has begun to work again since.
    pub(crate) fn rests(&mut self, changed: bool) -> bool {
        let Some(root) = self.root else { return true };
        let before = self.last.as_ref().filter(|_| !changed);
        if before.is_some_and(|before| self.born.elapsed() < before.at + QUIET) {
            return self.rests;
        }
        self.see(look(&descendants(root, &Default::default()), self.born), changed);
        self.rests
    }

    fn see(&mut self, now: Look, changed: bool) {
        let starved = self.last.as_ref().map_or(Duration::ZERO, |last| now.starved_since(last));
        let before = self.last.as_ref().filter(|_| !changed);
        let rested = before.is_some_and(|before| rested(before, &now));
        self.rests = rested && (self.rested || starved < STARVED);
        self.rested = rested;
        self.starved += starved;
        self.last = Some(now);
    }

    /// Whether processes were seen at the last look, and none of their threads slept until a time, after
    /// which it may go on with what it has begun.
    pub(crate) fn sees_nobody_sleep(&self) -> bool {
        let Some(last) = self.root.and(self.last.as_ref()) else { return false };
        !last.threads.is_empty() && last.threads.values().all(|(_, waits)| *waits != Waits::Time)
    }

    /// The processes that have started no other: what is still to come may come of these.
    pub(crate) fn leaves(&self) -> BTreeSet<i32> {
        self.root.map(leaves).unwrap_or_default()
    }

    /// For how long in all somebody could have worked and had no processor, as far as was looked.
    pub(crate) fn starved(&self) -> Duration {
        self.starved
    }
}

/// Whether no process came between two looks, and none worked. One that waits for a processor now
/// works: on a busy machine it may have had next to none of it.
fn rested(before: &Look, now: &Look) -> bool {
    let known: BTreeSet<i32> = before.threads.keys().map(|thread| thread.0).collect();
    now.threads.keys().all(|thread| known.contains(&thread.0))
        && now.threads.values().all(|(_, waits)| !waits.is_of_the_machine())
        && now.wanted_since(before).values().all(|part| *part < WORKING)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::processes::threads::Demand;

    #[test]
    fn a_process_that_works_or_is_new_is_still_starting() {
        let look = |at, threads: &[(i32, u64)]| Look {
            at: Duration::from_millis(at),
            threads: threads
                .iter()
                .map(|&(pid, ms)| {
                    let demand = Demand { nanoseconds: ms * 1_000_000, ..Demand::default() };
                    ((pid, pid), (demand, Waits::Else))
                })
                .collect(),
        };
        let before = look(0, &[(7, 50), (8, 20)]);
        assert!(rested(&before, &look(100, &[(7, 60), (8, 20)])));
        assert!(!rested(&before, &look(100, &[(7, 50), (8, 46)])));
        assert!(!rested(&before, &look(100, &[(7, 50), (8, 20), (9, 0)])));
        // Process ids start from the beginning some time.
        assert!(!rested(&before, &look(100, &[(7, 50), (8, 20), (3, 0)])));
        assert!(rested(&before, &look(100, &[(7, 50)])));
        // On a busy machine who works may get no processor all the while.
        let mut starved = look(100, &[(7, 50), (8, 20)]);
        starved.threads.get_mut(&(8, 8)).unwrap().1 = Waits::Processor;
        assert!(!rested(&before, &starved));
        starved.threads.get_mut(&(8, 8)).unwrap().0.nanoseconds += 1_000_000;
        assert!(!rested(&before, &starved));
    }

    #[test]
    fn on_a_busy_machine_all_must_rest_in_two_looks_in_a_row() {
        // A master and a node of it ask each other in turns, and each wants a fifth of a processor.
        let look = |at: u64, ran: u64, waited: u64| {
            let nanoseconds = (ran + waited) * 1_000_000;
            let demand = Demand { nanoseconds, waited: waited * 1_000_000, turns: 0 };
            let threads = [(7, 7), (8, 8)].map(|thread| (thread, (demand, Waits::Else)));
            Look { at: Duration::from_millis(at), threads: threads.into() }
        };
        let seen = |looks: &[(u64, u64, u64, bool)]| -> Vec<bool> {
            let mut starting = Starting::below(Some(7));
            let one = |&(at, ran, waited, changed): &(u64, u64, u64, bool)| {
                starting.see(look(at, ran, waited), changed);
                starting.rests
            };
            looks.iter().map(one).collect()
        };
        let starved = [(0, 0, 0, false), (100, 10, 10, false), (200, 20, 20, false)];
        assert_eq!(seen(&starved), [false, false, true]);
        let between = [(0, 0, 0, false), (100, 10, 10, false), (200, 50, 20, false)];
        assert_eq!(seen(&between), [false; 3]);
        let changed = [starved[0], starved[1], (200, 20, 20, true), (300, 30, 30, false)];
        assert_eq!(seen(&changed), [false; 4]);
        assert_eq!(seen(&[(0, 0, 0, false), (100, 20, 0, false)]), [false, true]);
        assert_eq!(seen(&[(0, 0, 0, false), (100, 16, 4, false)]), [false, true]);
    }

    #[test]
    fn somebody_sleeps_whose_thread_waits_for_a_time() {
        let seen = |root, waits: &[Waits]| {
            let mut starting = Starting::below(root);
            let threads = waits.iter().zip(1..);
            let threads = threads.map(|(waits, at)| ((at, at), (Demand::default(), *waits)));
            starting.last = Some(Look { at: Duration::ZERO, threads: threads.collect() });
            starting.sees_nobody_sleep()
        };
        assert!(seen(Some(7), &[Waits::Else, Waits::Bytes(3)]));
        assert!(!seen(Some(7), &[Waits::Else, Waits::Time]));
        // Where there is nothing to be seen nothing is known.
        assert!(!seen(Some(7), &[]));
        assert!(!seen(None, &[Waits::Else]));
        assert!(!Starting::below(Some(7)).sees_nobody_sleep());
    }

    #[test]
    fn what_works_is_waited_for_until_it_rests_and_a_changed_graph_restarts_the_wait() {
        let enough = std::env::temp_dir().join(format!("bagpipe-busy-{}", std::process::id()));
        // It ends by itself, too, where this fails.
        let busy = format!("timeout 60 sh -c 'while [ ! -e {} ]; do :; done'", enough.display());
        let script = format!("{busy} & wait");
        let mut busy = std::process::Command::new("sh").args(["-c", &script]).spawn().unwrap();
        let until = Instant::now() + Duration::from_secs(60);
        while descendants(busy.id(), &Default::default()).is_empty() {
            assert!(Instant::now() < until);
            std::thread::yield_now();
        }
        let mut starting = Starting::below(Some(busy.id()));
        let begun = Instant::now();
        while begun.elapsed() < 5 * QUIET {
            assert!(!starting.is_over(false));
            std::thread::sleep(Duration::from_millis(5));
        }
        std::fs::write(&enough, "").unwrap();
        busy.wait().unwrap();
        std::fs::remove_file(&enough).unwrap();
        let until = Instant::now() + Duration::from_secs(60);
        while !starting.is_over(false) {
            assert!(Instant::now() < until);
            std::thread::yield_now();
        }
        assert!(starting.is_over(false));
        assert!(starting.rests(false));
        assert!(!starting.is_over(true));
        assert!(Starting::below(None).is_over(true));
    }
}
