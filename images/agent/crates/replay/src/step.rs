//! A lock-step player's hold on everything that could come in another order next time.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{Cancelled, Node, Outlet, SendError, Share};

use crate::ReplayError;
use crate::answers::Answers;
use crate::lockstep::{Due, Lockstep};
use crate::outcome::StepReport;
use crate::recorder::Recorder;
use crate::watch::Watch;

/// How long outputs that nobody waits for may take from our sockets into the recording.
const SWEEP: Duration = Duration::from_millis(100);

/// The player's side of a lock-step play.
pub(crate) struct Stepper<'a> {
    node: &'a dyn Node,
    lockstep: Lockstep,
    answers: Arc<Answers>,
    recorder: &'a Recorder,
    /// The simulated time of the step, once there is one.
    now: Option<u64>,
}

impl<'a> Stepper<'a> {
    pub(crate) fn new(
        node: &'a dyn Node,
        lockstep: Lockstep,
        answers: Arc<Answers>,
        recorder: &'a Recorder,
    ) -> Stepper<'a> {
        Stepper { node, lockstep, answers, recorder, now: None }
    }

    /// After a /clock was sent: waits until the nodes have read it, and sends it once more.
    /// rospy reads and sets its time on one thread: when it has read the second, the first
    /// has been set. roscpp sets it on another thread, which nobody can see from outside.
    pub(crate) fn settle_clock(
        &self,
        topic: &(impl Outlet + ?Sized),
        frame: &[u8],
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        topic.await_unread(0, cancelled)?;
        topic.send(Share::LeadIn, &[frame], cancelled)?;
        topic.await_unread(0, cancelled)
    }

    /// Before simulated time becomes `time`, which it may be already: what has come belongs to the time
    /// before.
    pub(crate) fn leave(&mut self, time: u64) {
        match self.now.replace(time) {
            None => {}
            Some(now) if now == time => self.work_off(),
            Some(_) => {
                self.sweep();
                self.recorder.end_step();
            }
        }
    }

    /// Where it is known what the stack has to do, that is done first: else what a node makes of one
    /// message and the next one of the same time come to a third node in any order.
    pub(crate) fn work_off(&self) {
        if self.node.counts_publishes() {
            self.node.sweep(SWEEP);
        }
    }

    /// Takes in what has come, if anything is recorded beside the answers, or where it is known
    /// what has been published.
    fn sweep(&self) {
        let others = |topic: &String| !self.lockstep.answers().any(|answer| answer == topic);
        let exact = self.node.counts_publishes();
        if exact || self.node.subscribed_topics().iter().any(others) {
            self.node.sweep(SWEEP);
        }
    }

    /// A message goes out next: the answers that are due to it, from `now` on.
    pub(crate) fn release(
        &mut self,
        topic: usize,
        data: &[u8],
        now: Instant,
    ) -> (Vec<Due>, Instant) {
        (self.lockstep.release(topic, data, self.now, &self.answers), now)
    }

    /// Waits until the message has been answered, and read by all of its subscribers.
    pub(crate) fn complete(
        &mut self,
        (dues, released): (Vec<Due>, Instant),
        topic: &(impl Outlet + ?Sized),
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let time = watch.time();
        for due in dues {
            self.lockstep.wait(due, released, &self.answers, time, || watch.check())?;
        }
        await_read(topic, watch)
    }

    /// Topics of which every message was answered, and by whom.
    pub(crate) fn answered(&self) -> Vec<(usize, BTreeSet<String>)> {
        self.lockstep.answered(&self.answers)
    }

    /// What came of the steps, and what the user should know of it.
    pub(crate) fn reports(self) -> (Vec<StepReport>, Vec<String>) {
        self.lockstep.reports(&self.answers)
    }
}

/// Waits until every subscriber has read everything from its socket.
fn await_read(topic: &(impl Outlet + ?Sized), watch: &mut Watch<'_>) -> Result<(), ReplayError> {
    topic.await_unread(0, &mut || watch.must_stop()).map_err(|error| watch.failed(error))
}
