//! A group of steps with one answer: when it is complete.

use std::time::Duration;

use crate::AnswerBy;
use crate::outcome::StepReport;

#[derive(Debug)]
pub(super) struct Group {
    pub(super) answer: String,
    pub(super) by: AnswerBy,
    pub(super) inputs: Vec<Input>,
    /// Whether no input of it needs to come, or to be answered.
    pub(super) skippable: bool,
    /// Up to where answers were due, as a count or a stamp.
    pub(super) due: Option<u64>,
    pub(super) report: StepReport,
}

#[derive(Debug)]
pub(super) struct Input {
    /// Its place among the published topics.
    pub(super) topic: usize,
    pub(super) optional: bool,
    pub(super) deadline: Duration,
    /// How many messages have come, or the latest of their stamps.
    pub(super) reached: Option<u64>,
    /// How many messages have come.
    pub(super) messages: u64,
    /// The stamp of the last message, if that is no later than an earlier one's.
    pub(super) again: Option<u64>,
}

impl Group {
    pub(super) fn new(answer: String, by: AnswerBy) -> Group {
        let report = StepReport { answer: answer.clone(), by, ..StepReport::default() };
        Group { answer, by, inputs: Vec::new(), skippable: true, due: None, report }
    }

    /// Takes an input in, with its stamp if it has one; if it is one of the group's, its deadline,
    /// and up to where an answer is due now, if one is.
    pub(super) fn take(
        &mut self,
        topic: usize,
        stamp: Option<u64>,
    ) -> Option<(Duration, Option<u64>)> {
        let input = self.inputs.iter_mut().find(|input| input.topic == topic)?;
        let deadline = input.deadline;
        input.messages += 1;
        match (self.by, stamp) {
            (AnswerBy::Count, _) => input.reached = Some(input.reached.unwrap_or(0) + 1),
            // Too short for its own definition: its answer can't be identified.
            (AnswerBy::Stamp, None) => return Some((deadline, None)),
            (AnswerBy::Stamp, stamp) if self.skippable => return Some((deadline, stamp)),
            (AnswerBy::Stamp, stamp) => {
                let later = stamp > input.reached;
                input.again = stamp.filter(|_| !later);
                input.reached = input.reached.max(stamp);
                self.begin_again();
            }
        }
        let reached = self.reached().filter(|reached| Some(*reached) > self.due);
        self.due = reached.or(self.due);
        Some((deadline, reached))
    }

    /// Forgets how far stamps had come once every input has come with no later one.
    fn begin_again(&mut self) {
        let mut required = self.inputs.iter_mut().filter(|input| !input.optional);
        if required.all(|input| input.again.is_some()) {
            for input in self.inputs.iter_mut().filter(|input| !input.optional) {
                input.reached = input.again.take();
            }
            self.due = None;
        }
    }

    /// Up to where the group is complete.
    fn reached(&self) -> Option<u64> {
        if self.skippable {
            return Some(self.inputs.iter().filter_map(|input| input.reached).sum());
        }
        let required = self.inputs.iter().filter(|input| !input.optional);
        required.map(|input| input.reached).min().flatten()
    }
}
