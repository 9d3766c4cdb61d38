//! How a stack ended, as RESULT has it.

use std::collections::BTreeSet;

use bagpipe_wire::Abort;
use serde::{Deserialize, Serialize};

use crate::stack::evidence::{Cause, Facts, Moment, StackEnded};
use crate::stack::exit_code::{Exit, failure};
use crate::stack::nodes::Nodes;
use crate::stack::usage::Usage;
use crate::stack::witness::ProcessEnd;

/// Who ended the user's command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EndedBy {
    /// It ended when it was asked to.
    Agent,
    /// It had ended before.
    Itself,
}

/// How the user's command ended.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct StackEnd {
    pub exit_status: Option<i32>,
    pub signal: Option<i32>,
    pub stderr: Vec<String>,
    pub stdout: Vec<String>,
    pub ended_by: EndedBy,
    /// None for a program that was not measured.
    pub usage: Option<Usage>,
    /// Every end of a process or node that is evidence, in order of time.
    pub ended: Vec<StackEnded>,
    /// Nodes that have left the graph since all input was out, while their processes lived on.
    #[serde(default)]
    pub left: Vec<String>,
    #[serde(skip)]
    pub pid: i32,
    /// What ended before anything was asked to, in order of time.
    #[serde(skip)]
    pub before: Vec<ProcessEnd>,
    #[serde(skip)]
    pub after: Vec<ProcessEnd>,
    /// The last line of stderr before that.
    #[serde(skip)]
    pub last_line: Option<String>,
}

/// What goes wrong because something of the stack crashed before.
const CONSEQUENCES: [&str; 6] = [
    "StackExited",
    "NeverSubscribed",
    "NodeInactive",
    "StackStoppedReading",
    "RosMasterFailed",
    "CaseDeadlineExceeded",
];

impl StackEnd {
    /// Finds what of all that ended is evidence.
    pub fn judge(&mut self, command: &[String], nodes: Nodes, course: &[Moment], last_line: bool) {
        let command = command.first().map(|program| (self.pid, program.as_str()));
        let last_line = self.last_line.as_deref().filter(|_| last_line);
        let Nodes { there, before } = nodes;
        let facts = Facts {
            command,
            ends: &self.before,
            after: &self.after,
            nodes: there,
            before,
            course,
            last_line,
        };
        self.ended = facts.evidence();
        self.left = facts.left();
    }

    /// Adds how processes failed by what they noted themselves: of those that the kernel says nothing of, and of those
    /// that lived too short to be seen. `before` are what was noted when nobody had been asked to end.
    pub fn complete(&mut self, before: &[Exit], all: &[Exit]) {
        for end in self.before.iter_mut().chain(&mut self.after) {
            let noted =
                || failure(all, end.pid, end.at).or_else(|| failure(before, end.pid, end.at));
            end.ended = end.ended.or_else(noted);
        }
        // Who was on its way out, and was ended on it.
        for mut end in self.after.extract_if(.., |end| failure(before, end.pid, end.at).is_some()) {
            end.ended = failure(before, end.pid, end.at);
            self.before.push(end);
        }
        let seen: BTreeSet<i32> =
            self.before.iter().chain(&self.after).map(|end| end.pid).collect();
        let unseen = before.iter().filter(|exit| !seen.contains(&exit.pid));
        // It was short, so that its beginning is as good as its end.
        self.before.extend(unseen.filter_map(|exit| {
            let ended = Some(exit.failure()?);
            Some(ProcessEnd { pid: exit.pid, name: String::new(), ended, at: exit.began })
        }));
        self.before.sort_by_key(|end| end.at);
    }

    /// Forgets what a job allows: it is no reason for anything else.
    pub fn forgive(&mut self, allows: impl Fn(&str) -> bool) {
        self.ended.retain(|end| !allows(end.cause.name()));
    }

    /// The first crash of something of it.
    pub fn crash(&self) -> Option<&StackEnded> {
        self.ended.iter().find(|end| end.cause == Cause::StackCrashed)
    }

