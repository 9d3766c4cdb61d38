//! How long the parts of a replay took.

use std::time::Instant;

/// Seconds of consecutive parts.
pub(crate) struct Laps(Instant);

impl Laps {
    pub(crate) fn start(now: Instant) -> Laps {
        Laps(now)
    }

    pub(crate) fn lap(&mut self, now: Instant) -> f64 {
        let lap = now.duration_since(self.0).as_secs_f64();
        self.0 = now;
        lap
    }
}
