//! Lock-step: which answers an input must be followed by before the next one goes out.
//!
//! Steps with the same answer are one *group*: several inputs that the stack fuses into
//! one output. An answer is due once every input of the group that may not be skipped has
//! come; if all of them may be skipped, with each one. What counts as the answer:
//!
//! - by count: one more message than there was when the input that completed the group
//!   was released. Inputs that come twice before their partner keep their place: the n-th
//!   answer is due with the n-th message of the slowest input.
//! - by stamp: a message whose header stamp can belong to the inputs ([`crate::pairing`]): not
//!   before the stamp that every input of the group has reached, not after the latest that
//!   is out. A late answer to an earlier input does not count, and each one counts once.
//!   Where stamps stand still or run backward, a group is complete once all of its inputs
//!   have come again.

mod group;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{Middleware, ReadStamp, TopicInfo};

use crate::answers::{Answers, ReceivedAnswers};
use crate::names::resolved;
use crate::outcome::StepReport;
use crate::pairing::{Pairing, Span};
use crate::time::Time;
use crate::{AnswerBy, Meter, ReplayError, Step};
use group::{Group, Input};

/// The steps of a play.
#[derive(Debug, Default)]
pub(crate) struct Lockstep {
    groups: Vec<Group>,
    /// The latest stamp of each published topic whose messages have one.
    stamps: Vec<Option<u64>>,
    /// How to read it, by topic.
    readers: Vec<Option<ReadStamp>>,
    meter: Arc<Meter>,
}

/// An answer that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Due {
    group: usize,
    deadline: Duration,
    target: Target,
}

/// What has to come.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Target {
    /// So many messages.
    Count(u64),
    /// A message with such a stamp.
    Stamp(Span),
}

impl Lockstep {
    /// The steps over the published topics.
    ///
    /// # Errors
    /// A trigger is not played, or has no stamp to go by; steps of one answer disagree.
    pub(crate) fn new(
        steps: &[Step],
        topics: &[TopicInfo],
        middleware: &dyn Middleware,
    ) -> Result<Lockstep, ReplayError> {
        let reader = |info: &TopicInfo| middleware.read_stamp(&info.definition);
        let readers: Vec<Option<ReadStamp>> = topics.iter().map(reader).collect();
        let mut groups: Vec<Group> = Vec::new();
        for step in steps {
            let input = input(step, topics, &readers)?;
            let answer = resolved(&step.answer);
            let found = groups.iter().position(|group| group.answer == answer);
            let at = found.unwrap_or_else(|| {
                groups.push(Group::new(answer, step.by));
                groups.len() - 1
            });
            let group = &mut groups[at];
            if group.by != step.by {
                return Err(ReplayError::BadRequest(format!(
                    "the steps of the answer {} go by count and by stamp; it must be one of them",
                    group.answer
                )));
            }
            group.report.triggers.push(topics[input.topic].topic.clone());
            group.skippable &= input.optional;
            group.inputs.push(input);
        }
        Ok(Lockstep { groups, stamps: vec![None; readers.len()], readers, meter: Arc::default() })
    }

    /// Reports its waits to `meter` too.
    pub(crate) fn metered(self, meter: &Arc<Meter>) -> Lockstep {
        Lockstep { meter: Arc::clone(meter), ..self }
    }

    /// The topics of the answers.
    pub(crate) fn answers(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().map(|group| group.answer.as_str())
    }

    /// The topics of the answers, and whether they go by stamp.
    pub(crate) fn awaited(&self) -> impl Iterator<Item = (&str, bool)> {
        self.groups.iter().map(|group| (group.answer.as_str(), group.by == AnswerBy::Stamp))
    }

    /// The answers without which the play makes no sense.
    pub(crate) fn required(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().filter(|group| !group.skippable).map(|group| group.answer.as_str())
    }

