//! Pausing at topics, until somebody says to go on.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use crate::ReplayError;
use crate::request::resolved;
use crate::watch::Watch;

/// The time between two questions.
const LOOK: Duration = Duration::from_millis(10);

/// Stops the play before each message of some topics.
#[derive(Clone)]
pub struct Pause {
    /// The topics, as published.
    pub topics: Vec<String>,
    /// Asked again and again, with the topic, until it says `true`: go on. Must not block.
    pub resumed: Resumed,
}

/// Whether a play that has stopped before a message of this topic goes on.
pub type Resumed = Arc<dyn Fn(&str) -> bool + Send + Sync>;

impl fmt::Debug for Pause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Pause").field("topics", &self.topics).finish_non_exhaustive()
    }
}

impl Pause {
    /// Whether this topic is one of those.
    pub(crate) fn stops_at(&self, topic: &str) -> bool {
        self.topics.iter().any(|name| resolved(name) == topic)
    }

    /// Waits before a message of a topic. How long it waited.
    pub(crate) fn wait(&self, topic: &str, watch: &mut Watch<'_>) -> Result<Duration, ReplayError> {
        let begun = watch.now();
        while !(self.resumed)(topic) {
            watch.sleep(LOOK)?;
        }
        Ok(watch.now().duration_since(begun))
    }
}
