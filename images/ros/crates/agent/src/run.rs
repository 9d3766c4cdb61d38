//! One case: rosmaster, parameters, the user's command, play and record, and the end of all
//! that was started.

use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_bag::{Bag, MemoryChunkedFile};
use bagpipe_pipe::{Abort, Duplex, FileHeader, FrameType, Metric, to_map};
use bagpipe_replay::{
    AnswerBy, CLOCK_RATE, Cancellation, Mode, Progress, ReplayRequest, Replayed, StartWhen, Step,
    Window, replay,
};

use crate::case::{self, Case, seconds};
use crate::failure::Failure;
use crate::outcome::{Outcome, StackEnd, Timings};
use crate::processes::{Children, Ended};
use crate::stack::{Program, Surroundings};
use crate::{parameters, rosmaster};

/// How often the pipe and the processes are looked at, at most: replay asks much oftener.
const GLANCE: Duration = Duration::from_millis(5);
/// How long a stack may take to stop when the agent itself must end within 5 s.
const HURRY: Duration = Duration::from_secs(2);

/// What a case runs with.
pub struct Runner<'a> {
    pub port: u16,
    pub case: &'a Case,
    pub surroundings: Surroundings<'a>,
    pub deadline: Instant,
    pub stop: &'a AtomicBool,
    pub link: &'a RefCell<Duplex>,
    pub children: &'a RefCell<Children>,
    pub glanced: Cell<Option<Instant>>,
}

/// The programs of a case.
#[derive(Default)]
struct Programs {
    master: Option<Program>,
    stack: Option<Program>,
}

impl Runner<'_> {
    /// Runs the case; when it returns, nothing that it started is left.
    pub fn run(
        &self,
        header: &FileHeader,
        bag: &Bag<MemoryChunkedFile>,
        mut timings: Timings,
    ) -> Result<(Outcome, Vec<u8>), Failure> {
        let mut programs = Programs::default();
        let played = self.play(header, bag, &mut programs, &mut timings);
        let begun = Instant::now();
        let stack = self.end_everything(programs);
        timings.stop = begun.elapsed().as_secs_f64();
        match (played, stack) {
            (_, Err(survivors)) => Err(Failure::new("Internal", survivors)),
            (Ok(replayed), Ok((Some(stack), _))) => Ok(Outcome::new(replayed, stack, timings)),
            (Ok(_), Ok((None, _))) => Err(Failure::new("Internal", "played without a stack")),
            (Err(Failure::Abort(abort)), Ok((stack, master))) => {
                Err(Failure::Abort(Box::new(explain(*abort, stack, master))))
            }
            (Err(silent), Ok(_)) => Err(silent),
        }
    }

    fn play(
        &self,
        header: &FileHeader,
        bag: &Bag<MemoryChunkedFile>,
        programs: &mut Programs,
        timings: &mut Timings,
    ) -> Result<Replayed, Failure> {
        let begun = Instant::now();
        let program =
            rosmaster::start(&self.surroundings, self.port, &mut self.children.borrow_mut())?;
        let program = programs.master.insert(program);
        let started = begun + seconds(self.case.deadlines.start);
        let master = rosmaster::await_answer(
            program,
            self.surroundings.master_uri,
            &mut self.children.borrow_mut(),
            started.min(self.deadline),
            &|| self.interruption().map(silent),
        )?;
        parameters::set(&master, &self.case.stack.parameters).map_err(Failure::protocol)?;
        timings.master = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let stack = self
            .surroundings
            .start(&self.case.stack.command, "stack", &mut self.children.borrow_mut())
            .map_err(|wrong| Failure::new("CommandNotFound", wrong.0))?;
        let stack = programs.stack.insert(stack);
        timings.stack = begun.elapsed().as_secs_f64();
        let cancelled = || self.cancellation(stack);
        let mut progress = |progress: Progress| self.tell(progress);
        replay(bag, &self.request(), &mut progress, &cancelled).map_err(|error| {
            match (error.reason(), self.interruption()) {
                ("Terminated", why) => silent(why.unwrap_or(Cancellation::PeerGone)),
                ("BagUnreadable", _) => {
                    Failure::new("BagUnreadable", format!("{}: {error}", header.name))
                }
                (reason, _) => Failure::new(reason, error.to_string()),
            }
        })
    }

    fn request(&self) -> ReplayRequest {
        let Case { window, topics, stack, playback, record, deadlines, .. } = self.case;
        let case::Window { lead_in_start, start, end } = *window;
        ReplayRequest {
            master_uri: self.surroundings.master_uri.to_owned(),
            window: Window { lead_in_start, start, end },
            topics: topics.clone(),
            remap: stack.remap.clone(),
            mode: match playback.mode {
                case::Mode::Realtime => Mode::Realtime,
                case::Mode::Max => Mode::Max,
                case::Mode::Lockstep => Mode::Lockstep,
            },
            steps: playback.steps.iter().map(step).collect(),
            rate: playback.rate,
            record_topics: record.topics.clone(),
            byte_budget: record.byte_budget,
            subscribe_deadline: seconds(deadlines.subscribe),
            drain_deadline: seconds(deadlines.drain),
            case_deadline: self.deadline,
            use_sim_time: self.case.use_sim_time(),
            clock_rate: CLOCK_RATE,
            start: StartWhen::default(),
            pause: None,
        }
    }

    /// Whether playing must end, looked at no oftener than it can change anything.
    fn cancellation(&self, stack: &Program) -> Option<Cancellation> {
        let now = Instant::now();
        if self.glanced.get().is_some_and(|last| now.duration_since(last) < GLANCE) {
            return None;
        }
        self.glanced.set(Some(now));
        if let Some(why) = self.interruption() {
            return Some(why);
        }
        let ended = self.children.borrow_mut().ended(stack.pid);
        ended.map(|_| Cancellation::StackExited)
    }

    /// Whether the agent must end, or the worker is gone.
    fn interruption(&self) -> Option<Cancellation> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Cancellation::Terminated);
        }
        match self.link.borrow_mut().glance() {
            Ok(None) => None,
            // After END the worker has nothing to say but ABORT.
            Ok(Some(_)) | Err(_) => Some(Cancellation::PeerGone),
        }
    }

    /// Progress to the worker, if the pipe takes it: a slow reader must not slow the player.
    fn tell(&self, progress: Progress) {
        let Progress { stage, sent, recorded, bag_seconds } = progress;
        let metric = Metric { stage: stage.name().to_owned(), sent, recorded, bag_seconds };
        let Ok(payload) = to_map(&metric) else { return };
        if let Err(error) = self.link.borrow_mut().offer(FrameType::Metric, &payload) {
            eprintln!("[{}] progress cannot be told: {error}", self.surroundings.label);
        }
    }

    /// Stops the stack, then the rosmaster, then whatever is left.
    fn end_everything(&self, programs: Programs) -> Result<(Option<StackEnd>, Ending), String> {
        let Programs { master, stack } = programs;
        let mut children = self.children.borrow_mut();
        let by_itself = stack.as_ref().and_then(|stack| children.ended(stack.pid));
        let master_ended = master.as_ref().and_then(|master| children.ended(master.pid));
        if let Some(stack) = &stack {
            let patience = seconds(self.case.deadlines.stop);
            let hurry = self.stop.load(Ordering::Relaxed);
            let patience = if hurry { patience.min(HURRY) } else { patience };
            let spared: Vec<_> = master.iter().map(|master| master.pid).collect();
            let killed = children.stop(Some(stack.pid), &spared, patience)?;
            if killed > 0 {
                let label = &self.surroundings.label;
                eprintln!("[{label}] {killed} processes did not end within {patience:?}: killed");
            }
        }
        // A rosmaster keeps nothing, so it need not be asked.
        children.kill(&[])?;
        let stack = stack.map(|stack| {
            let ended = children.ended(stack.pid);
            let (stdout, stderr) = stack.output();
            StackEnd {
                exit_status: ended.and_then(|ended| ended.exit_status),
                signal: ended.and_then(|ended| ended.signal),
                stderr,
                stdout,
                ended_by: if by_itself.is_some() { "itself" } else { "agent" },
            }
        });
        let master_stderr = master.map(|master| master.output().1).unwrap_or_default();
        children.forget_all();
        Ok((stack, Ending { ended: master_ended, stderr: master_stderr }))
    }
}

