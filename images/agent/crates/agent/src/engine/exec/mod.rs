//! The `exec` engine: the user's program reads frames on stdin and writes frames on stdout,
//! in place of ROS. docs/reference/binpipe.md, "The exec engine".
//!
//! Nothing is assembled: a frame goes on as soon as the other side takes it, so a case of any
//! size needs the memory of a few frames.

pub(crate) mod entry;
mod input;
mod output;
mod pump;
mod rules;

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_wire::{Duplex, End, FrameType, PROTOCOL, to_map};
use rmpv::Value;
use serde::{Deserialize, Serialize};

use crate::case::failure::Failure;
use crate::case::{Case, seconds};
use crate::stack::end::StackEnd;
use crate::stack::nodes::Nodes;
use crate::stack::processes::{Children, Spared};
use crate::stack::{HURRY, Surroundings};
use input::ProgramInput;
use output::ProgramOutput;
use pump::Pump;
use rules::{Emitted, Entry};

/// What a case of this engine runs with.
pub struct ExecRunner<'a> {
    pub case: &'a Case,
    /// The worker's.
    pub session: &'a str,
    /// The case's map as it came: it goes on to the program.
    pub described: Value,
    pub surroundings: Surroundings<'a>,
    pub deadline: Instant,
    pub stop: &'a AtomicBool,
    pub link: &'a RefCell<Duplex>,
    pub children: &'a RefCell<Children>,
}

/// The engine's name in RESULT.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Exec {
    /// There is no other.
    Exec,
}

/// The map of RESULT: bagpipe/engine/exec/result.py, with which tests compare it.
#[derive(Debug, Serialize, Deserialize)]
pub struct ExecOutcome {
    pub engine: Exec,
    pub stack: StackEnd,
    /// The files that came before, in order.
    pub files: Vec<Entry>,
    /// Bytes of DATA that were given to the program.
    pub bytes_in: u64,
    /// Bytes of DATA that it gave back.
    pub bytes_out: u64,
    /// FILEs that were given to the program.
    pub records_in: u64,
    /// FILEs that it gave back.
    pub records_out: u64,
    /// The program's own RESULT.
    pub program: Option<Value>,
    pub timings: ExecTimings,
}

/// Seconds of each part of the case.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct ExecTimings {
    /// Until the program was started.
    pub stack: f64,
    /// From its start to its end.
    pub run: f64,
    /// Until nothing was left of it.
    pub stop: f64,
}

/// HELLO to the program.
#[derive(Serialize)]
struct Greeting<'a> {
    session: &'a str,
    protocol: u32,
    software: &'a str,
    case: &'a Value,
}

impl ExecRunner<'_> {
    /// Runs the case; when it returns, nothing that it started is left.
    pub fn run(&self) -> Result<ExecOutcome, Failure> {
        let mut timings = ExecTimings::default();
        let begun = Instant::now();
        let (mut program, stdin, stdout) = self
            .surroundings
            .start_piped(&self.case.stack.command, &mut self.children.borrow_mut())
            .map_err(|wrong| Failure::new("CommandNotFound", wrong.0))?;
        program.measure(&Spared::default());
        timings.stack = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let mut pump = Pump {
            runner: self,
            pid: program.pid,
            input: ProgramInput::new(stdin),
            output: ProgramOutput::new(stdout),
            emitted: Emitted::new(self.case.record.byte_budget),
            incoming: rules::FileFlow::default(),
            fed: false,
            glanced: None,
            completed: None,
        };
        let pumped = self.greet(&mut pump.input).and_then(|()| pump.run());
        timings.run = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        // The program's pipes stay open until it is gone: its last lines are to be its own,
        // and not about a pipe that broke.
        let patience = seconds(self.case.deadlines.stop);
        let hurry = self.stop.load(Ordering::Relaxed);
        let patience = if hurry { patience.min(HURRY) } else { patience };
        let mut children = self.children.borrow_mut();
        let mut stack =
            program.end(&mut children, &Spared::default(), patience, &self.surroundings.label);
        children.forget_all();
        if let Ok(stack) = &mut stack {
            stack.judge(&self.case.stack.command, Nodes::default(), &[], pumped.is_ok());
        }
        timings.stop = begun.elapsed().as_secs_f64();
        match (pumped, stack) {
            (_, Err(survivors)) => Err(Failure::new("Internal", survivors)),
            (Ok(()), Ok(stack)) => Ok(outcome(pump, stack, timings)),
            (Err(Failure::Abort(abort)), Ok(mut stack)) => {
                stack.forgive(|cause| self.case.faults.allows(cause));
                Err(Failure::Abort(Box::new(stack.explain(*abort))))
            }
            (Err(silent), Ok(_)) => Err(silent),
        }
    }

    fn greet(&self, input: &mut ProgramInput) -> Result<(), Failure> {
        let software = concat!("bagpipe-agent ", env!("CARGO_PKG_VERSION"));
        let (session, case) = (self.session, &self.described);
        let greeting = Greeting { session, protocol: PROTOCOL, software, case };
        let payload =
            to_map(&greeting).map_err(|error| Failure::new("Internal", error.to_string()))?;
        input.put(FrameType::Hello, payload)
    }
}

fn outcome(pump: Pump<'_>, stack: StackEnd, timings: ExecTimings) -> ExecOutcome {
    let End { files: records_in, bytes: bytes_in, .. } = pump.input.given();
    let Emitted { files, bytes, result, .. } = pump.emitted;
    ExecOutcome {
        engine: Exec::Exec,
        stack,
        records_out: files.len() as u64,
        bytes_out: bytes,
        files,
        bytes_in,
        records_in,
        program: result,
        timings,
    }
}

/// How long the worker may leave a frame unread.
const UNREAD: Duration = Duration::from_secs(30);
