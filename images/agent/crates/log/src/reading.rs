//! Reading a recording.

use crate::{Connection, RecordingError, Timeline};

/// A recording that is open. Its messages are borrowed from it.
pub trait Recording {
    /// All connections, each with another id, in the order in which the recording declares them.
    fn connections(&self) -> &[Connection];

    /// All messages of the connections that `wanted` keeps, in one total and stable order: by
    /// time, then as they lie in the recording.
    ///
    /// # Errors
    /// [`RecordingError::Unreadable`]: a part that holds such a message is damaged.
    fn timeline(
        &self,
        wanted: &dyn Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, RecordingError>;
}
