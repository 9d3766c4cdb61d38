//! Moves frames between the worker and the program, both ways at once, without keeping them.

use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use bagpipe_wire::{End, FrameType, OwnedFrame, PipeError, from_map, to_map};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::Pid;

use super::input::ProgramInput;
use super::output::ProgramOutput;
use super::rules::{Announced, Emitted, FileFlow, Way};
use super::{ExecRunner, UNREAD};
use crate::case::failure::Failure;
use crate::case::seconds;
use crate::stack::evidence::how;
use crate::stack::processes::Ended;

/// The longest wait for any pipe before the processes are looked at.
const GLANCE: Duration = Duration::from_millis(20);
/// Between two looks at the worker and the clock while bytes move.
const LOOK: Duration = Duration::from_millis(5);

/// The program's two streams, and what is known of both directions.
pub struct Pump<'a> {
    pub runner: &'a ExecRunner<'a>,
    pub pid: Pid,
    pub input: ProgramInput,
    pub output: ProgramOutput,
    pub emitted: Emitted,
    pub incoming: FileFlow,
    /// The worker's END came.
    pub fed: bool,
    pub glanced: Option<Instant>,
    /// When the program's END came.
    pub completed: Option<Instant>,
}

impl Pump<'_> {
    /// Moves frames until the program has sent END and ended well.
    pub fn run(&mut self) -> Result<(), Failure> {
        loop {
            self.look()?;
            let fed = self.feed()?;
            let drained = self.drain()?;
            if fed || drained {
                continue;
            }
            let ended = self.runner.children.borrow_mut().ended(self.pid);
            if let Some(ended) = ended {
                // What it wrote last may have come after the look before.
                while self.drain()? {
                    self.look()?;
                }
                return self.check_ended(ended);
            }
            self.wait().map_err(|error| Failure::new("Internal", error.to_string()))?;
        }
    }

    /// One frame of the worker's, if the last one is written.
    fn feed(&mut self) -> Result<bool, Failure> {
        let mut moved = false;
        if self.input.is_idle() && !self.fed {
            let frame = self.runner.link.borrow_mut().glance()?;
            if let Some(frame) = frame {
                self.take(frame)?;
                moved = true;
            }
        }
        Ok(self.input.write()? || moved)
    }

    fn take(&mut self, frame: OwnedFrame) -> Result<(), Failure> {
        let OwnedFrame { kind, payload, .. } = frame;
        match kind {
            FrameType::File => {
                let file: Announced = understood(&payload, kind)?;
                self.incoming.begin(&file).map_err(Failure::protocol)?;
                self.input.put(kind, payload)
            }
            FrameType::Data => {
                self.incoming.take(payload.len() as u64).map_err(Failure::protocol)?;
                self.input.put(kind, payload)
            }
            FrameType::End => {
                self.check_end(understood(&payload, kind)?)?;
                self.fed = true;
                let end = to_map(&self.input.given())
                    .map_err(|error| Failure::new("Internal", error.to_string()))?;
                self.input.put(kind, end)
            }
            FrameType::Abort => Err(Failure::Silent("the worker aborted the case".to_owned())),
            _ => Err(Failure::protocol(format!("expected FILE, DATA or END: {}", kind.name()))),
        }
    }

    fn check_end(&self, claimed: End) -> Result<(), Failure> {
        self.incoming.check_complete().map_err(Failure::protocol)?;
        self.runner.link.borrow().decoder().check_end(claimed).map_err(Failure::protocol)
    }

    /// One frame of the program's.
    fn drain(&mut self) -> Result<bool, Failure> {
        let Some(frame) = self.output.next_frame()? else { return Ok(false) };
        match self.emitted.take(&frame, self.output.decoder(), self.input.given())? {
            Way::On => self.send(&frame)?,
            Way::IfThereIsRoom => {
                // Progress is worth no wait; one that is too long for that is left out.
                let offered = self.runner.link.borrow_mut().offer(frame.kind, &frame.payload);
                match offered {
                    Ok(_) | Err(PipeError::Payload(..)) => {}
                    Err(error) => return Err(error.into()),
                }
            }
            Way::Kept => {}
        }
        if self.emitted.complete && self.completed.is_none() {
            self.completed = Some(Instant::now());
        }
        Ok(true)
    }

    /// The worker reads all the time, whatever it writes: so this wait is one for its storage.
    fn send(&self, frame: &OwnedFrame) -> Result<(), Failure> {
        let deadline = (Instant::now() + UNREAD).min(self.runner.deadline);
        let stop = || self.runner.stop.load(Ordering::Relaxed);
        let sent = self.runner.link.borrow_mut().send(frame.kind, &frame.payload, deadline, &stop);
        match sent {
            // Half a frame may be in the pipe: nothing can follow it.
            Err(PipeError::Deadline(_)) => {
                let kind = frame.kind.name();
                Err(Failure::Silent(format!("the worker left {kind} unread")))
            }
            other => Ok(other?),
        }
    }

    /// Whether to go on at all.
    fn look(&mut self) -> Result<(), Failure> {
        let now = Instant::now();
        if self.glanced.is_some_and(|last| now.duration_since(last) < LOOK) {
            return Ok(());
        }
        self.glanced = Some(now);
        if self.runner.stop.load(Ordering::Relaxed) {
            return Err(Failure::Silent("the agent is asked to end".to_owned()));
        }
        let mut link = self.runner.link.borrow_mut();
        if link.is_peer_deaf()? || (self.fed && !matches!(link.glance(), Ok(None))) {
            return Err(Failure::Silent("the worker is gone or wants no more".to_owned()));
        }
        drop(link);
        if now >= self.runner.deadline {
            return Err(self.too_late());
        }
        let patience = seconds(self.runner.case.deadlines.drain);
        if self.completed.is_some_and(|completed| now.duration_since(completed) > patience) {
            let message = format!(
                "the program sent END and still runs {patience:?} later: let it exit, and end \
                 what it started in the background"
            );
            return Err(Failure::new("StackNeverExited", message));
        }
        Ok(())
    }

    fn too_late(&self) -> Failure {
        let taken = match (self.fed && self.input.is_idle(), self.input.given().bytes) {
            (true, bytes) => format!("all {bytes} bytes of its input"),
            (false, bytes) => format!("at most {bytes} bytes of its input, which has more"),
        };
        let (files, bytes) = (self.emitted.files.len(), self.emitted.bytes);
        Failure::new(
            "CaseDeadlineExceeded",
            format!(
                "the program was given {taken}, has given back {bytes} bytes in {files} files, \
                 and did not end within the case's {} s: see its last lines, or give it a longer \
                 playback.caseTimeout",
                self.runner.case.deadlines.case
            ),
        )
    }

    fn check_ended(&self, ended: Ended) -> Result<(), Failure> {
        if ended.exit_status != Some(0) {
            return Err(Failure::new("StackCrashed", format!("the program {}", how(ended))));
        }
        if !self.emitted.complete {
            let (files, bytes) = (self.emitted.files.len(), self.emitted.bytes);
            let message = format!(
                "the program ended with {ended} and without END, after {bytes} bytes in {files} \
                 files: what it gave back may be cut, so it cannot be used"
            );
            return Err(Failure::new("StackExited", message));
        }
        Ok(())
    }

    /// Waits until a pipe can go on.
    fn wait(&self) -> Result<(), rustix::io::Errno> {
        let link = self.runner.link.borrow();
        let mut pipes = Vec::with_capacity(3);
        if self.input.is_idle() && !self.fed {
            pipes.push(PollFd::new(link.input(), PollFlags::IN));
        }
        pipes.extend(self.input.waiting().map(|pipe| PollFd::new(pipe, PollFlags::OUT)));
        pipes.extend(self.output.waiting().map(|pipe| PollFd::new(pipe, PollFlags::IN)));
        // With both streams at their end only the process itself can be waited for.
        let limit = if self.output.waiting().is_some() { GLANCE } else { LOOK };
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(limit.subsec_nanos()) };
        match poll(&mut pipes, Some(&timeout)) {
            Ok(_) | Err(rustix::io::Errno::INTR) => Ok(()),
            Err(error) => Err(error),
        }
    }
}

fn understood<T: serde::de::DeserializeOwned>(
    payload: &[u8],
    kind: FrameType,
) -> Result<T, Failure> {
    let kind = kind.name();
    from_map(payload)
        .map_err(|error| Failure::protocol(format!("{kind} cannot be understood: {error}")))
}
