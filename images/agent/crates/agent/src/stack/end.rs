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
            end.ended = end.ended.or_else(|| failure(all, end.pid, end.at));
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
