//! Which ends of a stack's processes and nodes are evidence, and of what.

use std::time::Instant;

use bagpipe_replay::Stage;
use serde::{Deserialize, Serialize};

use crate::stack::nodes::{Before, Found, Known, absent};
use crate::stack::processes::Ended;
use crate::stack::witness::ProcessEnd;

/// Signals by which scripts and pipelines end their own helpers: INT, TERM, HUP, PIPE.
const ORDERLY: [i32; 4] = [1, 2, 13, 15];
/// Signals by which the agent ends a stack: INT, KILL, TERM.
const OURS: [i32; 3] = [2, 9, 15];
/// Signals of a fault in the program: ILL, TRAP, ABRT, BUS, FPE, SEGV, SYS.
const FAULTS: [i32; 7] = [4, 5, 6, 7, 8, 11, 31];

/// What an end is evidence of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cause {
    StackCrashed,
    StackExited,
    NodeGone,
    NodeRespawned,
}

impl Cause {
    /// Its name in RESULT, and as ABORT's reason.
    pub fn name(self) -> &'static str {
        match self {
            Cause::StackCrashed => "StackCrashed",
            Cause::StackExited => "StackExited",
            Cause::NodeGone => "NodeGone",
            Cause::NodeRespawned => "NodeRespawned",
        }
    }
}

/// What ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Thing {
    Command,
    Process,
    Node,
}

/// An entry of `stack.ended` in RESULT.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StackEnded {
    pub cause: Cause,
    pub what: Thing,
    pub name: String,
    pub exit_status: Option<i32>,
    pub signal: Option<i32>,
    /// Since the window's start.
    pub bag_seconds: Option<f64>,
    pub message: String,
}

/// How far the replay was, as it reported.
#[derive(Debug, Clone, Copy)]
pub struct Moment {
    pub at: Instant,
    pub stage: Stage,
    /// Since the window's start.
    pub bag_seconds: f64,
}

/// What is known of a stack before the agent ended it.
#[derive(Debug, Default)]
pub struct Facts<'a> {
    /// The command's process and program; None while it runs.
    pub command: Option<(i32, &'a str)>,
    /// In order of time.
    pub ends: &'a [ProcessEnd],
    /// What was seen to end later: of a node that had gone before, the notice may be late.
    pub after: &'a [ProcessEnd],
    /// Those that were there when the play began.
    pub nodes: Vec<(Known, Found)>,
    pub before: Before,
    pub course: &'a [Moment],
    /// The last line of stderr.
    pub last_line: Option<&'a str>,
}

