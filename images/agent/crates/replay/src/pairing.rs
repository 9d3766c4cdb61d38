//! Which answer belongs to which input, where a step goes by stamp.
//!
//! An answer can belong to an input if its stamp is not before the input's and not after the
//! latest that the stack can know: the stamps that were released last, and simulated time.
//! Each answer belongs to one input at most. So a stamp of the far future satisfies nothing,
//! and an old one is no answer to what came after it.

use std::collections::VecDeque;

/// What a stamp may lose on its way through seconds as a 64-bit float, in nanoseconds: half
/// a microsecond after 2038.
const ROUNDING: u64 = 1_000;
/// Stamps that are kept while nobody waits; older ones belong to nobody.
const KEPT: usize = 4_096;
/// Inputs that were not answered in time whose late answers are still known as such.
const REMEMBERED: usize = 1_024;

/// The stamps that can answer an input, in nanoseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    pub(crate) from: u64,
    pub(crate) to: u64,
}

/// Answers on one topic, and what they were taken for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Pairing {
    /// Stamps that were received and belong to no input yet.
    pending: VecDeque<u64>,
    /// The stamp that answered last; the same again is that answer published twice.
    paired: Option<u64>,
    /// Inputs that were not answered in time.
    missed: VecDeque<u64>,
    /// Whether an answer was due yet: a message before that answers nothing.
    begun: bool,
    /// Answers that belong to no input.
    unmatched: u64,
    /// The first of them, and what was awaited.
    strange: Option<(u64, Span)>,
}

impl Span {
    fn takes(&self, stamp: u64) -> bool {
        stamp.saturating_add(ROUNDING) >= self.from && stamp <= self.to.saturating_add(ROUNDING)
    }
}

impl Pairing {
    /// Takes an answer's stamp in.
    pub(crate) fn receive(&mut self, stamp: u64) {
        if self.pending.len() >= KEPT {
            self.pending.pop_front();
            self.unmatched += u64::from(self.begun);
        }
        self.pending.push_back(stamp);
    }

    /// An answer is due from now on. What was received before belongs to it only if another of
    /// the inputs that are fused was out already.
    pub(crate) fn begin(&mut self, due: Span, fused: bool) {
        if !fused || !self.begun {
            self.discard(due);
        }
        self.begun = true;
    }

    /// Whether the answer that is due has come. It is used up.
    pub(crate) fn take(&mut self, due: Span) -> bool {
        let late = |stamp: u64| {
            near(stamp, due.from).is_none()
                && self.missed.iter().any(|missed| near(stamp, *missed).is_some())
        };
        let found = self.pending.iter().position(|&stamp| due.takes(stamp) && !late(stamp));
        let Some(stamp) = found.and_then(|at| self.pending.remove(at)) else { return false };
        self.paired = Some(stamp);
        self.discard(due);
        true
    }

    /// The answer that was due did not come in time.
    pub(crate) fn miss(&mut self, due: Span) {
        if self.missed.len() >= REMEMBERED {
            self.missed.pop_front();
        }
        self.missed.push_back(due.from);
        self.discard(due);
    }

    /// Nobody waits any more: what is left belongs to nobody.
    pub(crate) fn end(&mut self) -> u64 {
        let last = self.paired.unwrap_or_default();
        self.discard(Span { from: last, to: last });
        self.unmatched
    }

    /// What the user should know of the answers that belong to no input.
    pub(crate) fn warning(&self, topic: &str) -> Option<String> {
        let (stamp, Span { from, to }) = self.strange?;
        let seconds =
            |stamp: u64| format!("{}.{:09}", stamp / 1_000_000_000, stamp % 1_000_000_000);
        let awaited = match from == to {
            true => seconds(from),
            false => format!("{} to {}", seconds(from), seconds(to)),
        };
        Some(format!(
            "{} messages of {topic} have stamps that answer no awaited input, the first {} where \
             {awaited} was awaited: they came too late, their header is not filled from the \
             input's, or /use_sim_time is not set",
            self.unmatched,
            seconds(stamp),
        ))
    }

    fn discard(&mut self, due: Span) {
        for stamp in std::mem::take(&mut self.pending) {
            let repeated = self.paired.is_some_and(|paired| near(stamp, paired).is_some());
            if self.begun && !repeated {
                self.unmatched += 1;
                self.strange.get_or_insert((stamp, due));
            }
        }
    }
}

