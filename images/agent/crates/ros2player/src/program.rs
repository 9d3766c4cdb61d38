//! The program as a process: started, watched, ended.

use std::collections::VecDeque;
use std::io::{BufRead, BufReader, ErrorKind, Read};
use std::os::fd::{AsFd, OwnedFd};
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering::SeqCst};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, WaitId, WaitIdOptions};

use crate::PlayerError;
use crate::options::PlayerOptions;

/// What is kept of its standard error.
const LINES: usize = 20;
const LINE_BYTES: u64 = 500;
/// How many of them an error has of a program that runs: what was refused, and not how it began.
const LAST: usize = 3;
/// How long its end and its last lines are waited for once its socket is closed, which takes a while
/// on a busy machine: others may have its standard error.
const LAST_LINES: Duration = Duration::from_secs(2);
/// And what it has written already, by who reads it on a machine that gives that no processor.
const UNREAD: Duration = Duration::from_secs(5);
/// A program that runs on has written all when nothing more comes for so long.
const QUIET: Duration = Duration::from_millis(50);
/// How long it may take to end by itself after SIGTERM, and then after SIGKILL.
const GRACE: Duration = Duration::from_millis(1500);
const KILLED: Duration = Duration::from_secs(5);

pub(crate) struct Program {
    shared: Arc<Shared>,
    pid: u32,
    /// The same pipe as who reads its standard error has: how much is in it.
    errors: Option<OwnedFd>,
}

struct Shared {
    child: Mutex<Child>,
    ended: AtomicBool,
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Default)]
struct State {
    /// How it ended.
    status: Option<String>,
    /// Nothing more comes on its standard error.
    closed: bool,
    lines: VecDeque<String>,
    /// How many lines there were.
    read: u64,
}

impl Program {
    /// Starts the program with `socket` as its standard input.
    pub(crate) fn start(options: &PlayerOptions, socket: OwnedFd) -> Result<Program, PlayerError> {
        let failed = |error| PlayerError::Program { program: options.program.clone(), error };
        let mut command = Command::new(&options.program);
        command.envs(options.environment.iter().map(|(name, value)| (name, value)));
        for name in &options.removed {
            command.env_remove(name);
        }
        command.stdin(Stdio::from(socket)).stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(failed)?;
        let pid = child.id();
        let errors = child.stderr.take();
        let shared = Arc::new(Shared {
            child: Mutex::new(child),
            ended: AtomicBool::new(false),
            state: Mutex::default(),
            changed: Condvar::new(),
        });
        let pipe = errors.as_ref().map(|errors| errors.as_fd().try_clone_to_owned());
        let pipe = pipe.transpose().map_err(failed)?;
        let program = Program { shared: Arc::clone(&shared), pid, errors: pipe };
        let watched = Arc::clone(&shared);
        thread("ros2player end", move || watched.watch(pid)).map_err(failed)?;
        thread("ros2player errors", move || shared.read(errors)).map_err(failed)?;
        Ok(program)
    }

    pub(crate) fn pid(&self) -> u32 {
        self.pid
    }

    pub(crate) fn has_ended(&self) -> bool {
        self.shared.ended.load(SeqCst)
    }

    /// How it ended; waits a moment for its last lines, and if it is about to end. `None` if it
    /// runs on.
    pub(crate) fn end(&self) -> Option<PlayerError> {
        let until = Instant::now() + LAST_LINES;
        let over = |state: &State| state.status.is_some() && state.closed;
        let state = self.shared.wait(until, over);
        let status = state.status.clone()?;
        Some(PlayerError::Ended { status, errors: state.lines.iter().cloned().collect() })
    }

    /// The last lines of its standard error, while it runs: waits a moment for those on their way.
    pub(crate) fn last_lines(&self) -> Vec<String> {
        let unread = Instant::now() + UNREAD;
        while self.has_unread() && Instant::now() < unread {
            drop(self.shared.wait(Instant::now() + QUIET, |state| state.closed));
        }
        let until = Instant::now() + LAST_LINES;
        let mut state = self.shared.wait(until, |state| state.closed || state.read > 0);
        loop {
            let read = state.read;
            drop(state);
            let quiet = until.min(Instant::now() + QUIET);
            state = self.shared.wait(quiet, |state| state.closed || state.read != read);
            if state.closed || state.read == read || Instant::now() >= until {
                let before = state.lines.len().saturating_sub(LAST);
                return state.lines.range(before..).cloned().collect();
            }
        }
    }

    /// Whether it has written what nobody has read yet.
    fn has_unread(&self) -> bool {
        let waiting = self.errors.as_ref().map(rustix::io::ioctl_fionread);
        waiting.is_some_and(|waiting| waiting.is_ok_and(|bytes| bytes > 0))
    }

    fn signal(&self, signal: Signal) {
        // While the lock is held nobody else can have got its number: it is no more than a zombie.
        let _child = lock(&self.shared.child);
        if !self.has_ended()
            && let Some(pid) = Pid::from_raw(self.pid.cast_signed())
        {
            // If there is none it has ended.
            let _sent = rustix::process::kill_process(pid, signal);
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        for (signal, limit) in [(Signal::TERM, GRACE), (Signal::KILL, KILLED)] {
            self.signal(signal);
            let state = self.shared.wait(Instant::now() + limit, |state| state.status.is_some());
            if state.status.is_some() {
                return;
            }
        }
    }
}

impl Shared {
    /// Waits until it has ended, and leaves no zombie.
    fn watch(&self, pid: u32) {
        if let Some(pid) = Pid::from_raw(pid.cast_signed()) {
            // The number stays its own until the lock is had.
            let wanted = WaitIdOptions::EXITED | WaitIdOptions::NOWAIT;
            let wait = || rustix::process::waitid(WaitId::Pid(pid), wanted).err();
            while wait() == Some(rustix::io::Errno::INTR) {}
        }
        let status = {
            let mut child = lock(&self.child);
            let status = child.wait();
            self.ended.store(true, SeqCst);
            status
                .map_or_else(|error| format!("its status is lost: {error}"), |all| all.to_string())
        };
        lock(&self.state).status = Some(status);
        self.changed.notify_all();
    }

    /// Reads its standard error to the end; a line's beginning is kept, of the last lines.
    fn read(&self, errors: Option<ChildStderr>) {
        let mut from = errors.map(BufReader::new);
        while let Some(errors) = &mut from {
            let mut line = Vec::new();
            match errors.by_ref().take(LINE_BYTES).read_until(b'\n', &mut line) {
                Ok(0) => break,
                Ok(_) => {}
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Err(_) => break,
            }
            let mut state = lock(&self.state);
            if state.lines.len() == LINES {
                state.lines.pop_front();
            }
            state.lines.push_back(String::from_utf8_lossy(&line).trim_end().to_owned());
            state.read += 1;
            drop(state);
            self.changed.notify_all();
        }
        lock(&self.state).closed = true;
        self.changed.notify_all();
    }

    /// Waits until `holds` or `until` is past.
    fn wait(&self, until: Instant, holds: impl Fn(&State) -> bool) -> MutexGuard<'_, State> {
        let limit = until.saturating_duration_since(Instant::now());
        let waited = self.changed.wait_timeout_while(lock(&self.state), limit, |now| !holds(now));
        waited.unwrap_or_else(PoisonError::into_inner).0
    }
}

fn thread(name: &str, body: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
    std::thread::Builder::new().name(name.into()).spawn(body).map(drop)
}

/// The lock, whoever panicked with it: nothing here leaves half of a change.
pub(crate) fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}
