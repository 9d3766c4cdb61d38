//! Plays without a graph, on a clock that is moved by hand: what goes out stays in memory, with
//! its moment. Nothing here sleeps, and each figure is exact.

#[path = "../../tests/scene/bags.rs"]
mod bags;
mod channels;
mod deadlines;
mod drain;
mod formats;
mod kept;
mod latched;
mod ledger;
mod lockstep;
mod master;
mod pause;
mod player;
mod proof;
mod realtime;
mod scripted;
mod start;
mod stepping;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_graph::{Incoming, Middleware, Node, Publisher, Sink};
use bagpipe_log::Recording;
use bagpipe_ros1::Ros1;

use crate::answers::Answers;
use crate::clock::BagClock;
use crate::lockstep::Lockstep;
use crate::names::resolved;
use crate::plan::Plan;
use crate::play::Player;
use crate::recorder::{Recorder, Room};
use crate::replay::node_options;
use crate::step::Stepper;
use crate::time::ByHand;
use crate::watch::Watch;
use crate::{
    AnswerBy, CLOCK_RATE, Cancellation, Mode, Progress, ReplayError, ReplayRequest, StartWhen,
    Step, Window,
};
use kept::{Kept, Log};

const MS: u64 = 1_000_000;

const fn ms(milliseconds: u64) -> Duration {
    Duration::from_millis(milliseconds)
}

/// A window of milliseconds of bag time, without a warm-up.
const fn window(start: u64, end: u64) -> Window {
    Window { lead_in_start: start * MS, start: start * MS, end: end * MS }
}

/// The graph of a master.
fn graph_of(master_uri: &str) -> Arc<dyn Middleware> {
    Arc::new(Ros1 { master_uri: master_uri.to_owned() })
}

/// A request in realtime for a window. Nobody answers as its master.
fn request(by_hand: &ByHand, window: Window) -> ReplayRequest {
    ReplayRequest {
        middleware: graph_of("http://127.0.0.1:9/"),
        window,
        topics: vec!["/a".to_owned(), "/b".to_owned()],
        late: BTreeMap::new(),
        remap: BTreeMap::new(),
        mode: Mode::Realtime,
        steps: Vec::new(),
        rate: 1.0,
        record_topics: Vec::new(),
        record_as: Arc::new(bags::in_lz4()),
        byte_budget: 1 << 20,
        record_to: None,
        subscribe_deadline: ms(60_000),
        drain_deadline: ms(2_000),
        case_deadline: by_hand.moment(ms(1_000_000)),
        use_sim_time: false,
        clock_rate: CLOCK_RATE,
        start: StartWhen::default(),
        pause: None,
        meter: Arc::default(),
    }
}

/// A step of /a's messages, answered on /answer.
fn step(by: AnswerBy, deadline: Duration) -> Step {
    let (trigger, answer) = ("/a".to_owned(), "/answer".to_owned());
    Step { trigger, answer, deadline, by, optional: false }
}

/// What a play needs beside its bag, and what came of it.
struct Rehearsal {
    by_hand: Arc<ByHand>,
    request: ReplayRequest,
    clock: Arc<BagClock>,
    recorder: Recorder,
    answers: Arc<Answers>,
    /// What went out.
    log: Log,
    /// The reports of progress, and when they came.
    reported: Mutex<Vec<(Duration, Progress)>>,
    cancelled: Arc<Mutex<Option<Cancellation>>>,
}

impl Rehearsal {
    fn new(by_hand: &Arc<ByHand>, request: ReplayRequest) -> Rehearsal {
        let start = request.window.lead_in_start;
        let clock = Arc::new(BagClock::new(by_hand.time(), start, u64::MAX));
        let awaited: Vec<(String, bool)> =
            request.steps.iter().map(|s| (resolved(&s.answer), s.by == AnswerBy::Stamp)).collect();
        let answers = Answers::new(awaited.iter().map(|(topic, by)| (topic.as_str(), *by)));
        let answers = Arc::new(answers);
        let format = Arc::clone(&request.record_as);
        let room = Room { bytes: request.byte_budget, format, file: None };
        let ordered = request.mode == Mode::Lockstep;
        let recorder = Recorder::new(Arc::clone(&clock), room, Arc::clone(&answers), ordered);
        Rehearsal {
            by_hand: Arc::clone(by_hand),
            log: Log::new(by_hand, &clock),
            request,
            clock,
            recorder,
            answers,
            reported: Mutex::default(),
            cancelled: Arc::default(),
        }
    }

    /// Acts under the watch.
    fn watched<R>(&self, act: impl FnOnce(&mut Watch<'_>) -> R) -> R {
        let mut progress = |progress| {
            self.reported.lock().unwrap().push((self.by_hand.passed(), progress));
        };
        let cancelled = || *self.cancelled.lock().unwrap();
        let (recorder, clock) = (&self.recorder, &self.clock);
        act(&mut Watch::new(&self.request, recorder, clock, &mut progress, &cancelled))
    }

    /// Lets a player of a bag act, whose outlets keep what goes out.
    fn play<R>(
        &self,
        bag: &dyn Recording,
        act: impl FnOnce(&mut Player<'_, Kept>, &Plan<'_>, &mut Watch<'_>) -> R,
    ) -> R {
        let plan = Plan::new(&[bag], &self.request).unwrap();
        let node = self.node();
        let stepper = (self.request.mode == Mode::Lockstep).then(|| {
            let lockstep = self.lockstep(&plan).unwrap();
            Stepper::new(&*node, lockstep, Arc::clone(&self.answers), &self.recorder)
        });
        let outlets = plan.topics.iter().map(|info| self.log.outlet(&info.topic)).collect();
        let clock = self.request.use_sim_time.then(|| self.log.outlet("/clock"));
        let outlets = (outlets, clock);
        let mut player = Player::new(&plan, &self.clock, &self.request, stepper, outlets);
        self.watched(|watch| act(&mut player, &plan, watch))
    }

    /// A node that has called nobody yet.
    fn node(&self) -> Box<dyn Node> {
        let sink = Box::new(self.recorder.clone());
        self.request.middleware.join(node_options(&self.request), sink).unwrap()
    }

    fn lockstep(&self, plan: &Plan<'_>) -> Result<Lockstep, ReplayError> {
        Lockstep::new(&self.request.steps, &plan.topics, &*self.request.middleware)
    }

    /// After so much time the stack says something.
    fn says(&self, after: Duration, topic: &'static str) {
        let recorder = self.recorder.clone();
        self.by_hand.at(after, move || say(&recorder, topic));
    }

    /// After so much time somebody wants an end.
    fn cancels(&self, after: Duration, why: Cancellation) {
        let cancelled = Arc::clone(&self.cancelled);
        self.by_hand.at(after, move || *cancelled.lock().unwrap() = Some(why));
    }
}

/// The stack says something now.
fn say(recorder: &Recorder, topic: &str) {
    let publisher = &Publisher::default();
    recorder.clone().message(Incoming { topic, publisher, link: 1, data: &[0; 4] });
}