/// Two stamps that are one, but for rounding.
fn near(one: u64, other: u64) -> Option<()> {
    (one.abs_diff(other) <= ROUNDING).then_some(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SECOND: u64 = 1_000_000_000;

    fn at(from: u64, to: u64) -> Span {
        Span { from, to }
    }

    /// Plays (input, answers to it) by one trigger; how many inputs were answered.
    fn play(turns: &[(u64, Vec<u64>)]) -> (u64, Pairing) {
        let (mut pairing, mut answered) = (Pairing::default(), 0);
        for (input, answers) in turns {
            let due = at(*input, *input);
            pairing.begin(due, false);
            answers.iter().for_each(|stamp| pairing.receive(*stamp));
            match pairing.take(due) {
                true => answered += 1,
                false => pairing.miss(due),
            }
        }
        pairing.end();
        (answered, pairing)
    }

    #[test]
    fn a_stamp_of_the_far_future_answers_nothing_and_an_old_one_neither() {
        let future = 4_102_444_800 * SECOND;
        let (answered, pairing) = play(&[
            (5 * SECOND, vec![future]),
            (6 * SECOND, vec![]),
            (7 * SECOND, vec![7 * SECOND]),
        ]);
        assert_eq!((answered, pairing.unmatched), (1, 1));
        assert_eq!(
            pairing.warning("/out").unwrap(),
            "1 messages of /out have stamps that answer no awaited input, the first \
             4102444800.000000000 where 5.000000000 was awaited: they came too late, their header \
             is not filled from the input's, or /use_sim_time is not set"
        );
        let (answered, pairing) = play(&[(5 * SECOND, vec![4 * SECOND]), (6 * SECOND, vec![0])]);
        assert_eq!((answered, pairing.unmatched), (0, 2));
    }

    #[test]
    fn a_late_answer_is_no_answer_to_what_follows_even_if_time_goes_back() {
        let (answered, pairing) = play(&[
            (5 * SECOND, vec![]),
            (6 * SECOND, vec![5 * SECOND]),
            (7 * SECOND, vec![6 * SECOND, 7 * SECOND]),
        ]);
        assert_eq!((answered, pairing.unmatched), (1, 2));
        // Between released stamps, 5 s could answer 3 s; but it answers what was missed.
        let mut pairing = Pairing::default();
        pairing.begin(at(5 * SECOND, 5 * SECOND), false);
        pairing.miss(at(5 * SECOND, 5 * SECOND));
        pairing.begin(at(3 * SECOND, 9 * SECOND), false);
        pairing.receive(5 * SECOND);
        assert!(!pairing.take(at(3 * SECOND, 9 * SECOND)));
        pairing.receive(4 * SECOND);
        assert!(pairing.take(at(3 * SECOND, 9 * SECOND)));
    }

    #[test]
    fn stamps_between_what_was_released_answer_and_rounded_ones_do() {
        let mut pairing = Pairing::default();
        let due = at(5 * SECOND, 6 * SECOND);
        for (stamp, answers) in [
            (5 * SECOND - 500, true),
            (5 * SECOND + SECOND / 2, true),
            (6 * SECOND + 500, true),
            (6 * SECOND + 2_000, false),
            (5 * SECOND - 2_000, false),
        ] {
            pairing.begin(due, false);
            pairing.receive(stamp);
            assert_eq!(pairing.take(due), answers, "{stamp}");
            pairing.miss(due);
        }
    }

    #[test]
    fn an_answer_before_the_first_input_or_published_twice_is_no_reason_to_warn() {
        let mut pairing = Pairing::default();
        pairing.receive(77);
        assert_eq!(pairing.end(), 0);
        let (answered, pairing) = play(&[(5, vec![5, 5]), (6_000, vec![6_000, 6_000, 6_000])]);
        assert_eq!((answered, pairing.unmatched, pairing.warning("/a")), (2, 0, None));
    }

    #[test]
    fn only_fused_inputs_are_answered_before_the_last_of_them_is_out() {
        let due = at(5 * SECOND, 6 * SECOND);
        for fused in [true, false] {
            let mut pairing = Pairing::default();
            pairing.begin(at(1, 1), fused);
            pairing.miss(at(1, 1));
            pairing.receive(5 * SECOND);
            pairing.begin(due, fused);
            assert_eq!(pairing.take(due), fused);
        }
    }

    #[test]
    fn stamps_that_nobody_asks_for_take_no_endless_memory() {
        let mut pairing = Pairing::default();
        pairing.begin(at(1, 1), true);
        (0..10_000u64).for_each(|number| pairing.receive(SECOND + number * 5_000));
        assert_eq!(pairing.pending.len(), KEPT);
        assert_eq!(pairing.end(), 10_000);
    }

    #[test]
    fn each_of_the_last_inputs_that_were_missed_is_remembered() {
        let mut pairing = Pairing::default();
        for second in [5, 6] {
            let due = at(second * SECOND, second * SECOND);
            pairing.begin(due, false);
            pairing.miss(due);
        }
        let due = at(3 * SECOND, 9 * SECOND);
        pairing.begin(due, false);
        [5, 6].into_iter().for_each(|late| pairing.receive(late * SECOND));
        assert!(!pairing.take(due));
        pairing.receive(4 * SECOND);
        assert!(pairing.take(due));
        (0..2_000).for_each(|input| pairing.miss(at(input, input)));
        assert_eq!((pairing.missed.len(), pairing.missed[0]), (1_024, 976));
    }

    fn stamps() -> impl Strategy<Value = u64> {
        let whole =
            prop_oneof![0..4u64, 2_147_483_640..2_147_483_655u64, 4_294_967_290..4_294_967_295u64];
        (whole, 0..4u64).prop_map(|(second, part)| second * SECOND + part * 250_000_000)
    }

    proptest! {
        #[test]
        fn a_faithful_node_is_answered_for_every_input_whatever_the_stamps(
            inputs in prop::collection::vec(stamps(), 1..40),
        ) {
            let turns: Vec<_> = inputs.iter().map(|stamp| (*stamp, vec![*stamp])).collect();
            let (answered, pairing) = play(&turns);
            prop_assert_eq!((answered, pairing.unmatched), (inputs.len() as u64, 0));
        }

        #[test]
        fn every_message_answers_one_input_at_most_and_only_one_with_its_stamp(
            turns in prop::collection::vec((stamps(), prop::collection::vec(stamps(), 0..4)), 0..40),
        ) {
            let (answered, pairing) = play(&turns);
            let right = turns.iter().filter(|(input, answers)| answers.contains(input)).count();
            let given: usize = turns.iter().map(|(_, answers)| answers.len()).sum();
            prop_assert_eq!(answered, right as u64);
            prop_assert!(answered + pairing.unmatched <= given as u64);
            prop_assert_eq!(pairing.unmatched > 0, pairing.strange.is_some());
        }
    }
}
