//! What is taken of a file of SQLite.

use bagpipe_log::{Late, Window};

use crate::TopicCount;

/// Which messages of a file of SQLite are wanted.
#[derive(Clone, Copy)]
pub struct Selection<'a> {
    /// Their times; of what is latched before it, what is in force at its start is wanted as well.
    pub window: Window,
    /// Their topics, as they were recorded.
    pub topics: &'a dyn Fn(&str) -> bool,
    /// What the folder's metadata says of its topics.
    pub about: &'a [TopicCount],
    /// Whether each of them is compressed.
    pub compressed: bool,
    /// What late subscribers get of a topic, where that is not as it was recorded.
    pub late: &'a dyn Fn(&str) -> Late,
}

impl<'a> Selection<'a> {
    /// Messages of these topics at any time, which are as they were published.
    pub fn all(topics: &'a dyn Fn(&str) -> bool) -> Self {
        let window = Window { start: 0, end: u64::MAX };
        Self { window, topics, about: &[], compressed: false, late: &|_| Late::default() }
    }
}
