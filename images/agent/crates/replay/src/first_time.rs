//! Simulated time before the play: who waits for a valid time gets the first one.

use std::time::{Duration, Instant};

use bagpipe_graph::SystemState;

use crate::play::Player;
use crate::startup::Startup;
use crate::watch::Watch;
use crate::{ReplayError, ReplayRequest};

/// When time is shown. A node that makes its timers before it knows a time has them due at other times
/// than one that makes them at the first time, so that two runs would differ by how quickly their nodes
/// have started: none is shown while somebody works to start.
pub(crate) struct FirstTime {
    /// A stack that works without end gets its time, too.
    at_the_latest: Instant,
}

impl FirstTime {
    /// `now` is when the wait for the stack begins, of which half is for who works without end.
    pub(crate) fn new(request: &ReplayRequest, now: Instant) -> FirstTime {
        let patience: Duration = request.subscribe_deadline / 2;
        FirstTime { at_the_latest: now + patience }
    }

    /// Shows the first time if nobody starts, by the watch over the stack's `startup`; `state` is the graph's
    /// now, where it answered.
    ///
    /// # Errors
    /// Whatever stops the watch, and what keeps /clock from being published.
    pub(crate) fn show(
        &self,
        state: Option<&SystemState>,
        startup: &mut Startup,
        player: &mut Player<'_>,
        watch: &mut Watch<'_>,
    ) -> Result<(), ReplayError> {
        if !player.shows_time() {
            return Ok(());
        }
        if startup.rests(state) || watch.now() >= self.at_the_latest {
            player.show_clock(watch)?;
        }
        Ok(())
    }
}
