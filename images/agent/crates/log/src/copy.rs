//! A recording of one format as one of another.

use std::collections::HashMap;

use crate::{Recording, RecordingError, RecordingWriter};

/// Writes all connections of `from`, also those without a message, and all messages in their
/// order. What `from` has lost to damage is missing.
///
/// # Errors
/// As [`Recording::timeline`] and [`RecordingWriter::write`].
pub fn copy(from: &dyn Recording, to: &mut dyn RecordingWriter) -> Result<(), RecordingError> {
    let ids: HashMap<u32, u32> =
        from.connections().iter().map(|each| (each.id, to.add_connection(each))).collect();
    let timeline = from.timeline(&|_| true)?;
    for message in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
        if let Some(id) = ids.get(&message.connection) {
            to.write(*id, message.time, message.data)?;
        }
    }
    Ok(())
}
