//! Pausing at topics, until somebody says to go on.

use std::fmt;
use std::sync::Arc;

use crate::names::resolved;

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
}
