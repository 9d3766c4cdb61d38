//! One case: rosmaster, parameters, the user's command, play and record, and the end of all
//! that was started.

pub(crate) mod entry;
pub(crate) mod feed;
pub(crate) mod outcome;
pub(crate) mod parameters;
pub(crate) mod rosmaster;
pub(crate) mod simulator;

use std::cell::{Cell, RefCell};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_log::Recording;
use bagpipe_replay::{
    AnswerBy, CLOCK_RATE, Cancellation, Meter, Mode, Progress, ReplayRequest, Replayed, Stage,
    StartWhen, Step, Window, replay, simulate,
};
use bagpipe_ros1::Ros1;
use bagpipe_rosbag::{Compression, WriterOptions};
use bagpipe_wire::{Abort, Duplex, FileHeader, FrameType, Metric, to_map};

use crate::case::failure::Failure;
use crate::case::{self, Case, Simulator, seconds};
use crate::engine::ros1::outcome::{Outcome, Timings};
use crate::engine::ros1::simulator::{PipeWorld, topics, unrecorded};
use crate::stack::end::StackEnd;
use crate::stack::evidence::Moment;
use crate::stack::nodes;
use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{Children, Ended};
use crate::stack::{HURRY, Program, Surroundings};

/// How often the pipe and the processes are looked at, at most: replay asks much oftener.
const GLANCE: Duration = Duration::from_millis(5);

/// What a case runs with.
pub struct Runner<'a> {
    pub port: u16,
    /// A new file for the recording, which else is kept in memory.
    pub record_to: Option<PathBuf>,
    pub case: &'a Case,
    pub master_uri: &'a str,
    pub surroundings: Surroundings<'a>,
    pub deadline: Instant,
    pub stop: &'a AtomicBool,
    pub link: &'a RefCell<Duplex>,
    pub meter: &'a Arc<Meter>,
    pub children: &'a RefCell<Children>,
    /// How far the replay was, and when.
    pub course: RefCell<Vec<Moment>>,
    /// The nodes when the play began.
    pub roll: RefCell<Vec<Known>>,
    pub glanced: Cell<Option<Instant>>,
}

