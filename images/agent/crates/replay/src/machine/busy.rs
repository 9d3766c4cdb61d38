//! Whether the machine could have caused a loss, or the stack's own load is all there was.
//!
//! A stack that keeps every processor busy makes its machine look busy. So a sign of want
//! (threads that wake late, tasks that wait for a processor, throttling) counts against the
//! machine only where somebody else's use of the processors, and not the stack's, explains it.

/// A thread that wakes so much later than it wants to could not have served a queue of one
/// at 20 Hz. On an idle machine wakes are late by a millisecond at most.
pub(crate) const STALL: f64 = 0.05;
/// The share of a slice in which tasks waited for a processor: below it, waiting is what a
/// stack's own threads do that wake at one time.
pub(crate) const WAITING: f64 = 0.10;
/// The share of the processors that others must have had: a quarter of the time is what a
/// node needs to miss that works at three quarters of its deadline.
pub(crate) const OTHERS: f64 = 0.25;
/// The share of the processors in use that counts as all of them, where the kernel does not
/// say whether anybody waited.
pub(crate) const FULL: f64 = 0.95;
/// The share of the processors' time that the hypervisor may give to others unnoticed:
/// shared machines show a percent or two all day.
pub(crate) const STEAL: f64 = 0.05;
/// Time without a processor because the pod's limit was used up: half of a period of the
/// kernel's bandwidth control (100 ms).
pub(crate) const THROTTLED: f64 = 0.05;
/// The share of its cgroup's use from which on a stack has used the limit up by itself.
pub(crate) const OWN_LIMIT: f64 = 0.75;
/// A stall of all processors needs that part of their time from whoever caused it; ticks
/// are coarse, so half is enough.
pub(crate) const EXPLAINS: f64 = 0.5;

/// A second or so of the play. Times in seconds, summed over processors where they add up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Slice {
    pub(crate) seconds: f64,
    /// How many processors we may use.
    pub(crate) processors: f64,
    /// The longest that a thread woke later than it wanted to.
    pub(crate) stall: f64,
    pub(crate) pressure: Option<f64>,
    pub(crate) throttled: Option<f64>,
    pub(crate) steal: Option<f64>,
    /// Processor time of the stack's processes.
    pub(crate) stack: f64,
    /// Of those that are neither the stack's nor ours.
    pub(crate) others: Option<f64>,
    /// Of everybody.
    pub(crate) used: Option<f64>,
    /// Of everybody in our cgroup.
    pub(crate) cgroup: Option<f64>,
}

/// What of the machine could have caused a loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Cause {
    /// The hypervisor gave our processors to others.
    Steal,
    /// The pod's limit was used up, and not by the stack.
    Throttled,
    /// Other processes had the processors.
    Others,
    /// Threads woke late, and nothing that the stack did explains it.
    Stall,
}

impl Slice {
    /// What of the machine could have caused a loss in this time, if anything.
    pub(crate) fn cause(&self) -> Option<Cause> {
        let capacity = self.seconds * self.processors;
        if capacity <= 0.0 {
            return None;
        }
        if self.steal.is_some_and(|steal| steal >= STEAL * capacity) {
            return Some(Cause::Steal);
        }
        let throttled = self.throttled.is_some_and(|throttled| throttled >= THROTTLED);
        let own_limit = self.cgroup.is_some_and(|cgroup| self.stack >= OWN_LIMIT * cgroup);
        if throttled && !own_limit {
            return Some(Cause::Throttled);
        }
        // Whoever has used up its own limit waits for that, and its threads wake late.
        let stalled = self.stall >= STALL && !throttled;
        let others = self.others.is_some_and(|others| others >= OTHERS * capacity);
        if others && (stalled || self.waited(capacity)) {
            return Some(Cause::Others);
        }
        let by_stack = self.stack >= EXPLAINS * self.stall * self.processors;
        (stalled && !by_stack).then_some(Cause::Stall)
    }

    /// Whether tasks waited for a processor that others had. Who is throttled waits too, by
    /// the kernel's count, but for its own limit.
    fn waited(&self, capacity: f64) -> bool {
        match (self.pressure, self.used) {
            (Some(pressure), _) => {
                pressure - self.throttled.unwrap_or(0.0) >= WAITING * self.seconds
            }
            (None, Some(used)) => used >= FULL * capacity,
            (None, None) => false,
        }
    }
}

