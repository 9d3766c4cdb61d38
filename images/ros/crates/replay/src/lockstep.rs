//! Lock-step: which answers an input must be followed by before the next one goes out.
//!
//! Steps with the same answer are one *group*: several inputs that the stack fuses into
//! one output. An answer is due once every input of the group that may not be skipped has
//! come; if all of them may be skipped, with each one. What counts as the answer:
//!
//! - by count: one more message than there was when the input that completed the group
//!   was released. Inputs that come twice before their partner keep their place: the n-th
//!   answer is due with the n-th message of the slowest input.
//! - by stamp: a message whose header stamp has reached the stamp that every input of the
//!   group has reached. A late answer to an earlier input does not count.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_ros::TopicInfo;

use crate::answers::{Answers, Heard};
use crate::outcome::StepReport;
use crate::request::resolved;
use crate::stamp::{has_header, stamp};
use crate::{AnswerBy, Meter, ReplayError, Step};

/// The steps of a play.
#[derive(Debug, Default)]
pub(crate) struct Lockstep {
    groups: Vec<Group>,
    meter: Arc<Meter>,
}

#[derive(Debug)]
struct Group {
    answer: String,
    by: AnswerBy,
    inputs: Vec<Input>,
    /// Whether no input of it needs to come, or to be answered.
    skippable: bool,
    /// Up to where answers were due, as a count or a stamp.
    due: Option<u64>,
    report: StepReport,
}

#[derive(Debug)]
struct Input {
    /// Its place among the published topics.
    topic: usize,
    optional: bool,
    deadline: Duration,
    /// How many messages have come, or their latest stamp.
    reached: Option<u64>,
}

/// An answer that is due.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Due {
    group: usize,
    deadline: Duration,
    target: u64,
}

