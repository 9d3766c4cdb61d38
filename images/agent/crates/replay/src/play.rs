//! The player: messages go out in the bag's order, by its time or as fast as they are taken.

use std::collections::BTreeSet;
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{Middleware, Node, Outlet, Publication, SendError, Share};

use crate::batch::Batch;
use crate::clock::{BagClock, Schedule};
use crate::outcome::StepReport;
use crate::pause::Pause;
use crate::plan::{Plan, Route};
use crate::spacing::Spacing;
use crate::step::Stepper;
use crate::watch::Watch;
use crate::{Mode, ReplayError, ReplayRequest};

/// The time between two questions whether a pause is over.
const ASK: Duration = Duration::from_millis(10);
/// How long a time on which no message depends may wait for its readers.
const SHOWN: Duration = Duration::from_millis(50);
/// The tick of a /clock that does not advance between two messages.
const STEPPED: u64 = u64::MAX;

/// Plays a plan into outlets, which are a node's publications.
pub(crate) struct Player<'a, O: ?Sized = dyn Publication> {
    plan: &'a Plan<'a>,
    publications: Vec<Arc<O>>,
    /// /clock, if simulated time is wanted.
    clock_topic: Option<Arc<O>>,
    middleware: Arc<dyn Middleware>,
    clock: &'a BagClock,
    mode: Mode,
    rate: f64,
    /// Messages played per topic: lead-in and counted.
    played: Vec<Played>,
    last_tick: u64,
    /// /clock advances at least this often, in nanoseconds of bag time; `STEPPED` if it only
    /// steps with the messages.
    tick: u64,
    /// In lock-step.
    stepper: Option<Stepper<'a>>,
    pause: Option<Pause>,
}

/// How many messages of a topic were played.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Played {
    pub(crate) lead_in: u64,
    pub(crate) counted: u64,
}

/// How playing a range went.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Pace {
    /// The latest lateness of a message.
    pub(crate) late: Duration,
    /// From the first due time to the last message's departure.
    pub(crate) took: Duration,
    /// Bag time of the last message, if there was one, in nanoseconds.
    pub(crate) last: Option<u64>,
}

impl<'a> Player<'a> {
    /// Advertises the plan's topics.
    pub(crate) fn advertise(
        node: &dyn Node,
        plan: &'a Plan<'a>,
        clock: &'a BagClock,
        request: &ReplayRequest,
        stepper: Option<Stepper<'a>>,
    ) -> Result<Player<'a>, ReplayError> {
        let failed = ReplayError::GraphFailed;
        let clock_topic = if request.use_sim_time {
            Some(node.advertise(request.middleware.clock_topic()).map_err(failed)?)
        } else {
            None
        };
        let topics = plan.topics.iter();
        let publications = topics.map(|topic| node.advertise(topic.clone()).map_err(failed));
        let publications = publications.collect::<Result<_, _>>()?;
        Ok(Player::new(plan, clock, request, stepper, (publications, clock_topic)))
    }

    /// Everything advertised, /clock included.
    pub(crate) fn advertised(&self) -> impl Iterator<Item = &Arc<dyn Publication>> {
        self.publications.iter().chain(&self.clock_topic)
    }
}

