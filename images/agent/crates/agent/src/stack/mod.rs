//! Starting programs of the user's image for one case.

pub(crate) mod command;
pub(crate) mod end;
pub(crate) mod evidence;
pub(crate) mod exit_code;
pub(crate) mod nodes;
pub(crate) mod processes;
pub(crate) mod tail;
pub(crate) mod usage;
pub(crate) mod witness;

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::os::fd::OwnedFd;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bagpipe_wire::fifo;
use rustix::fs::{OFlags, fcntl_getfl, fcntl_setfl};
use rustix::process::Pid;

use crate::stack::command::{ENTRYPOINT, NotRunnable, not_started, prepare};
use crate::stack::end::{EndedBy, StackEnd};
use crate::stack::processes::{Children, Spared};
use crate::stack::tail::Tail;
use crate::stack::usage::{Sampled, UsageSampler};
use crate::stack::witness::{ProcessEnd, Watcher, Witness};

/// How long a stack may take to stop when the agent itself must end within 5 s.
pub const HURRY: Duration = Duration::from_secs(2);

/// A started program, its output followed.
#[derive(Debug)]
pub struct Program {
    pub pid: Pid,
    usage: Option<UsageSampler>,
    witness: Option<Witness>,
    stdout: Option<Tail>,
    stderr: Option<Tail>,
}

/// What programs of a case have in common.
#[derive(Debug)]
pub struct Surroundings<'a> {
    /// The case's own variables.
    pub environment: &'a BTreeMap<String, String>,
    /// What the middleware's nodes find in their environment, whatever the case's own says.
    pub variables: Variables,
    /// What goes before each line of output: slot and case.
    pub label: String,
}

/// Variables of a middleware.
#[derive(Debug, Default)]
pub struct Variables {
    pub set: Vec<(&'static str, OsString)>,
    pub removed: &'static [&'static str],
}

impl Surroundings<'_> {
    /// The PATH that the program is searched in.
    pub fn path(&self) -> String {
        let inherited = || std::env::var("PATH").unwrap_or_default();
        self.environment.get("PATH").cloned().unwrap_or_else(inherited)
    }

    /// True when a ROS environment is set up already.
    pub fn has_ros(&self) -> bool {
        ["ROS_PACKAGE_PATH", "ROS_ROOT", "AMENT_PREFIX_PATH"]
            .iter()
            .any(|name| self.environment.contains_key(*name) || std::env::var_os(name).is_some())
    }

    /// Starts the command in a process group of its own.
    pub fn start(
        &self,
        command: &[String],
        name: &str,
        children: &mut Children,
    ) -> Result<Program, NotRunnable> {
        let command = self.prepare(command)?;
        self.start_prepared(command, name, children)
    }

    fn prepare(&self, command: &[String]) -> Result<Command, NotRunnable> {
        let entrypoint = (!self.has_ros()).then_some(Path::new(ENTRYPOINT));
        prepare(command, &self.path(), entrypoint)
    }

    /// The same with a command whose program was found already.
    pub fn start_prepared(
        &self,
        mut command: Command,
        name: &str,
        children: &mut Children,
    ) -> Result<Program, NotRunnable> {
        let (pid, mut child) = self.spawn(command.stdin(Stdio::null()), children)?;
        let prefix = format!("[{} {name}]", self.label);
        let stdout = child.stdout.take().map(|stream| Tail::follow(stream, prefix.clone()));
        let stderr = child.stderr.take().map(|stream| Tail::follow(stream, prefix));
        Ok(Program { pid, usage: None, witness: None, stdout, stderr })
    }

    /// Starts the command with our ends of its stdin and stdout, which do not block.
    pub fn start_piped(
        &self,
        command: &[String],
        children: &mut Children,
    ) -> Result<(Program, OwnedFd, OwnedFd), NotRunnable> {
        let mut command = self.prepare(command)?;
        // The variable shows a program that its stdin holds frames, as a BinPipedRDD's.
        command.stdin(Stdio::piped()).env("BAGPIPE_BINPIPE", "1");
        let (pid, mut child) = self.spawn(&mut command, children)?;
        let stderr = child.stderr.take();
        let stderr = stderr.map(|stream| Tail::follow(stream, format!("[{}]", self.label)));
        let ends =
            child.stdin.take().map(OwnedFd::from).zip(child.stdout.take().map(OwnedFd::from));
        let (stdin, stdout) = ends.ok_or_else(|| NotRunnable("it has no pipes".to_owned()))?;
        for end in [&stdin, &stdout] {
            fifo::grow(end);
            fcntl_getfl(end)
                .and_then(|flags| fcntl_setfl(end, flags | OFlags::NONBLOCK))
                .map_err(|error| NotRunnable(format!("its pipes cannot be used: {error}")))?;
        }
        Ok((Program { pid, usage: None, witness: None, stdout: None, stderr }, stdin, stdout))
    }

    fn spawn(
        &self,
        command: &mut Command,
        children: &mut Children,
    ) -> Result<(Pid, Child), NotRunnable> {
        command
            .envs(self.environment)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .process_group(0);
        for name in self.variables.removed {
            command.env_remove(name);
        }
        command.envs(self.variables.set.iter().map(|(name, value)| (name, value)));
        let child = command.spawn().map_err(|error| not_started(command, &error))?;
        let pid = Pid::from_child(&child);
        children.watch(pid);
        Ok((pid, child))
    }
}