/// What the stack receives.
pub enum Input<'a> {
    /// A recording, with its sender's description of it.
    Recording(&'a FileHeader, &'a dyn Recording),
    /// The worker's simulator.
    Simulator(&'a Simulator),
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
        input: &Input<'_>,
        mut timings: Timings,
    ) -> Result<(Outcome, Vec<u8>), Failure> {
        let mut programs = Programs::default();
        let played = self.play(input, &mut programs, &mut timings);
        let begun = Instant::now();
        let nodes = match played {
            Err(Failure::Silent(_)) => Vec::new(),
            _ => self.look_at_nodes(),
        };
        let mut stack = self.end_everything(programs);
        if let Ok((Some(stack), _)) = &mut stack {
            let command = &self.case.stack.command;
            stack.judge(command, nodes, &self.course.borrow(), played.is_ok());
        }
        timings.stop = begun.elapsed().as_secs_f64();
        match (played, stack) {
            (_, Err(survivors)) => Err(Failure::new("Internal", survivors)),
            (Ok(_), Ok((_, Ending { ended: Some(ended), stderr }))) => {
                Err(Failure::Abort(Box::new(master_gone(ended, stderr))))
            }
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
        input: &Input<'_>,
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
            self.master_uri,
            &mut self.children.borrow_mut(),
            started.min(self.deadline),
            &|| self.interruption().map(silent),
        )?;
        parameters::set(&master, &self.case.stack.parameters).map_err(Failure::protocol)?;
        timings.master = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let spared = [program.pid];
        let mut stack = self
            .surroundings
            .start(&self.case.stack.command, "stack", &mut self.children.borrow_mut())
            .map_err(|wrong| Failure::new("CommandNotFound", wrong.0))?;
        stack.measure(&spared);
        let stack = programs.stack.insert(stack);
        timings.stack = begun.elapsed().as_secs_f64();
        let cancelled = || self.cancellation(stack);
        let mut progress = |progress: Progress| {
            self.follow(&progress);
            self.report(progress);
        };
        let request = self.request();
        let played = match *input {
            Input::Recording(_, recording) => {
                replay(recording, &request, &mut progress, &cancelled)
            }
            Input::Simulator(simulator) => {
                let mut world = PipeWorld {
                    link: self.link,
                    deadline: self.deadline,
                    unrecorded: unrecorded(simulator),
                };
                let topics = topics(simulator);
                simulate(topics, &request, &mut world, &mut progress, &cancelled)
            }
        };
        played.map_err(|error| match (error.reason(), input) {
            ("Terminated", _) => silent(self.interruption().unwrap_or(Cancellation::PeerGone)),
            ("BagUnreadable", Input::Recording(header, _)) => {
                Failure::new("BagUnreadable", format!("{}: {error}", header.name))
            }
            (reason, _) => Failure::new(reason, error.to_string()),
        })
    }

    fn request(&self) -> ReplayRequest {
        let Case { window, topics, stack, playback, record, deadlines, .. } = self.case;
        let case::Window { lead_in_start, start, end } = *window;
        ReplayRequest {
            middleware: Arc::new(Ros1 { master_uri: self.master_uri.to_owned() }),
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
            record_as: Arc::new(WriterOptions::with_compression(Compression::Lz4)),
            byte_budget: record.byte_budget,
            record_to: self.record_to.clone(),
            subscribe_deadline: seconds(deadlines.subscribe),
            drain_deadline: seconds(deadlines.drain),
            case_deadline: self.deadline,
            use_sim_time: self.case.use_sim_time(),
            clock_rate: CLOCK_RATE,
            start: StartWhen {
                nodes: playback.wait_for.clone(),
                at_rest_below: Some(std::process::id()),
                ..StartWhen::default()
            },
            pause: None,
            meter: Arc::clone(self.meter),
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
        let ended = self.children.borrow_mut().ended(stack.pid)?;
        let cause = if ended.exit_status == Some(0) { "StackExited" } else { "StackCrashed" };
        // The replay goes on without it; in the drain there is nothing more to wait for.
        let draining = self.course.borrow().last().is_some_and(|last| last.stage == Stage::Drain);
        let allowed = self.case.faults.allow.iter().any(|allowed| allowed == cause);
        (draining || !allowed).then_some(Cancellation::StackExited)
    }

    /// Notes how far the replay is, and who is there when the play begins.
    fn follow(&self, progress: &Progress) {
        let case::Window { lead_in_start, start, .. } = self.case.window;
        let lead_in = start.saturating_sub(lead_in_start) as f64 / 1e9;
        let bag_seconds = progress.bag_seconds - lead_in;
        let mut course = self.course.borrow_mut();
        if progress.stage == Stage::LeadIn
            && course.last().is_none_or(|last| last.stage == Stage::Subscribe)
        {
            *self.roll.borrow_mut() = nodes::roll(self.master_uri);
        }
        if progress.stage == Stage::Drain
            && course.last().is_none_or(|last| last.stage != Stage::Drain)
        {
            nodes::note_stayed(self.master_uri, &mut self.roll.borrow_mut());
        }
        let now = Instant::now();
        let at = progress.last_out.filter(|_| progress.stage == Stage::Drain).unwrap_or(now);
        course.push(Moment { at, stage: progress.stage, bag_seconds });
    }

    /// What has become of the nodes that were there when the play began.
    fn look_at_nodes(&self) -> Vec<(Known, Found)> {
        let roll = self.roll.take();
        let found = nodes::look(self.master_uri, &roll);
        roll.into_iter().zip(found).collect()
    }

    /// Whether the agent must end, or the worker is gone.
    fn interruption(&self) -> Option<Cancellation> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Cancellation::Terminated);
        }
        // While a simulator's turn is awaited, whoever waits sees what comes.
        let Ok(mut link) = self.link.try_borrow_mut() else { return None };
        match link.glance() {
            Ok(None) => None,
            // After END the worker has nothing to say but ABORT.
            Ok(Some(_)) | Err(_) => Some(Cancellation::PeerGone),
        }
    }

    /// Progress to the worker, if the pipe takes it: a slow reader must not slow the player.
    fn report(&self, progress: Progress) {
        let Progress { stage, sent, recorded, bag_seconds, .. } = progress;
        let metric = Metric { stage: stage.name().to_owned(), sent, recorded, bag_seconds };
        let Ok(payload) = to_map(&metric) else { return };
        let Ok(mut link) = self.link.try_borrow_mut() else { return };
        if let Err(error) = link.offer(FrameType::Metric, &payload) {
            eprintln!("[{}] progress cannot be reported: {error}", self.surroundings.label);
        }
    }

    /// Stops the stack, then the rosmaster, then whatever is left.
    fn end_everything(&self, programs: Programs) -> Result<(Option<StackEnd>, Ending), String> {
        let Programs { master, stack } = programs;
        let mut children = self.children.borrow_mut();
        let master_ended = master.as_ref().and_then(|master| children.ended(master.pid));
        let mut ending = None;
        if let Some(stack) = stack {
            let patience = seconds(self.case.deadlines.stop);
            let hurry = self.stop.load(Ordering::Relaxed);
            let patience = if hurry { patience.min(HURRY) } else { patience };
            let spared: Vec<_> = master.iter().map(|master| master.pid).collect();
            let label = &self.surroundings.label;
            ending = Some(stack.end(&mut children, &spared, patience, label)?);
        }
        // A rosmaster keeps nothing, so it need not be asked.
        children.kill(&[])?;
        let master_stderr = master.map(|master| master.output().1).unwrap_or_default();
        children.forget_all();
        Ok((ending, Ending { ended: master_ended, stderr: master_stderr }))
    }
}

/// Without a master it can't be known which nodes were there in the end.
fn master_gone(ended: Ended, stderr: Vec<String>) -> Abort {
    let Ended { exit_status, signal } = ended;
    let message = format!(
        "the rosmaster ended with {ended} during the case, so which nodes were there in the end \
         can't be known"
    );
    Abort {
        reason: "RosMasterFailed".to_owned(),
        message,
        exit_status,
        signal,
        stderr,
        ..Abort::default()
    }
}

/// How the rosmaster ended before it was ended.
struct Ending {
    ended: Option<Ended>,
    stderr: Vec<String>,
}

/// Adds what the programs wrote and how they ended.
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
    match stack {
        Some(stack) => stack.explain(abort),
        None => abort,
    }
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
