//! One case: what nodes need, the user's command, play and record, and the end of all that was
//! started.

use std::cell::{Cell, RefCell};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_graph::Middleware;
use bagpipe_log::Recording;
use bagpipe_replay::{
    AnswerBy, CLOCK_RATE, Cancellation, Meter, Mode, Progress, ReplayRequest, Replayed, Stage,
    StartWhen, Step, Window, replay, simulate,
};
use bagpipe_wire::{Abort, Duplex, FileHeader, FrameType, Metric, to_map};

use crate::case::failure::Failure;
use crate::case::{self, Case, Simulator, seconds};
use crate::engine::nodes::host::{Ending, Host, Occasion};
use crate::engine::nodes::outcome::{Outcome, Timings};
use crate::engine::nodes::simulator::{PipeWorld, topics, unrecorded};
use crate::stack::end::StackEnd;
use crate::stack::evidence::Moment;
use crate::stack::exit_code::Exit;
use crate::stack::nodes::{Before, Found, Known, Nodes, later, left};
use crate::stack::processes::{Children, Spared, descendants, is_alive, pause};
use crate::stack::{HURRY, Program, Surroundings};

/// How often the pipe and the processes are looked at, at most: replay asks much oftener.
const GLANCE: Duration = Duration::from_millis(5);
/// How long a process may take to end whose nodes have left the graph: rospy's takes up to 0.7 s on
/// an idle machine, and waits up to 5 s for each of its threads (`rospy.core.signal_shutdown`).
const LEAVE: Duration = Duration::from_secs(5);

/// What a case runs with.
pub struct Runner<'a> {
    pub host: &'a dyn Host,
    /// A new file for the recording, which else is kept in memory.
    pub record_to: Option<PathBuf>,
    pub case: &'a Case,
    pub surroundings: Surroundings<'a>,
    pub deadline: Instant,
    pub stop: &'a AtomicBool,
    pub link: &'a RefCell<Duplex>,
    pub meter: &'a Arc<Meter>,
    pub children: &'a RefCell<Children>,
    /// What is below this process and not the stack's.
    pub spared: Spared,
    /// How far the replay was, and when.
    pub course: RefCell<Vec<Moment>>,
    /// The nodes when the play began.
    pub roll: RefCell<Vec<Known>>,
    pub before: RefCell<Before>,
    /// Why it is not known which nodes were there, if that is so.
    pub unseen: RefCell<Option<Failure>>,
    pub glanced: Cell<Option<Instant>>,
}

/// What the stack receives.
pub enum Input<'a> {
    /// A recording, with its sender's description of it.
    Recording(&'a FileHeader, &'a dyn Recording),
    /// The worker's simulator.
    Simulator(&'a Simulator),
}