    /// Adds what the program wrote and how it ended.
    pub fn explain(self, mut abort: Abort) -> Abort {
        let itself = self.ended_by == EndedBy::Itself;
        if matches!(&*abort.reason, "StackExited" | "StackCrashed")
            && matches!(self.exit_status, Some(126 | 127))
        {
            // A shell or the image's entrypoint was found; what it should run was not.
            let last = self.stderr.last().map_or("", String::as_str);
            abort.message =
                format!("{} (a shell's sign of a missing command: {last})", abort.message);
        }
        if let Some(crash) = self.crash().filter(|_| CONSEQUENCES.contains(&&*abort.reason)) {
            abort.message = format!("{}; then: {}", crash.message, abort.message);
            abort.reason = crash.cause.name().to_owned();
        }
        abort.exit_status = self.exit_status.filter(|_| itself);
        abort.signal = self.signal.filter(|_| itself);
        abort.stderr = self.stderr;
        abort.stdout = self.stdout;
        abort
    }
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::stack::processes::Ended;

    /// The ends before and after a stack was asked to end, each by its process and how it ended.
    type Ends = (Vec<(i32, Option<Ended>)>, Vec<(i32, Option<Ended>)>);

    const ASKED: u64 = 10;

    fn status(status: i32) -> Option<Ended> {
        Some(Ended { exit_status: Some(status), signal: None })
    }

    const KILLED: Option<Ended> = Some(Ended { exit_status: None, signal: Some(9) });

    /// What becomes of ends at these seconds by exits that were noted `before` it was asked, and `all`.
    fn completed(
        ends: &[(i32, u64, Option<Ended>)],
        before: &[(i32, i32)],
        all: &[(i32, i32)],
    ) -> Ends {
        let zero = Instant::now();
        let at = |second| zero + Duration::from_secs(second);
        let end = |&(pid, second, ended): &(i32, u64, Option<Ended>)| ProcessEnd {
            pid,
            name: String::new(),
            ended,
            at: at(second),
        };
        let (earlier, later) = ends.iter().map(end).partition(|end| end.at <= at(ASKED));
        let exits = |noted: &[(i32, i32)]| -> Vec<Exit> {
            let exit = |&(pid, status)| Exit { pid, began: at(1), status: Some(status) };
            noted.iter().map(exit).collect()
        };
        let mut stack = StackEnd {
            exit_status: None,
            signal: Some(2),
            stderr: Vec::new(),
            stdout: Vec::new(),
            ended_by: EndedBy::Agent,
            usage: None,
            ended: Vec::new(),
            left: Vec::new(),
            pid: 1,
            before: earlier,
            after: later,
            last_line: None,
        };
        stack.complete(&exits(before), &exits(all));
        let short = |ends: &[ProcessEnd]| ends.iter().map(|end| (end.pid, end.ended)).collect();
        (short(&stack.before), short(&stack.after))
    }

    #[test]
    fn what_was_noted_counts_where_nobody_else_knows_it() {
        let noted = [(7, 3)];
        assert_eq!(completed(&[(7, 5, None)], &noted, &noted), (vec![(7, status(3))], vec![]));
        assert_eq!(completed(&[(7, 5, KILLED)], &noted, &noted), (vec![(7, KILLED)], vec![]));
        assert_eq!(completed(&[(7, 5, None)], &[(7, 0)], &[(7, 0)]), (vec![(7, None)], vec![]));
        // Nobody saw its end, and of one that ended well nobody has to.
        assert_eq!(completed(&[], &noted, &noted), (vec![(7, status(3))], vec![]));
        assert_eq!(completed(&[], &[(7, 0)], &[(7, 0)]), (vec![], vec![]));
    }

    #[test]
    fn who_was_on_its_way_out_when_it_was_asked_to_end_failed_before_that() {
        let noted = [(7, 3)];
        assert_eq!(completed(&[(7, 15, KILLED)], &noted, &noted), (vec![(7, status(3))], vec![]));
        // It answers so to the question.
        assert_eq!(completed(&[(7, 15, None)], &[], &noted), (vec![], vec![(7, status(3))]));
    }
}