/// Whether the machine could have caused a loss in any of these times, and why (not).
pub(crate) fn busy(slices: &[Slice]) -> (bool, String) {
    let all: f64 = slices.iter().map(|slice| slice.seconds).sum();
    let found: Vec<(Cause, &Slice)> =
        slices.iter().filter_map(|slice| Some((slice.cause()?, slice))).collect();
    let stall = slices.iter().map(|slice| slice.stall).fold(0.0, f64::max);
    let Some((cause, worst)) = found.iter().max_by(|a, b| weight(a).total_cmp(&weight(b))) else {
        return (false, calm(slices, stall));
    };
    let long: f64 = found.iter().map(|(_, slice)| slice.seconds).sum();
    let time = format!("in {long:.1} of {all:.1} s");
    let of = worst.seconds * worst.processors;
    // Ticks are coarse: a part may come out as more than the whole.
    let percent = |part: Option<f64>| (100.0 * part.unwrap_or(0.0) / of).min(100.0);
    let why = match cause {
        Cause::Steal => {
            format!(
                "its hypervisor took up to {:.0} % of the processors away",
                percent(worst.steal)
            )
        }
        Cause::Throttled => format!(
            "the pod was throttled for up to {:.2} s a second by its CPU limit, which others than \
             the stack used up",
            worst.throttled.unwrap_or(0.0) / worst.seconds
        ),
        Cause::Others => format!(
            "processes that are not the stack's had up to {:.0} % of the processors while tasks \
             here waited for one",
            percent(worst.others)
        ),
        Cause::Stall => format!(
            "threads woke up to {:.0} ms late, which nothing that the stack did explains",
            1e3 * worst.stall
        ),
    };
    (true, format!("the machine could have caused a loss: {time} {why}"))
}

fn weight((cause, slice): &(Cause, &Slice)) -> f64 {
    let part = match cause {
        Cause::Steal => slice.steal,
        Cause::Throttled => slice.throttled,
        Cause::Others => slice.others,
        Cause::Stall => Some(slice.stall),
    };
    part.unwrap_or(0.0) / slice.seconds.max(f64::MIN_POSITIVE)
}