    /// A message of a published topic goes out next, at simulated time `now`: which answers it
    /// makes due.
    pub(crate) fn release(
        &mut self,
        topic: usize,
        data: &[u8],
        now: Option<u64>,
        answers: &Answers,
    ) -> Vec<Due> {
        let stamp = self.readers.get(topic).copied().flatten().and_then(|read| read(data));
        if stamp.is_some() {
            self.stamps[topic] = stamp;
        }
        // A stack may stamp what it says with the time of anything that it knows of.
        let known = self.stamps.iter().copied().max().flatten().max(now);
        let mut dues = Vec::new();
        for (at, group) in self.groups.iter_mut().enumerate() {
            let Some((deadline, reached)) = group.take(topic, stamp) else { continue };
            let Some(from) = reached else { continue };
            let target = match group.by {
                AnswerBy::Count => {
                    let received = answers.of(&group.answer, |received| received.count);
                    Target::Count(received.unwrap_or_default() + 1)
                }
                AnswerBy::Stamp => {
                    let span = Span { from, to: known.unwrap_or(from).max(from) };
                    let fused = group.inputs.len() > 1;
                    pair(answers, &group.answer, |pairing| pairing.begin(span, fused));
                    Target::Stamp(span)
                }
            };
            group.report.released += 1;
            dues.push(Due { group: at, deadline, target });
        }
        dues
    }

    /// Waits for an answer that is due since `released`, looking up through `check` now and
    /// then. Its absence is counted, not an error.
    pub(crate) fn wait(
        &mut self,
        due: Due,
        released: Instant,
        answers: &Answers,
        time: &Time,
        mut check: impl FnMut() -> Result<(), ReplayError>,
    ) -> Result<(), ReplayError> {
        const LOOK: Duration = Duration::from_millis(10);
        let Some(group) = self.groups.get_mut(due.group) else { return Ok(()) };
        let come = |received: &mut ReceivedAnswers| match due.target {
            Target::Count(count) => received.count >= count,
            Target::Stamp(span) => {
                received.pairing.as_mut().is_some_and(|pairing| pairing.take(span))
            }
        };
        loop {
            let left = due.deadline.saturating_sub(time.now().duration_since(released));
            if answers.wait(&group.answer, time, left.min(LOOK), come) {
                let waited = time.now().duration_since(released);
                self.meter.answered(waited);
                let waited = waited.as_secs_f64();
                group.report.answered += 1;
                group.report.waited_seconds += waited;
                group.report.slowest_seconds = group.report.slowest_seconds.max(waited);
                return Ok(());
            }
            if answers.of(&group.answer, |received| received.unstamped) == Some(true) {
                return Err(no_stamp("answer", &group.answer));
            }
            if left.is_zero() {
                if let Target::Stamp(span) = due.target {
                    pair(answers, &group.answer, |pairing| pairing.miss(span));
                }
                self.meter.unanswered();
                match group.skippable {
                    true => group.report.skipped += 1,
                    false => group.report.no_output += 1,
                }
                return Ok(());
            }
            check()?;
        }
    }

    /// Published topics of which every message was answered, with the nodes that answered: they,
    /// and whoever they received it from, have called back. By count, an answer that was not
    /// awaited could have stood in for one that was. Of several inputs that may be skipped nobody
    /// knows which one an answer was for.
    pub(crate) fn answered(&self, answers: &Answers) -> Vec<(usize, BTreeSet<String>)> {
        let mut found = Vec::new();
        for group in self.groups.iter().filter(|group| !group.skippable || group.inputs.len() == 1)
        {
            let received =
                answers.of(&group.answer, |received| (received.count, received.publishers.clone()));
            let Some((count, publishers)) = received else { continue };
            let answered = group.report.answered;
            if group.by == AnswerBy::Count && count != answered {
                continue;
            }
            let whole = group.inputs.iter().filter(|input| input.messages == answered);
            found.extend(whole.map(|input| (input.topic, publishers.clone())));
        }
        found
    }

    /// What came of every group, and what the user should know of it, as sentences.
    pub(crate) fn reports(self, answers: &Answers) -> (Vec<StepReport>, Vec<String>) {
        let (mut reports, mut warnings) = (Vec::new(), Vec::new());
        for Group { answer, mut report, .. } in self.groups {
            pair(answers, &answer, |pairing| {
                report.unmatched = pairing.end();
                warnings.extend(pairing.warning(&answer));
            });
            reports.push(report);
        }
        (reports, warnings)
    }
}