impl Runner<'_> {
    /// Runs the case; when it returns, nothing that it started is left.
    pub fn run(
        &self,
        input: &Input<'_>,
        mut timings: Timings,
    ) -> Result<(Outcome, Vec<u8>), Failure> {
        let mut program = None;
        let played = self.play(input, &mut program, &mut timings);
        let begun = Instant::now();
        let nodes = match played {
            Err(Failure::Silent(_)) => Nodes::default(),
            _ => Nodes { there: self.look_at_nodes(), before: self.before_the_play() },
        };
        let exits = self.exits();
        let mut stack = self.end_everything(program);
        if let Ok((Some(stack), _)) = &mut stack {
            let command = &self.case.stack.command;
            stack.complete(&exits, &self.exits());
            stack.judge(command, nodes, &self.course.borrow(), played.is_ok());
        }
        timings.stop = begun.elapsed().as_secs_f64();
        match (played, stack) {
            (_, Err(survivors)) => Err(Failure::new("Internal", survivors)),
            (Ok(_), Ok((_, ending @ Ending { ended: Some(_), .. }))) => {
                Err(Failure::Abort(Box::new(self.host.gone(ending))))
            }
            (Ok(replayed), Ok((Some(stack), ending))) => {
                match self.unseen.take() {
                    // A crash that was seen is no reason to play the case again.
                    Some(Failure::Abort(abort)) => {
                        return Err(self.explain(*abort, Some(stack), ending));
                    }
                    Some(unseen) => return Err(unseen),
                    None => {}
                }
                Ok(Outcome::new(replayed, stack, timings, self.host.chosen_player()))
            }
            (Ok(_), Ok((None, _))) => Err(Failure::new("Internal", "played without a stack")),
            (Err(Failure::Abort(abort)), Ok((stack, ending))) => {
                Err(self.explain(*abort, stack, ending))
            }
            (Err(silent), Ok(_)) => Err(silent),
        }
    }

    fn explain(&self, abort: Abort, mut stack: Option<StackEnd>, ending: Ending) -> Failure {
        if let Some(stack) = &mut stack {
            stack.forgive(|cause| self.case.faults.allows(cause));
        }
        Failure::Abort(Box::new(self.host.explain(abort, stack, ending)))
    }

    fn play(
        &self,
        input: &Input<'_>,
        program: &mut Option<Program>,
        timings: &mut Timings,
    ) -> Result<Replayed, Failure> {
        let begun = Instant::now();
        let started = begun + seconds(self.case.deadlines.start);
        let deadline = started.min(self.deadline);
        self.host.start(&self.occasion(deadline, &|| self.interruption()))?;
        self.spare();
        timings.master = begun.elapsed().as_secs_f64();
        let begun = Instant::now();
        let mut stack = self
            .surroundings
            .start(&self.host.command()?, "stack", &mut self.children.borrow_mut())
            .map_err(|wrong| Failure::new("CommandNotFound", wrong.0))?;
        stack.measure(&self.spared);
        if let Some(watcher) = stack.watcher() {
            self.host.watch_by(watcher);
        }
        let stack = program.insert(stack);
        timings.stack = begun.elapsed().as_secs_f64();
        let cancelled = || self.cancellation(stack);
        let middleware = self.host.meet(&self.occasion(deadline, &cancelled))?;
        self.spare();
        let mut progress = |progress: Progress| {
            self.follow(&progress);
            self.report(progress);
        };
        let request = self.request(middleware);
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

    fn occasion<'o>(
        &'o self,
        deadline: Instant,
        interrupted: &'o dyn Fn() -> Option<Cancellation>,
    ) -> Occasion<'o> {
        let (surroundings, children) = (&self.surroundings, self.children);
        Occasion { surroundings, children, deadline, interrupted }
    }

    /// Takes in which processes are the host's.
    fn spare(&self) {
        let known = self.spared.pids();
        let new = self.host.processes().into_iter().filter(|pid| !known.contains(pid));
        new.for_each(|pid| self.spared.add(pid));
    }

    fn request(&self, middleware: Arc<dyn Middleware>) -> ReplayRequest {
        let Case { window, topics, stack, playback, record, deadlines, .. } = self.case;
        let case::Window { lead_in_start, start, end } = *window;
        ReplayRequest {
            middleware,
            window: Window { lead_in_start, start, end },
            topics: topics.clone(),
            late: stack.qos.iter().map(|(topic, qos)| (topic.clone(), qos.late())).collect(),
            remap: stack.remap.clone(),
            mode: match playback.mode {
                case::Mode::Realtime => Mode::Realtime,
                case::Mode::Max => Mode::Max,
                case::Mode::Lockstep => Mode::Lockstep,
            },
            steps: playback.steps.iter().map(step).collect(),
            rate: playback.rate,
            record_topics: record.topics.clone(),
            record_as: self.host.record_as(),
            byte_budget: record.byte_budget,
            record_to: self.record_to.clone(),
            subscribe_deadline: seconds(deadlines.subscribe),
            drain_deadline: seconds(deadlines.drain),
            case_deadline: self.deadline,
            use_sim_time: self.host.use_sim_time(),
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
        let draining = self.course.borrow().last().is_some_and(|last| last.stage == Stage::Drain);
        let allowed = self.case.faults.allows(cause);
        // The replay goes on without it, and is over in the drain once nothing of the stack is left.
        let is_left = || !descendants(std::process::id(), &self.spared.pids()).is_empty();
        (!allowed || (draining && !is_left())).then_some(Cancellation::StackExited)
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
            match self.host.roll() {
                Ok(roll) => {
                    *self.before.borrow_mut() = Before { met: self.host.met(), roll: roll.clone() };
                    *self.roll.borrow_mut() = roll;
                }
                Err(failure) => self.note_unseen(failure),
            }
        }
        if progress.stage == Stage::Drain
            && course.last().is_none_or(|last| last.stage != Stage::Drain)
        {
            let noted = self.host.note_stayed(&mut self.roll.borrow_mut());
            noted.unwrap_or_else(|failure| self.note_unseen(failure));
        }
        let now = Instant::now();
        let at = progress.last_out.filter(|_| progress.stage == Stage::Drain).unwrap_or(now);
        course.push(Moment { at, stage: progress.stage, bag_seconds });
    }

    /// What has become of the nodes that were there when the play began.
    fn look_at_nodes(&self) -> Vec<(Known, Found)> {
        let roll = self.roll.take();
        let deadline = self.deadline.min(Instant::now() + LEAVE);
        match self.look_until(&roll, deadline) {
            Ok(found) => roll.into_iter().zip(found).collect(),
            Err(failure) => {
                self.note_unseen(failure);
                Vec::new()
            }
        }
    }

    /// The nodes of before the play, or of before this moment where it never began: whatever ended of a stack that was
    /// waited for in vain may be why.
    fn before_the_play(&self) -> Before {
        if self.course.borrow().iter().any(|one| one.stage != Stage::Subscribe) {
            return self.before.take();
        }
        // Who can't be asked has its own failure.
        let roll = self.host.roll().unwrap_or_default();
        Before { met: self.host.met(), roll }
    }

    fn look_until(&self, roll: &[Known], deadline: Instant) -> Result<Vec<Found>, Failure> {
        let mut found = self.host.look(roll)?;
        while self.await_ends(&left(roll, &found), deadline) {
            // Others may have left meanwhile.
            found = later(found, self.host.look(roll)?);
        }
        Ok(found)
    }

    /// What nodes' processes have noted of their ends by now.
    fn exits(&self) -> Vec<Exit> {
        self.host.exits().unwrap_or_else(|failure| {
            self.note_unseen(failure);
            Vec::new()
        })
    }

    /// Takes in that nobody could say which nodes there were: the first reason is kept.
    fn note_unseen(&self, failure: Failure) {
        self.unseen.borrow_mut().get_or_insert(failure);
    }

    /// Until processes have ended that are about to, `true` if one has: one that is asked to end on
    /// its way out does not show how it would have ended.
    fn await_ends(&self, pids: &BTreeSet<i32>, deadline: Instant) -> bool {
        // A node in a namespace of its own gives a number that is another's here.
        let own = descendants(std::process::id(), &self.spared.pids());
        let mut leaving = pids & &own;
        leaving.retain(|pid| is_alive(*pid));
        if leaving.is_empty() {
            return false;
        }
        while leaving.iter().any(|pid| is_alive(*pid)) {
            if self.interruption().is_some() || Instant::now() >= deadline {
                return false;
            }
            pause(GLANCE);
        }
        true
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

    /// Stops the stack, then what the host started, then whatever is left.
    fn end_everything(&self, stack: Option<Program>) -> Result<(Option<StackEnd>, Ending), String> {
        let mut children = self.children.borrow_mut();
        let ended = self.host.ended(&mut children);
        let mut end = None;
        if let Some(stack) = stack {
            let patience = seconds(self.case.deadlines.stop);
            let hurry = self.stop.load(Ordering::Relaxed);
            let patience = if hurry { patience.min(HURRY) } else { patience };
            let label = &self.surroundings.label;
            end = Some(stack.end(&mut children, &self.spared, patience, label)?);
        }
        // A host keeps nothing, so it need not be asked.
        children.kill(&[])?;
        let stderr = self.host.take_program().map(|program| program.output().1);
        children.forget_all();
        Ok((end, Ending { ended, stderr: stderr.unwrap_or_default() }))
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

/// The end of a case that nobody waits for any more.
pub fn silent(why: Cancellation) -> Failure {
    Failure::Silent(
        match why {
            Cancellation::PeerGone => "the worker is gone or wants no more",
            Cancellation::Terminated => "the agent is asked to end",
            Cancellation::StackExited => "the stack ended",
        }
        .to_owned(),
    )
}