impl<'a, O: Outlet + ?Sized> Player<'a, O> {
    /// Plays the plan's topics into these outlets, in its order, and /clock into the other one.
    pub(crate) fn new(
        plan: &'a Plan<'a>,
        clock: &'a BagClock,
        request: &ReplayRequest,
        stepper: Option<Stepper<'a>>,
        (publications, clock_topic): (Vec<Arc<O>>, Option<Arc<O>>),
    ) -> Player<'a, O> {
        Player {
            plan,
            publications,
            clock_topic,
            middleware: Arc::clone(&request.middleware),
            clock,
            mode: request.mode,
            rate: request.rate,
            played: vec![Played::default(); plan.topics.len()],
            last_tick: request.window.lead_in_start,
            // A rate of 0 gives infinity, which saturates at `STEPPED`.
            tick: (1e9 / request.clock_rate).max(1.0) as u64,
            stepper,
            pause: request.pause.clone(),
        }
    }

    /// The advertised topics, in the plan's order; /clock is not among them.
    pub(crate) fn publications(&self) -> &[Arc<O>] {
        &self.publications
    }

    /// The topics that need a subscriber: those with messages to be played.
    pub(crate) fn required(&self) -> Vec<usize> {
        self.plan.spoken()
    }

    /// What was played, in the plan's order.
    pub(crate) fn played(&self) -> &[Played] {
        &self.played
    }

    /// In realtime, waits until bag time `until` is due, as after a lead-in that has no
    /// message right before the window.
    pub(crate) fn wait_until(
        &mut self,
        until: u64,
        schedule: Schedule,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        match self.mode {
            Mode::Realtime => self.wait_for(until, schedule, watch),
            Mode::Max | Mode::Lockstep => Ok(()),
        }
    }

    /// Sends what was latched before the lead-in, at the lead-in's start.
    pub(crate) fn play_latched(&mut self, watch: &mut Watch<'_>) -> Result<(), ReplayError> {
        for &place in &self.plan.latched {
            self.work_off();
            self.send(place, Share::LeadIn, watch)?;
        }
        Ok(())
    }

    /// The times of a range that begins at bag time `from`, at `epoch`.
    pub(crate) fn schedule(&self, from: u64, epoch: Instant) -> Schedule {
        Schedule { epoch, bag: from, rate: self.rate }
    }

    /// Plays a range by a schedule that has just been made.
    pub(crate) fn play(
        &mut self,
        range: Range<usize>,
        mut schedule: Schedule,
        share: Share,
        watch: &mut Watch<'_>,
    ) -> Result<Pace, ReplayError> {
        let from = schedule.bag;
        match self.mode {
            Mode::Realtime => self.clock.run(schedule.epoch, from, self.rate),
            Mode::Max if self.clock_topic.is_none() && self.pause.is_none() => {
                self.clock.stand(from);
                let last = self.play_in_runs(range, share, watch)?;
                let took = watch.now().duration_since(schedule.epoch);
                return Ok(Pace { last, took, ..Pace::default() });
            }
            Mode::Max | Mode::Lockstep => self.move_to(from),
        }
        let mut pace = Pace::default();
        let mut spacing = self.spacing(range.clone(), schedule);
        self.last_tick = from;
        let last = range.end.saturating_sub(1);
        for place in range {
            let Some((message, route)) = self.plan.message(place) else { continue };
            self.pause_before(message.time, route, &mut schedule, watch)?;
            match self.mode {
                Mode::Realtime => {
                    self.wait_for(message.time, schedule, watch)?;
                    let due = schedule.due(message.time);
                    watch.sleep_until(spacing.earliest(&route.topics, due))?;
                    let now = watch.now();
                    spacing.sent(&route.topics, now);
                    pace.late = pace.late.max(now.saturating_duration_since(due));
                }
                Mode::Max | Mode::Lockstep => self.move_to(message.time),
            }
            self.tick(message.time, watch)?;
            self.work_off_clock();
            if place == last && share == Share::Counted {
                // A stack that has ended by now did not end behind the last message.
                watch.check()?;
                watch.last_goes_out();
            }
            self.send(place, share, watch)?;
            watch.reached = message.time;
            pace.last = Some(message.time);
        }
        pace.took = watch.now().duration_since(schedule.epoch);
        Ok(pace)
    }

    /// Stops before a message, if that is wanted; bag time stands meanwhile.
    fn pause_before(
        &mut self,
        time: u64,
        route: &Route,
        schedule: &mut Schedule,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let Some(pause) = self.pause.clone() else { return Ok(()) };
        for &at in &route.topics {
            let topic = Arc::clone(&self.publications[at]);
            if !pause.stops_at(topic.topic()) {
                continue;
            }
            if self.mode == Mode::Realtime {
                self.wait_for(time, *schedule, watch)?;
            }
            self.clock.stand(self.clock.now());
            schedule.epoch += pause_at(&pause, topic.topic(), watch)?;
            if self.mode == Mode::Realtime {
                self.clock.run(schedule.epoch, schedule.bag, self.rate);
            }
        }
        Ok(())
    }

    /// Simulated time stands at `time` from now on.
    fn move_to(&mut self, time: u64) {
        if let Some(stepper) = &mut self.stepper {
            stepper.leave(time);
        }
        self.clock.stand(time);
    }

    /// Plays a range at full speed: consecutive messages of one connection go out together,
    /// straight from the bag's memory. The time of the last message played.
    fn play_in_runs(
        &mut self,
        range: Range<usize>,
        share: Share,
        watch: &mut Watch<'_>,
    ) -> Result<Option<u64>, ReplayError> {
        let plan = self.plan;
        let mut batch = Batch::default();
        let mut last = None;
        for place in range {
            let Some(message) = plan.bare_message(place) else { continue };
            if !batch.takes(message.connection, message.frame.len()) {
                self.send_batch(&batch, share, watch)?;
                batch.clear();
            }
            batch.add(message.connection, message.frame);
            batch.time = message.time;
            last = Some(message.time);
        }
        if share == Share::Counted {
            watch.check()?;
            watch.last_goes_out();
        }
        self.send_batch(&batch, share, watch)?;
        Ok(last)
    }

    fn send_batch(
        &mut self,
        batch: &Batch<'_>,
        share: Share,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        watch.check()?;
        let (Some(frame), Some(route)) = (batch.frames.last(), self.plan.route(batch.connection))
        else {
            return Ok(());
        };
        // What answers the batch is not older than any message of it.
        self.clock.stand(batch.time);
        let messages = batch.frames.len() as u64;
        for &at in &route.topics {
            let topic = &self.publications[at];
            if route.latching {
                topic.latch(&route.caller_id, share, frame);
            }
            batch
                .go_out(&**topic, share, &mut || watch.must_stop())
                .map_err(|error| watch.failed(error))?;
            self.count(at, share, messages, watch);
        }
        watch.reached = batch.time;
        Ok(())
    }

    fn count(&mut self, at: usize, share: Share, messages: u64, watch: &mut Watch<'_>) {
        match share {
            Share::LeadIn => self.played[at].lead_in += messages,
            Share::Counted => self.played[at].counted += messages,
        }
        watch.sent += messages;
    }

    /// The distances to keep in a range, which takes until its last message is due.
    fn spacing(&self, range: Range<usize>, schedule: Schedule) -> Spacing {
        let mut messages = vec![0; self.publications.len()];
        let mut last = schedule.bag;
        for (message, route) in range.filter_map(|place| self.plan.message(place)) {
            route.topics.iter().for_each(|at| messages[*at] += 1);
            last = message.time;
        }
        Spacing::new(&messages, schedule.due(last).duration_since(schedule.epoch))
    }

    /// Waits until a message is due; /clock ticks on the way.
    fn wait_for(
        &mut self,
        time: u64,
        schedule: Schedule,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        while self.clock_topic.is_some() && self.last_tick.saturating_add(self.tick) < time {
            let next = self.last_tick + self.tick;
            watch.sleep_until(schedule.due(next))?;
            self.tick(next, watch)?;
        }
        watch.sleep_until(schedule.due(time))
    }

    /// Whether there is a /clock.
    pub(crate) fn shows_time(&self) -> bool {
        self.clock_topic.is_some()
    }

    /// Publishes the time that /clock shows when it is not advanced by messages: before the
    /// play, where a node may wait for a valid time, and during the drain. Who does not take it, as
    /// one that waits for a service before it spins, is waited for a moment alone.
    pub(crate) fn show_clock(&mut self, watch: &mut Watch<'_>) -> Result<(), ReplayError> {
        let until = watch.now() + SHOWN;
        self.tick_until(self.shown(), Some(until), watch)
    }

    /// The same, which everybody is to have before the next time.
    pub(crate) fn show_clock_to_all(&mut self, watch: &mut Watch<'_>) -> Result<(), ReplayError> {
        self.tick(self.shown(), watch)
    }

    /// What /clock shows where no message advances it.
    fn shown(&self) -> u64 {
        if self.tick == STEPPED { self.last_tick } else { self.clock.now() }
    }

    fn tick(&mut self, time: u64, watch: &mut Watch<'_>) -> Result<(), ReplayError> {
        self.tick_until(time, None, watch)
    }

    /// The same; on a time with a moment `until` nothing depends, and behind that it waits for nobody.
    fn tick_until(
        &mut self,
        time: u64,
        until: Option<Instant>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let Some(topic) = &self.clock_topic else { return Ok(()) };
        self.last_tick = time;
        let frame = self.middleware.clock_frame(time);
        topic.latch("", Share::LeadIn, &frame);
        let mut over = || watch.must_stop() || until.is_some_and(|until| watch.now() >= until);
        let sent = topic.send(Share::LeadIn, &[&frame], &mut over);
        let settled = sent.and_then(|()| match &self.stepper {
            Some(stepper) => stepper.settle_clock(&**topic, &frame, &mut over),
            None => Ok(()),
        });
        match settled {
            Err(SendError::Cancelled) if !watch.must_stop() => Ok(()),
            settled => settled.map_err(|error| watch.failed(error)),
        }
    }

    /// In lock-step, what timers of the time that was just shown do comes before its message.
    fn work_off_clock(&self) {
        if self.clock_topic.is_some() {
            self.work_off();
        }
    }

    /// In lock-step, what the stack has to do is done before the next message.
    fn work_off(&self) {
        if let Some(stepper) = &self.stepper {
            stepper.work_off();
        }
    }

    fn send(
        &mut self,
        place: usize,
        share: Share,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        watch.check()?;
        let Some((message, route)) = self.plan.message(place) else { return Ok(()) };
        for &at in &route.topics {
            if route.latching {
                self.publications[at].latch(&route.caller_id, share, message.frame);
            }
            self.say(at, message.frame, share, watch)?;
        }
        Ok(())
    }

    /// Sends a frame on a topic; in lock-step, until it was read and answered.
    pub(crate) fn say(
        &mut self,
        at: usize,
        frame: &[u8],
        share: Share,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let topic = &self.publications[at];
        let due =
            self.stepper.as_mut().map(|stepper| stepper.release(at, &frame[4..], watch.now()));
        topic
            .send(share, &[frame], &mut || watch.must_stop())
            .map_err(|error| watch.failed(error))?;
        if let (Some(stepper), Some(due)) = (&mut self.stepper, due) {
            stepper.complete(due, &**topic, watch)?;
        }
        self.count(at, share, 1, watch);
        Ok(())
    }

    /// Simulated time is `time` from now on, and everybody has read so.
    pub(crate) fn advance(&mut self, time: u64, watch: &mut Watch<'_>) -> Result<(), ReplayError> {
        self.move_to(time);
        self.tick(time, watch)?;
        self.work_off_clock();
        Ok(())
    }

    /// In lock-step, topics of which every message was answered, and by whom.
    pub(crate) fn answered(&self) -> Vec<(usize, BTreeSet<String>)> {
        self.stepper.as_ref().map(Stepper::answered).unwrap_or_default()
    }

    /// What came of the steps, once the play is over, and what the user should know of it.
    pub(crate) fn end_steps(&mut self) -> (Vec<StepReport>, Vec<String>) {
        self.stepper.take().map(Stepper::reports).unwrap_or_default()
    }
}

/// Waits before a message of a topic until somebody says to go on. How long it waited.
fn pause_at(pause: &Pause, topic: &str, watch: &mut Watch<'_>) -> Result<Duration, ReplayError> {
    let begun = watch.now();
    while !(pause.resumed)(topic) {
        watch.sleep(ASK)?;
    }
    Ok(watch.now().duration_since(begun))
}
