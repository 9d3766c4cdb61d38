//! A recording of one format as one of another.

use std::collections::HashMap;

use crate::{Connection, Recording, RecordingError, RecordingWriter};

/// Writes the connections of `from` that `wanted` keeps, also those without a message, and their
/// messages in their order. What `from` has lost to damage is missing.
///
/// # Errors
/// As [`Recording::timeline`] and [`RecordingWriter::write`].
pub fn copy(
    from: &dyn Recording,
    wanted: &dyn Fn(&Connection) -> bool,
    to: &mut dyn RecordingWriter,
) -> Result<(), RecordingError> {
    let kept = from.connections().iter().filter(|each| wanted(each));
    let ids: HashMap<u32, u32> = kept.map(|each| (each.id, to.add_connection(each))).collect();
    let timeline = from.timeline(wanted)?;
    for message in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
        if let Some(id) = ids.get(&message.connection) {
            to.write(*id, message.time, message.data)?;
        }
    }
    Ok(())
}