fn calm(slices: &[Slice], stall: f64) -> String {
    let share = |part: fn(&Slice) -> f64| {
        let shares = slices.iter().map(|slice| part(slice) / (slice.seconds * slice.processors));
        100.0 * shares.filter(|share| share.is_finite()).fold(0.0, f64::max)
    };
    let stack = share(|slice| slice.stack);
    let others = match slices.iter().any(|slice| slice.others.is_some()) {
        true => format!("{:.0} %", share(|slice| slice.others.unwrap_or(0.0))),
        false => "an unknown part".to_owned(),
    };
    format!(
        "nothing of the machine explains a loss: threads woke at most {:.0} ms late, the stack had \
         up to {stack:.0} % of the processors and others {others}",
        1e3 * stall
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A second of two processors that nobody wants.
    fn idle() -> Slice {
        Slice {
            seconds: 1.0,
            processors: 2.0,
            stall: 0.001,
            pressure: Some(0.005),
            throttled: Some(0.0),
            steal: Some(0.0),
            stack: 0.1,
            others: Some(0.05),
            used: Some(0.2),
            cgroup: Some(0.15),
        }
    }

    #[test]
    fn a_stack_can_lose_on_an_idle_machine() {
        let (busy, why) = busy(&[idle(); 5]);
        assert!(!busy);
        assert_eq!(
            why,
            "nothing of the machine explains a loss: threads woke at most 1 ms late, the stack had \
             up to 5 % of the processors and others 2 %"
        );
    }

    #[test]
    fn a_stack_that_burns_all_processors_itself_has_no_excuse() {
        let burns = Slice {
            stall: 0.4,
            pressure: Some(1.0),
            stack: 1.9,
            used: Some(2.0),
            cgroup: Some(2.0),
            ..idle()
        };
        assert!(!busy(&[idle(), burns]).0);
        // Nor does it help to burn the pod's own limit.
        let limited =
            Slice { throttled: Some(0.7), stall: 0.08, stack: 0.9, cgroup: Some(1.0), ..idle() };
        assert!(!busy(&[limited]).0);
        // On a large machine, beside others who take nothing from it.
        let large = Slice {
            processors: 64.0,
            pressure: Some(0.72),
            others: Some(20.0),
            used: Some(21.0),
            ..limited
        };
        assert!(!busy(&[large]).0);
        assert!(busy(&[Slice { pressure: Some(0.95), ..large }]).0);
        // Others that run in between, as they do everywhere, are none.
        assert!(!busy(&[Slice { others: Some(0.3), ..burns }]).0);
    }

    #[test]
    fn a_starved_stack_is_excused_and_told_by_what() {
        let starved = Slice {
            pressure: Some(0.98),
            stack: 0.6,
            others: Some(1.4),
            used: Some(2.0),
            ..idle()
        };
        let (yes, why) = busy(&[idle(), starved, starved]);
        assert!(yes);
        assert_eq!(
            why,
            "the machine could have caused a loss: in 2.0 of 3.0 s processes that are not the \
             stack's had up to 70 % of the processors while tasks here waited for one"
        );
        let unsaid = Slice { pressure: None, ..starved };
        assert!(busy(&[unsaid]).0, "a kernel without pressure figures");
        assert!(!busy(&[Slice { used: Some(1.8), ..unsaid }]).0);
    }

    #[test]
    fn steal_throttling_by_others_and_stalls_that_nobody_explains_are_the_machine_s() {
        let why = |slice: Slice| busy(&[slice]).1;
        let stolen = why(Slice { steal: Some(0.2), ..idle() });
        assert!(stolen.contains("hypervisor took up to 10 % of the processors"), "{stolen}");
        assert!(!busy(&[Slice { steal: Some(0.09), ..idle() }]).0);
        let throttled = Slice { throttled: Some(0.3), stack: 0.2, cgroup: Some(1.0), ..idle() };
        assert!(why(throttled).contains("throttled for up to 0.30 s a second"));
        let paused = why(Slice { stall: 0.25, ..idle() });
        assert!(paused.contains("woke up to 250 ms late"), "{paused}");
        assert!(!busy(&[Slice { stall: 0.049, ..idle() }]).0);
    }

    #[test]
    fn what_the_machine_does_not_have_excuses_nobody() {
        let bare = Slice { seconds: 1.0, processors: 2.0, stall: 0.01, ..Slice::default() };
        assert!(!busy(&[bare]).0);
        assert!(!busy(&[]).0);
    }

    prop_compose! {
        fn any_slice()(
            seconds in 0.1..2.0f64, processors in 1.0..64.0f64, stall in 0.0..1.0f64,
            parts in prop::array::uniform3(0.0..1.0f64), pressure in prop::option::of(0.0..1.0f64),
            throttled in prop::option::of(0.0..1.0f64), steal in prop::option::of(0.0..0.3f64),
        ) -> Slice {
            let capacity = seconds * processors;
            let [stack, others, own] = parts.map(|part| part * capacity / 3.0);
            Slice {
                seconds, processors, stack, stall,
                pressure: pressure.map(|part| part * seconds),
                throttled: throttled.map(|part| part * seconds),
                steal: steal.map(|part| part * capacity),
                others: Some(others), used: Some(stack + others + own), cgroup: Some(stack + own),
            }
        }
    }

    proptest! {
        #[test]
        fn a_stack_alone_never_makes_its_machine_busy_by_burning(slice in any_slice()) {
            // All processors, nobody else, nothing stolen: whatever it stalls or waits.
            let all = slice.seconds * slice.processors;
            let stall = slice.stall.min(slice.seconds);
            let alone = Slice {
                stack: all, others: Some(0.0), steal: Some(0.0), stall, used: Some(all),
                cgroup: Some(all), ..slice
            };
            prop_assert!(!busy(&[alone]).0);
        }

        #[test]
        fn more_of_others_never_takes_the_excuse_away(slice in any_slice(), more in 0.0..1.0f64) {
            if slice.cause().is_some() {
                let others = slice.others.map(|others| others + more);
                let more = Slice { others, ..slice };
                prop_assert!(more.cause().is_some());
            }
        }

        #[test]
        fn one_bad_slice_is_enough_and_calm_ones_do_not_hide_it(
            slice in any_slice(), calm in 0..20usize,
        ) {
            let mut slices = vec![idle(); calm];
            slices.push(slice);
            let (busy, why) = busy(&slices);
            prop_assert_eq!(busy, slice.cause().is_some());
            prop_assert!(!why.is_empty() && !why.contains("NaN") && !why.contains("inf"));
        }
    }
}