impl Facts<'_> {
    /// Every end that is evidence, in order of time; nodes that only the master misses come last.
    pub fn evidence(&self) -> Vec<StackEnded> {
        let mut found: Vec<(Option<Instant>, StackEnded)> = Vec::new();
        let mut nodes_pids = Vec::new();
        for (node, state) in &self.nodes {
            // Of the others it is known that they lived when they were asked to end.
            let late = if *state == Found::Unreachable { self.after } else { &[] };
            let mut ends = self.ends.iter().chain(late.iter().filter(|end| !is_ours(end)));
            let end = ends.find(|end| Some(end.pid) == node.pid);
            nodes_pids.extend(node.pid);
            if let Some(cause) = self.of_node(*state, node.stayed, end) {
                found
                    .push((end.map(|end| end.at), self.entry(cause, Thing::Node, &node.name, end)));
            }
        }
        let command = self.command.map(|(pid, _)| pid);
        let end_of = |node: &Known| self.ends.iter().find(|end| Some(end.pid) == node.pid);
        for node in absent(&self.before, |node| end_of(node).map(|end| end.at)) {
            // Whose process is known already has its entry, or lived on.
            if node.pid.is_some_and(|pid| nodes_pids.contains(&pid) || command == Some(pid)) {
                continue;
            }
            let end = end_of(node);
            let Some(cause) = of_absent(node, end) else { continue };
            nodes_pids.extend(node.pid);
            found.push((end.map(|end| end.at), self.entry(cause, Thing::Node, &node.name, end)));
        }
        for end in self.ends.iter().filter(|end| !nodes_pids.contains(&end.pid)) {
            let command = self.command.filter(|(pid, _)| *pid == end.pid);
            let cause = match command {
                Some(_) => self.of_command(end),
                None => end
                    .ended
                    .and_then(|ended| ended.signal)
                    .filter(|s| !ORDERLY.contains(s))
                    .map(|_| Cause::StackCrashed),
            };
            let Some(cause) = cause else { continue };
            let (what, name) =
                command.map_or((Thing::Process, &*end.name), |(_, name)| (Thing::Command, name));
            found.push((Some(end.at), self.entry(cause, what, name, Some(end))));
        }
        found.sort_by_key(|(at, _)| (at.is_none(), *at));
        found.into_iter().map(|(_, entry)| entry).collect()
    }

    /// Nodes that were in the graph when all input was out and have left it since, while no process
    /// of theirs was seen to end. Whether they had received it all, the ledger knows.
    pub fn left(&self) -> Vec<String> {
        let has_left = |(node, state): &&(Known, Found)| {
            let ended = self.ends.iter().any(|end| Some(end.pid) == node.pid);
            *state == Found::Unregistered && node.stayed && !ended
        };
        self.nodes.iter().filter(has_left).map(|(node, _)| node.name.clone()).collect()
    }

    /// Exit status 0 with the last input received is how a stack says that it is done.
    fn of_node(&self, state: Found, stayed: bool, end: Option<&ProcessEnd>) -> Option<Cause> {
        if state == Found::Another {
            return Some(Cause::NodeRespawned);
        }
        let ended = end.and_then(|end| end.ended);
        match (state, end, ended) {
            (Found::Same, None, _) => None,
            (_, _, Some(ended)) if ended.exit_status != Some(0) => Some(Cause::StackCrashed),
            (Found::Unregistered, None, _) if stayed => None,
            (_, Some(end), Some(_)) if self.had_everything(end.at) => None,
            // It is not known how: one that took leave of the master did not crash.
            (Found::Unregistered, Some(end), None) if self.had_everything(end.at) => None,
            _ => Some(Cause::NodeGone),
        }
    }

    fn of_command(&self, end: &ProcessEnd) -> Option<Cause> {
        match end.ended {
            Some(Ended { exit_status: Some(0), .. }) if self.had_everything(end.at) => None,
            Some(Ended { exit_status: Some(0), .. }) | None => Some(Cause::StackExited),
            Some(_) => Some(Cause::StackCrashed),
        }
    }

    /// Whether all input was out at that time; a program without a course has its own rule.
    fn had_everything(&self, at: Instant) -> bool {
        let drain = self.course.iter().find(|moment| moment.stage == Stage::Drain);
        drain.map_or(self.course.is_empty(), |drain| drain.at <= at)
    }

    /// Whether the stack was still waited for at that time, or was waited for in vain.
    fn is_before_the_play(&self, at: Instant) -> bool {
        let played = self.course.iter().find(|moment| moment.stage != Stage::Subscribe);
        !self.course.is_empty() && played.is_none_or(|played| at < played.at)
    }

    fn bag_seconds(&self, at: Instant) -> Option<f64> {
        let after = self.course.partition_point(|moment| moment.at <= at);
        let before = self.course.get(after.checked_sub(1)?)?;
        let Some(next) = self.course.get(after) else { return Some(before.bag_seconds) };
        let whole = next.at.duration_since(before.at).as_secs_f64();
        let part = at.duration_since(before.at).as_secs_f64() / whole.max(1e-9);
        Some(before.bag_seconds + (next.bag_seconds - before.bag_seconds) * part)
    }

    fn entry(&self, cause: Cause, what: Thing, name: &str, end: Option<&ProcessEnd>) -> StackEnded {
        let ended = end.and_then(|end| end.ended);
        let bag_seconds = end.and_then(|end| self.bag_seconds(end.at));
        let bag_seconds = bag_seconds.map(|seconds| (seconds * 1000.0).round() / 1000.0);
        let mut message = match what {
            Thing::Node => format!("the node {name} "),
            Thing::Command => format!("the stack's command ({name}) "),
            Thing::Process => format!("a process of the stack ({name}) "),
        };
        message += &match (ended, end) {
            (Some(ended), _) => how(ended),
            (None, Some(_)) => "ended, and it is not known how".to_owned(),
            (None, None) if cause == Cause::NodeRespawned => "was registered again".to_owned(),
            (None, None) => "is gone from the ROS graph".to_owned(),
        };
        if end.is_some_and(|end| self.is_before_the_play(end.at)) {
            message += " before the play began";
        } else if let Some(seconds) = bag_seconds {
            message += &format!(" at {seconds:.1} s of the window");
        }
        if cause == Cause::NodeRespawned {
            message += ", and another process has its name now";
        }
        if let Some(line) = self.last_line {
            message += &format!("; the stack's last line on stderr: {line}");
        }
        let (exit_status, signal) =
            (ended.and_then(|e| e.exit_status), ended.and_then(|e| e.signal));
        StackEnded { cause, what, name: name.to_owned(), exit_status, signal, bag_seconds, message }
    }
}

/// Of a node that had left when the play began: a script may end one of its own before it starts the rest. How one ended
/// that took no leave may be unknown.
fn of_absent(node: &Known, end: Option<&ProcessEnd>) -> Option<Cause> {
    let Some(ended) = end.and_then(|end| end.ended) else {
        return node.stayed.then_some(Cause::NodeGone);
    };
    let by_signal = |signal: i32| !ORDERLY.contains(&signal);
    // A shell gives 128 and the signal.
    let by_status = |status: i32| status != 0 && by_signal(status - 128);
    let is_crash = ended.exit_status.is_some_and(by_status) || ended.signal.is_some_and(by_signal);
    is_crash.then_some(Cause::StackCrashed)
}

/// Whether a signal ended it that the agent sends: that does not show how a node went before.
fn is_ours(end: &ProcessEnd) -> bool {
    end.ended.and_then(|ended| ended.signal).is_some_and(|signal| OURS.contains(&signal))
}

/// Sentences on processes that broke when they were asked to end, which is no evidence: many
/// that work well do, in their last destructors.
pub fn warnings(after: &[ProcessEnd]) -> Vec<String> {
    let broken = after.iter().filter_map(|end| {
        let signal = end.ended?.signal.filter(|signal| FAULTS.contains(signal))?;
        let (name, signal) = (&end.name, named(signal));
        Some(format!("{name} was ended by {signal} when it was asked to end, after the case"))
    });
    broken.collect()
}

/// How something ended, as the end of a sentence.
pub fn how(ended: Ended) -> String {
    match ended {
        Ended { signal: Some(signal), .. } => format!("was ended by {}", named(signal)),
        _ => format!("ended with {ended}"),
    }
}

fn named(signal: i32) -> String {
    let name = match signal {
        4 => " (SIGILL)",
        6 => " (SIGABRT)",
        7 => " (SIGBUS)",
        8 => " (SIGFPE)",
        9 => " (SIGKILL, by itself or for lack of memory)",
        11 => " (SIGSEGV)",
        15 => " (SIGTERM)",
        _ => "",
    };
    format!("signal {signal}{name}")
}

#[cfg(test)]
mod tests;