impl Program {
    /// Measures from now on what it and all that it starts use, and sees how each of them ends;
    /// `spared` processes do not count.
    pub fn measure(&mut self, spared: &Spared) {
        self.witness = Witness::start(spared);
        self.usage = Some(UsageSampler::start(spared));
    }

    /// By which others show a process that may end soon to who watches how all of them end, if anybody does.
    pub fn watcher(&self) -> Option<Watcher> {
        self.witness.as_ref().map(Witness::watcher)
    }

    /// The last lines on stderr so far.
    pub fn stderr(&self) -> Vec<String> {
        self.stderr.as_ref().map(Tail::lines).unwrap_or_default()
    }

    /// Asks it and all that it started to end, waits, ends what is left, and says how it
    /// went; `spared` processes are left alone. An error names what outlived even that.
    pub fn end(
        mut self,
        children: &mut Children,
        spared: &Spared,
        patience: Duration,
        label: &str,
    ) -> Result<StackEnd, String> {
        let itself = children.ended(self.pid).is_some();
        // What it says when it is asked to end is not why something ended before.
        let last_line = self.stderr().pop();
        let mut over = self.witness.as_ref().map(Witness::ending).unwrap_or_default();
        self.witness.iter().for_each(Witness::settle);
        let asked = Instant::now();
        let sampled = self.usage.take().map(|usage| usage.stop_sampling(spared));
        let killed = children.stop(Some(self.pid), &spared.pids(), patience)?;
        if killed > 0 {
            eprintln!("[{label}] {killed} processes did not end within {patience:?}: killed");
        }
        let ended = children.ended(self.pid);
        let pid = self.pid.as_raw_nonzero().get();
        let usage = sampled.map(Sampled::finish);
        over.extend(itself.then_some(pid));
        let (before, after) = self.witnessed(children, asked, &over);
        let (stdout, stderr) = self.output();
        Ok(StackEnd {
            exit_status: ended.and_then(|ended| ended.exit_status),
            signal: ended.and_then(|ended| ended.signal),
            stderr,
            stdout,
            ended_by: if itself { EndedBy::Itself } else { EndedBy::Agent },
            usage,
            ended: Vec::new(),
            left: Vec::new(),
            pid,
            before,
            after,
            last_line,
        })
    }

    /// The ends before anything was asked to end, those of `over` among them, and those after that.
    fn witnessed(
        &mut self,
        children: &Children,
        asked: Instant,
        over: &BTreeSet<i32>,
    ) -> (Vec<ProcessEnd>, Vec<ProcessEnd>) {
        let pid = self.pid.as_raw_nonzero().get();
        let mut ends = self.witness.take().map(Witness::finish).unwrap_or_default();
        if over.contains(&pid) && !ends.iter().any(|end| end.pid == pid) {
            ends.push(ProcessEnd { pid, name: String::new(), ended: None, at: asked });
        }
        for end in &mut ends {
            end.ended = children.collected(end.pid).or(end.ended);
            if over.contains(&end.pid) {
                end.at = end.at.min(asked);
            }
        }
        ends.sort_by_key(|end| end.at);
        ends.into_iter().partition(|end| end.at <= asked)
    }

    /// The last lines of stdout and stderr, once the program is gone.
    pub fn output(self) -> (Vec<String>, Vec<String>) {
        // Whoever could write is gone; what they wrote is read in no time.
        let patience = Duration::from_secs(1);
        let finish =
            |tail: Option<Tail>| tail.map(|tail| tail.finish(patience)).unwrap_or_default();
        (finish(self.stdout), finish(self.stderr))
    }
}
