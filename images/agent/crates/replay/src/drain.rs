//! After the last message: until everybody has it, and until nobody answers any more.
//!
//! Silence alone does not end a recording. A machine that stands still is silent too, and so
//! is a callback that takes its time. What the nodes do ends it, as far as it can be seen:
//! their sockets are read, the threads that read are back at them, nobody uses a processor
//! beyond the usual, and who slept has woken. Where it can't be seen, silence has to do.

use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{Node, Outlet, Publication};

use crate::patience::Patience;
use crate::play::Player;
use crate::processes::{Processes, Rest};
use crate::prove::Proof;
use crate::recorder::Recorder;
use crate::watch::Watch;
use crate::{ReplayError, ReplayRequest};

/// The pause between two rounds of questions when the answers are awaited.
pub(crate) const PAUSE: Duration = Duration::from_millis(10);
/// A pause that lasts longer was none of the stack's time.
const STOOD_STILL: Duration = Duration::from_millis(50);
/// The time between two looks at what the nodes do.
const LOOK: Duration = Duration::from_millis(50);
/// Nodes whose figures have not changed for this time will not receive more.
const STABLE: Duration = Duration::from_secs(2);
/// Outputs are over when none came for this time, and nobody was at work.
const QUIET: Duration = Duration::from_millis(300);
/// How long what lies in our own sockets may take into the recording.
pub(crate) const SWEEP: Duration = Duration::from_secs(1);

/// After the last message.
pub(crate) struct Drain<'a> {
    pub(crate) node: &'a dyn Node,
    pub(crate) request: &'a ReplayRequest,
    pub(crate) recorder: &'a Recorder,
    pub(crate) since: Instant,
}

impl Drain<'_> {
    /// Until the subscribers' kernels and then the subscribers have everything.
    pub(crate) fn prove(
        &self,
        proof: &mut Proof,
        player: &mut Player<'_>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let deadline = self.since + self.request.drain_deadline;
        let patience = Patience { deadline, busy: deadline, stable: STABLE };
        let topics = player.publications().to_vec();
        let mut pause = |watch: &mut Watch<'_>| {
            watch.sleep(PAUSE)?;
            player.show_clock(watch)?;
            Ok::<bool, ReplayError>(watch.stack_has_exited())
        };
        while topics.iter().any(|topic| topic.unsent() > 0) && watch.now() < patience.deadline {
            if pause(watch)? {
                return Ok(());
            }
        }
        proof.settle(&topics, &patience, watch.time(), || pause(watch)).map(drop)
    }

    /// Until the outputs have ended.
    pub(crate) fn listen(
        &self,
        proof: &mut Proof,
        processes: &mut Processes,
        player: &mut Player<'_>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let topics = player.publications().to_vec();
        // Quiet counts from here: what was received last is not answered yet.
        let begun = watch.now();
        processes.begin();
        let look = |received| work(proof, processes, &topics, received);
        self.await_quiet(begun, look, player, watch)?;
        proof.ask_again(&topics);
        Ok(())
    }

    /// Until nothing has come for long enough since `begun`, and nobody works by what `look`
    /// returns; its argument is whether a message was received since the previous call.
    pub(crate) fn await_quiet<O: Outlet + ?Sized>(
        &self,
        begun: Instant,
        mut look: impl FnMut(bool) -> Rest,
        player: &mut Player<'_, O>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        let deadline = (self.since + self.request.drain_deadline).max(begun + QUIET);
        let (mut quiet, mut rest, mut next) = (begun, Rest::Working, begun + LOOK);
        while watch.now() < deadline && !self.is_over(rest, quiet) {
            let before = watch.now();
            watch.sleep_until(before + PAUSE)?;
            player.show_clock(watch)?;
            if watch.stack_has_exited() {
                break;
            }
            let now = watch.now();
            quiet += stood_still(now - before);
            if now >= next {
                let received = self.recorder.quiet_for(begun) < now + LOOK - next;
                next = now + LOOK;
                rest = look(received);
                if rest == Rest::Working {
                    quiet = now;
                }
            }
        }
        // The sockets may hold messages that were published in time and not read yet.
        self.node.sweep(SWEEP);
        Ok(())
    }

    /// Whether nobody works and nothing has come for long enough.
    fn is_over(&self, rest: Rest, quiet: Instant) -> bool {
        if rest != Rest::Still || self.recorder.quiet_for(quiet) < QUIET {
            return false;
        }
        // The thread that records may be the one that got no processor.
        self.node.sweep(SWEEP);
        self.recorder.quiet_for(quiet) >= QUIET
    }
}

/// What of a pause was nobody's time to say anything.
pub(crate) fn stood_still(pause: Duration) -> Duration {
    if pause >= STOOD_STILL { pause.saturating_sub(PAUSE) } else { Duration::ZERO }
}

/// What the nodes do.
fn work(
    proof: &mut Proof,
    processes: &mut Processes,
    topics: &[Arc<dyn Publication>],
    received: bool,
) -> Rest {
    proof.see(topics);
    let rest = processes.rest(received);
    if proof.busy(topics) { Rest::Working } else { rest }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_pause_that_took_far_too_long_is_time_that_nobody_had() {
        let ms = Duration::from_millis;
        assert_eq!(stood_still(ms(10)), ms(0));
        assert_eq!(stood_still(ms(49)), ms(0));
        assert_eq!(stood_still(ms(250)), ms(240));
    }
}