/// How the rosmaster ended before it was ended.
struct Ending {
    ended: Option<Ended>,
    stderr: Vec<String>,
}

/// Adds what the programs said and how they ended.
fn explain(mut abort: Abort, stack: Option<StackEnd>, master: Ending) -> Abort {
    if let Some(ended) = master.ended
        && abort.reason != "RosMasterNotFound"
    {
        // Whatever went wrong after that went wrong because of it.
        if abort.reason != "RosMasterFailed" {
            let message = format!("the rosmaster ended with {ended} during the case");
            abort.message = format!("{message}; then: {}", abort.message);
            abort.reason = "RosMasterFailed".to_owned();
        }
        let Ended { exit_status, signal } = ended;
        return Abort { exit_status, signal, stderr: master.stderr, ..abort };
    }
    if abort.reason.starts_with("RosMaster") {
        return Abort { stderr: master.stderr, ..abort };
    }
    let Some(stack) = stack else { return abort };
    let itself = stack.ended_by == "itself";
    if abort.reason == "StackExited" && matches!(stack.exit_status, Some(126 | 127)) {
        // A shell or the image's entrypoint was found; what it should run was not.
        let last = stack.stderr.last().map_or("", String::as_str);
        abort.message = format!("{} (a shell's sign of a missing command: {last})", abort.message);
    }
    abort.exit_status = stack.exit_status.filter(|_| itself);
    abort.signal = stack.signal.filter(|_| itself);
    abort.stderr = stack.stderr;
    abort.stdout = stack.stdout;
    abort
}

fn step(step: &case::Step) -> Step {
    Step {
        trigger: step.trigger.clone(),
        answer: step.answer.clone(),
        deadline: seconds(step.deadline),
        by: match step.by {
            case::By::Count => AnswerBy::Count,
            case::By::Stamp => AnswerBy::Stamp,
        },
        optional: step.optional,
    }
}

fn silent(why: Cancellation) -> Failure {
    Failure::Silent(
        match why {
            Cancellation::PeerGone => "the worker is gone or wants no more",
            Cancellation::Terminated => "the agent is asked to end",
            Cancellation::StackExited => "the stack ended",
        }
        .to_owned(),
    )
}