fn input(
    step: &Step,
    topics: &[TopicInfo],
    readers: &[Option<ReadStamp>],
) -> Result<Input, ReplayError> {
    let trigger = resolved(&step.trigger);
    let Some(topic) = topics.iter().position(|info| info.topic == trigger) else {
        let names: Vec<&str> = topics.iter().map(|info| info.topic.as_str()).collect();
        return Err(ReplayError::BadRequest(format!(
            "the step's trigger {trigger} is not played; what is played is {}",
            if names.is_empty() { "nothing".to_owned() } else { names.join(", ") }
        )));
    };
    if step.by == AnswerBy::Stamp && readers[topic].is_none() {
        return Err(no_stamp("trigger", &trigger));
    }
    Ok(Input {
        topic,
        optional: step.optional,
        deadline: step.deadline,
        reached: None,
        messages: 0,
        again: None,
    })
}

/// Does something to what is known of an answer's stamps.
fn pair(answers: &Answers, topic: &str, then: impl FnOnce(&mut Pairing)) {
    answers.of(topic, |received| received.pairing.as_mut().map(then));
}

fn no_stamp(role: &str, topic: &str) -> ReplayError {
    ReplayError::BadRequest(format!(
        "the step's {role} {topic} can't go by stamp: its messages do not begin with a \
         std_msgs/Header; let the step go by count"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: u64 = 1_000_000_000;

    fn topics() -> Vec<TopicInfo> {
        let topic = |name: &str, definition: &str| TopicInfo {
            topic: name.to_owned(),
            definition: definition.into(),
            ..TopicInfo::default()
        };
        vec![
            topic("/left", "Header header"),
            topic("/right", "Header header"),
            topic("/x", "int8 x"),
        ]
    }

    fn ros1() -> bagpipe_ros1::Ros1 {
        bagpipe_ros1::Ros1 { master_uri: String::new() }
    }

    fn step(trigger: &str, by: AnswerBy, optional: bool) -> Step {
        let (trigger, answer) = (trigger.to_owned(), "/out".to_owned());
        Step { trigger, answer, deadline: Duration::ZERO, by, optional }
    }

    fn at(second: u32) -> Vec<u8> {
        [[0; 4], second.to_le_bytes(), [0; 4]].concat()
    }

    /// What each message of (topic, second) makes due.
    fn dues(steps: &[Step], messages: &[(usize, u32)]) -> Vec<Option<Target>> {
        let mut lockstep = Lockstep::new(steps, &topics(), &ros1()).unwrap();
        let answers = Answers::new(lockstep.awaited());
        let one = |(topic, second): &(usize, u32)| {
            lockstep.release(*topic, &at(*second), None, &answers).first().map(|due| due.target)
        };
        messages.iter().map(one).collect()
    }

    /// The seconds of the stamps that each message makes due.
    fn spans(steps: &[Step], messages: &[(usize, u32)]) -> Vec<Option<(u64, u64)>> {
        let span = |target| match target {
            Target::Stamp(Span { from, to }) => (from / SECOND, to / SECOND),
            Target::Count(_) => panic!("by count"),
        };
        dues(steps, messages).into_iter().map(|target| target.map(span)).collect()
    }

    #[test]
    fn fused_inputs_are_answered_once_all_of_them_have_come() {
        let steps = [step("/left", AnswerBy::Count, false), step("/right", AnswerBy::Count, false)];
        let due = dues(&steps, &[(0, 1), (1, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 9)]);
        let due: Vec<bool> = due.iter().map(Option::is_some).collect();
        assert_eq!(due, [false, true, false, false, true, true, false]);
    }

    #[test]
    fn by_stamp_the_slowest_input_says_how_far_the_answer_must_be() {
        let steps = [step("left", AnswerBy::Stamp, false), step("/right", AnswerBy::Stamp, false)];
        let due = spans(&steps, &[(0, 1), (0, 2), (1, 2), (1, 3), (0, 5)]);
        assert_eq!(due, [None, None, Some((2, 2)), None, Some((3, 5))]);
    }

    #[test]
    fn every_stamp_of_a_single_input_is_due_equal_backward_zero_and_after_2038() {
        for optional in [false, true] {
            let steps = [step("/left", AnswerBy::Stamp, optional)];
            let seconds = [5, 5, 3, 0, 0, 2_147_483_648, u32::MAX, u32::MAX, 1];
            let messages: Vec<(usize, u32)> = seconds.iter().map(|second| (0, *second)).collect();
            let due: Vec<_> =
                seconds.iter().map(|s| Some((u64::from(*s), u64::from(*s)))).collect();
            assert_eq!(spans(&steps, &messages), due);
        }
    }

    #[test]
    fn fused_inputs_whose_stamps_begin_again_are_complete_when_all_have() {
        let steps = [step("/left", AnswerBy::Stamp, false), step("/right", AnswerBy::Stamp, false)];
        let messages = [(0, 8), (1, 8), (0, 8), (1, 8), (0, 2), (1, 2), (0, 3), (1, 3)];
        let due = spans(&steps, &messages);
        let back = [Some((8, 8)), Some((2, 2)), Some((3, 3))];
        assert_eq!(due, [None, back[0], None, back[0], None, back[1], None, back[2]]);
        // One that only stumbles takes nothing from the others.
        let due = spans(&steps, &[(0, 8), (1, 8), (0, 7), (0, 9), (1, 9)]);
        assert_eq!(due, [None, Some((8, 8)), None, None, Some((9, 9))]);
    }

    #[test]
    fn a_step_reports_the_answers_that_belong_to_no_input() {
        let steps = [step("/left", AnswerBy::Stamp, false)];
        let mut lockstep = Lockstep::new(&steps, &topics(), &ros1()).unwrap();
        let answers = Answers::new(lockstep.awaited());
        for (input, stamp) in [(5, Some(4_000_000_000)), (6, None), (7, Some(7))] {
            let due = lockstep.release(0, &at(input), None, &answers)[0];
            if let Some(stamp) = stamp {
                pair(&answers, "/out", |pairing| pairing.receive(stamp * SECOND));
            }
            lockstep.wait(due, Instant::now(), &answers, &Time::Machine, || Ok(())).unwrap();
        }
        let (reports, warnings) = lockstep.reports(&answers);
        let counts = (reports[0].answered, reports[0].no_output, reports[0].unmatched);
        assert_eq!((counts, reports[0].released), ((1, 2, 1), 3));
        assert!(warnings[0].starts_with("1 messages of /out have stamps"), "{warnings:?}");
    }

    /// Releases (input, simulated time), then receives these stamps: was it answered?
    fn answered(
        lockstep: &mut Lockstep,
        answers: &Answers,
        (input, now): (u32, u64),
        stamps: &[u64],
    ) -> bool {
        let due = lockstep.release(0, &at(input), Some(now * SECOND), answers)[0];
        for stamp in stamps {
            pair(answers, "/out", |pairing| pairing.receive(stamp * SECOND));
        }
        let before = lockstep.groups[0].report.answered;
        lockstep.wait(due, Instant::now(), answers, &Time::Machine, || Ok(())).unwrap();
        lockstep.groups[0].report.answered > before
    }

    // Promise: late-answer-by-stamp
    #[test]
    fn a_late_answer_by_stamp_answers_nothing_that_follows_also_where_its_stamp_could() {
        let steps = [step("/left", AnswerBy::Stamp, false)];
        let mut lockstep = Lockstep::new(&steps, &topics(), &ros1()).unwrap();
        let answers = Answers::new(lockstep.awaited());
        let mut turn = |input, stamps: &[u64]| answered(&mut lockstep, &answers, input, stamps);
        assert!(!turn((5, 5), &[]));
        // In time's order the stamp is too old; its own answer counts all the same.
        assert!(!turn((6, 6), &[5]));
        assert!(turn((7, 7), &[6, 7]));
        // Once time has gone back, the late stamps lie among those that may answer.
        assert!(!turn((3, 9), &[5]));
        assert!(!turn((4, 9), &[6]));
        assert!(turn((2, 9), &[8]));
        let (reports, _) = lockstep.reports(&answers);
        let report = &reports[0];
        let counts = (report.released, report.answered, report.no_output, report.unmatched);
        assert_eq!(counts, (6, 2, 4, 4));
    }

    #[test]
    fn only_a_topic_of_which_every_message_was_answered_was_called_back() {
        let answered = |messages: &[u32], counts: &[u32], by: AnswerBy| {
            let steps = [step("/left", by, false)];
            let mut lockstep = Lockstep::new(&steps, &topics(), &ros1()).unwrap();
            let answers = Answers::new(lockstep.awaited());
            for (input, count) in messages.iter().zip(counts) {
                let due = lockstep.release(0, &at(*input), None, &answers)[0];
                for _ in 0..*count {
                    answers.of("/out", |received| received.count += 1);
                    pair(&answers, "/out", |pairing| pairing.receive(u64::from(*input) * SECOND));
                }
                lockstep.wait(due, Instant::now(), &answers, &Time::Machine, || Ok(())).unwrap();
            }
            let topics = lockstep.answered(&answers);
            topics.into_iter().map(|(topic, _)| topic).collect::<Vec<_>>()
        };
        assert_eq!(answered(&[1, 2, 3], &[1, 1, 1], AnswerBy::Count), [0]);
        assert_eq!(answered(&[1, 2, 3], &[1, 0, 1], AnswerBy::Count), [] as [usize; 0]);
        // Three answers to three messages, but one of them may be a timer's.
        assert_eq!(answered(&[1, 2, 3], &[1, 2, 1], AnswerBy::Count), [] as [usize; 0]);
        assert_eq!(answered(&[1, 2, 3], &[1, 2, 1], AnswerBy::Stamp), [0]);
        assert_eq!(answered(&[1, 2, 3], &[0, 1, 1], AnswerBy::Stamp), [] as [usize; 0]);
    }

    #[test]
    fn an_answer_may_carry_simulated_time() {
        let steps = [step("/left", AnswerBy::Stamp, false)];
        let mut lockstep = Lockstep::new(&steps, &topics(), &ros1()).unwrap();
        let answers = Answers::new(lockstep.awaited());
        let due = lockstep.release(0, &at(5), Some(6 * SECOND), &answers)[0];
        assert_eq!(due.target, Target::Stamp(Span { from: 5 * SECOND, to: 6 * SECOND }));
    }

    #[test]
    fn an_input_that_may_be_skipped_is_not_waited_for() {
        let steps = [step("/left", AnswerBy::Count, true), step("/right", AnswerBy::Count, false)];
        let due = dues(&steps, &[(0, 1), (1, 1), (1, 2), (0, 2)]);
        let due: Vec<bool> = due.iter().map(Option::is_some).collect();
        assert_eq!(due, [false, true, true, false]);
        let steps = [step("/left", AnswerBy::Count, true)];
        assert_eq!(dues(&steps, &[(0, 1), (0, 2)]).iter().flatten().count(), 2);
    }

    #[test]
    fn steps_that_make_no_sense_are_refused_with_a_sentence() {
        let refuse =
            |steps: &[Step]| Lockstep::new(steps, &topics(), &ros1()).unwrap_err().to_string();
        let absent = refuse(&[step("/nowhere", AnswerBy::Count, false)]);
        assert_eq!(
            absent,
            "the step's trigger /nowhere is not played; what is played is /left, /right, /x"
        );
        assert!(refuse(&[step("/x", AnswerBy::Stamp, false)]).contains("by stamp"));
        let both = [step("/left", AnswerBy::Stamp, false), step("/right", AnswerBy::Count, false)];
        assert!(refuse(&both).contains("must be one of them"));
    }

    #[test]
    fn an_answer_that_does_not_come_is_counted_and_no_error() {
        for (optional, no_output, skipped) in [(false, 1, 0), (true, 0, 1)] {
            let steps = [step("/x", AnswerBy::Count, optional)];
            let mut lockstep = Lockstep::new(&steps, &topics(), &ros1()).unwrap();
            let answers = Answers::new(lockstep.awaited());
            let due = lockstep.release(2, &[1], None, &answers)[0];
            lockstep.wait(due, Instant::now(), &answers, &Time::Machine, || Ok(())).unwrap();
            let report = &lockstep.reports(&answers).0[0];
            assert_eq!(
                (report.no_output, report.skipped, report.released),
                (no_output, skipped, 1)
            );
        }
    }
}
