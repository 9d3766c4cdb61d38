//! Looking up from the work: cancellation, deadlines, the recorder's failure, progress.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{GraphError, SendError};

use crate::clock::BagClock;
use crate::meter::{Seen, Tally};
use crate::recorder::Recorder;
use crate::time::Time;
use crate::{Cancellation, Mode, Progress, ReplayError, ReplayRequest, Stage};

/// The least time between two looks.
const LOOK: Duration = Duration::from_millis(10);
/// The longest sleep without a look.
const NAP: Duration = Duration::from_millis(20);
/// The time between two reports of progress.
const REPORT_INTERVAL: Duration = Duration::from_millis(500);

/// Watches over a replay.
pub(crate) struct Watch<'a> {
    cancelled: &'a dyn Fn() -> Option<Cancellation>,
    progress: &'a mut dyn FnMut(Progress),
    recorder: &'a Recorder,
    clock: &'a BagClock,
    case_deadline: Instant,
    lead_in_start: u64,
    stage: Stage,
    looked: Instant,
    reported: Instant,
    failure: Option<ReplayError>,
    stack_exited: bool,
    last_out: Option<Instant>,
    window_start: u64,
    tally: Tally,
    /// Messages played so far.
    pub(crate) sent: u64,
    /// Bag time of the last one, in nanoseconds.
    pub(crate) reached: u64,
}

impl<'a> Watch<'a> {
    pub(crate) fn new(
        request: &ReplayRequest,
        recorder: &'a Recorder,
        clock: &'a BagClock,
        progress: &'a mut dyn FnMut(Progress),
        cancelled: &'a dyn Fn() -> Option<Cancellation>,
    ) -> Watch<'a> {
        let now = clock.time.now();
        let rate = (request.mode == Mode::Realtime).then_some(request.rate);
        Watch {
            cancelled,
            progress,
            recorder,
            clock,
            case_deadline: request.case_deadline,
            lead_in_start: request.window.lead_in_start,
            stage: Stage::Subscribe,
            looked: now.checked_sub(LOOK).unwrap_or(now),
            reported: now,
            failure: None,
            stack_exited: false,
            last_out: None,
            window_start: request.window.start,
            tally: Tally::new(Arc::clone(&request.meter), rate),
            sent: 0,
            reached: 0,
        }
    }

    /// Why the play ends where a message could not be sent.
    pub(crate) fn failed(&mut self, error: SendError) -> ReplayError {
        match error {
            SendError::Stalled { node, topic, waited, why } => {
                ReplayError::StackStoppedReading { node, topic, waited, why }
            }
            SendError::Cancelled => self.failure(),
            SendError::Failed { reason, what } => ReplayError::GraphFailed(GraphError {
                reason,
                what: "the graph failed",
                source: what.into(),
            }),
        }
    }

    /// What it goes by.
    pub(crate) fn time(&self) -> &'a Time {
        &self.clock.time
    }

    /// The present moment.
    pub(crate) fn now(&self) -> Instant {
        self.clock.time.now()
    }

    /// Enters a stage and reports it.
    pub(crate) fn enter(&mut self, stage: Stage) {
        self.note();
        self.tally.enter(stage, self.window_start, self.now());
        self.stage = stage;
        self.report();
    }

    /// Whether to stop now; looks at most every 10 ms, so it costs nothing in a loop.
    pub(crate) fn must_stop(&mut self) -> bool {
        let now = self.now();
        if self.failure.is_none() && now.duration_since(self.looked) >= LOOK {
            self.looked = now;
            self.failure = self.look(now);
            if now.duration_since(self.reported) >= REPORT_INTERVAL {
                self.report();
            }
        }
        self.failure.is_some()
    }

    /// The error to stop with, if it is time to stop.
    pub(crate) fn check(&mut self) -> Result<(), ReplayError> {
        if self.must_stop() {
            return Err(self.failure());
        }
        Ok(())
    }

    /// Why it must stop.
    pub(crate) fn failure(&mut self) -> ReplayError {
        let unknown = || ReplayError::Internal("stopped without a reason".to_owned());
        self.failure.take().unwrap_or_else(unknown)
    }

    /// The last message goes out now: whoever ends from here on may have had everything.
    pub(crate) fn last_goes_out(&mut self) {
        self.last_out = Some(self.now());
    }

    /// Whether the stack ended while that was allowed, behind the last message.
    pub(crate) fn stack_has_exited(&self) -> bool {
        self.stack_exited
    }

    /// Sleeps for so long, looking up now and then.
    pub(crate) fn sleep(&mut self, time: Duration) -> Result<(), ReplayError> {
        self.sleep_until(self.now() + time)
    }

    /// Sleeps until `due`, looking up now and then.
    pub(crate) fn sleep_until(&mut self, due: Instant) -> Result<(), ReplayError> {
        loop {
            let left = due.saturating_duration_since(self.now());
            if left.is_zero() {
                return Ok(());
            }
            self.check()?;
            self.clock.time.sleep(left.min(NAP));
        }
    }

    fn look(&mut self, now: Instant) -> Option<ReplayError> {
        let during = self.during();
        match (self.cancelled)() {
            Some(Cancellation::StackExited)
                if self.stage == Stage::Drain || self.last_out.is_some() =>
            {
                self.stack_exited = true;
            }
            Some(Cancellation::StackExited) => return Some(ReplayError::StackExited { during }),
            Some(other) => return Some(ReplayError::Cancelled(other)),
            None => {}
        }
        if now >= self.case_deadline {
            return Some(ReplayError::CaseDeadlineExceeded { during });
        }
        // Whoever has had everything may rest.
        let over = self.stage == Stage::Drain || self.last_out.is_some();
        let broke = if over { None } else { self.recorder.what_broke() };
        broke.or_else(|| self.recorder.failure())
    }

    fn during(&self) -> &'static str {
        match self.stage {
            Stage::Subscribe => "while its subscriptions were awaited",
            Stage::LeadIn => "during the warm-up",
            Stage::Play => "during the play",
            Stage::Drain => "while the last messages were awaited",
        }
    }

    fn report(&mut self) {
        self.note();
        self.reported = self.now();
        let bag = self.clock.now().saturating_sub(self.lead_in_start);
        (self.progress)(Progress {
            stage: self.stage,
            sent: self.sent,
            recorded: self.recorder.messages(),
            bag_seconds: bag as f64 / 1e9,
            last_out: self.last_out,
        });
    }

    /// Brings the meter up to date.
    fn note(&mut self) {
        let (sent, reached, recorded) = (self.sent, self.reached, self.recorder.figures());
        let now = self.now();
        self.tally.note(Seen { sent, reached, recorded }, now);
    }
}

impl Drop for Watch<'_> {
    /// However the replay ends, what it did counts.
    fn drop(&mut self) {
        self.note();
    }
}