impl Lockstep {
    /// The steps over the published topics.
    ///
    /// # Errors
    /// A trigger is not played, or has no stamp to go by; steps of one answer disagree.
    pub(crate) fn new(steps: &[Step], topics: &[TopicInfo]) -> Result<Lockstep, ReplayError> {
        let mut groups: Vec<Group> = Vec::new();
        for step in steps {
            let input = input(step, topics)?;
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
        Ok(Lockstep { groups, meter: Arc::default() })
    }

    /// Tells its waits to `meter` too.
    pub(crate) fn metered(self, meter: &Arc<Meter>) -> Lockstep {
        Lockstep { meter: Arc::clone(meter), ..self }
    }

    /// The topics of the answers.
    pub(crate) fn answers(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().map(|group| group.answer.as_str())
    }

    /// The answers without which the play makes no sense.
    pub(crate) fn required(&self) -> impl Iterator<Item = &str> {
        self.groups.iter().filter(|group| !group.skippable).map(|group| group.answer.as_str())
    }

    /// A message of a published topic goes out next: which answers it makes due.
    pub(crate) fn release(&mut self, topic: usize, data: &[u8], answers: &Answers) -> Vec<Due> {
        let mut dues = Vec::new();
        for (at, group) in self.groups.iter_mut().enumerate() {
            let Some(deadline) = group.take(topic, data) else { continue };
            let Some(reached) = group.reached().filter(|reached| Some(*reached) > group.due) else {
                continue;
            };
            group.due = Some(reached);
            let target = match group.by {
                AnswerBy::Count => answers.heard(&group.answer).count + 1,
                AnswerBy::Stamp => reached,
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
        mut check: impl FnMut() -> Result<(), ReplayError>,
    ) -> Result<(), ReplayError> {
        const LOOK: Duration = Duration::from_millis(10);
        let Some(group) = self.groups.get_mut(due.group) else { return Ok(()) };
        let come = |heard: Heard| match group.by {
            AnswerBy::Count => heard.count >= due.target,
            AnswerBy::Stamp => heard.stamp >= Some(due.target),
        };
        loop {
            let left = due.deadline.saturating_sub(released.elapsed());
            if answers.wait(&group.answer, left.min(LOOK), come) {
                let waited = released.elapsed();
                self.meter.answered(waited);
                let waited = waited.as_secs_f64();
                group.report.answered += 1;
                group.report.waited_seconds += waited;
                group.report.slowest_seconds = group.report.slowest_seconds.max(waited);
                return Ok(());
            }
            let heard = answers.heard(&group.answer);
            if group.by == AnswerBy::Stamp && heard.count > 0 && heard.stamp.is_none() {
                return Err(no_stamp("answer", &group.answer));
            }
            if left.is_zero() {
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

    /// What came of every group.
    pub(crate) fn reports(self) -> Vec<StepReport> {
        self.groups.into_iter().map(|group| group.report).collect()
    }
}

impl Group {
    fn new(answer: String, by: AnswerBy) -> Group {
        let report = StepReport { answer: answer.clone(), by: by.name(), ..StepReport::default() };
        Group { answer, by, inputs: Vec::new(), skippable: true, due: None, report }
    }

    /// Takes an input in; its deadline if it is one of the group's.
    fn take(&mut self, topic: usize, data: &[u8]) -> Option<Duration> {
        let input = self.inputs.iter_mut().find(|input| input.topic == topic)?;
        input.reached = match self.by {
            AnswerBy::Count => Some(input.reached.unwrap_or(0) + 1),
            AnswerBy::Stamp => input.reached.max(stamp(data)),
        };
        Some(input.deadline)
    }

    /// Up to where the group is complete.
    fn reached(&self) -> Option<u64> {
        if self.skippable {
            let reached = self.inputs.iter().map(|input| input.reached);
            return match self.by {
                AnswerBy::Count => Some(reached.flatten().sum()),
                AnswerBy::Stamp => reached.max().flatten(),
            };
        }
        let required = self.inputs.iter().filter(|input| !input.optional);
        required.map(|input| input.reached).min().flatten()
    }
}

fn input(step: &Step, topics: &[TopicInfo]) -> Result<Input, ReplayError> {
    let trigger = resolved(&step.trigger);
    let Some(topic) = topics.iter().position(|info| info.topic == trigger) else {
        let names: Vec<&str> = topics.iter().map(|info| info.topic.as_str()).collect();
        return Err(ReplayError::BadRequest(format!(
            "the step's trigger {trigger} is not played; what is played is {}",
            if names.is_empty() { "nothing".to_owned() } else { names.join(", ") }
        )));
    };
    if step.by == AnswerBy::Stamp && !has_header(&topics[topic].definition) {
        return Err(no_stamp("trigger", &trigger));
    }
    Ok(Input { topic, optional: step.optional, deadline: step.deadline, reached: None })
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
            definition: definition.to_owned(),
            ..TopicInfo::default()
        };
        vec![
            topic("/left", "Header header"),
            topic("/right", "Header header"),
            topic("/x", "int8 x"),
        ]
    }

    fn step(trigger: &str, by: AnswerBy, optional: bool) -> Step {
        let (trigger, answer) = (trigger.to_owned(), "/out".to_owned());
        Step { trigger, answer, deadline: Duration::ZERO, by, optional }
    }

    fn at(second: u32) -> Vec<u8> {
        [[0; 4], second.to_le_bytes(), [0; 4]].concat()
    }

    /// How many answers each message of (topic, second) makes due.
    fn dues(steps: &[Step], messages: &[(usize, u32)]) -> Vec<Option<u64>> {
        let mut lockstep = Lockstep::new(steps, &topics()).unwrap();
        let answers = Answers::new(lockstep.answers());
        let one = |(topic, second): &(usize, u32)| {
            lockstep.release(*topic, &at(*second), &answers).first().map(|due| due.target)
        };
        messages.iter().map(one).collect()
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
        let due = dues(&steps, &[(0, 1), (0, 2), (1, 2), (1, 3), (0, 5)]);
        assert_eq!(due, [None, None, Some(2 * SECOND), None, Some(3 * SECOND)]);
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
        let refuse = |steps: &[Step]| Lockstep::new(steps, &topics()).unwrap_err().to_string();
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
            let mut lockstep = Lockstep::new(&steps, &topics()).unwrap();
            let answers = Answers::new(lockstep.answers());
            let due = lockstep.release(2, &[1], &answers)[0];
            lockstep.wait(due, Instant::now(), &answers, || Ok(())).unwrap();
            let report = &lockstep.reports()[0];
            assert_eq!(
                (report.no_output, report.skipped, report.released),
                (no_output, skipped, 1)
            );
        }
    }
}
