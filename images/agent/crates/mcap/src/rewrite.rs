//! A recording written again: whole, in order, and with all that the seam has no place for.

use std::collections::HashMap;

use crate::{Mcap, McapError, McapWriter, WriterOptions};

/// The same messages by time, with numbers and publish times, and the same channels, metadata
/// and attachments; what was lost to damage stays lost ([`Mcap::loss`]).
///
/// # Errors
/// As [`Mcap::timeline`] and [`McapWriter::write_stamped`].
pub fn rewrite(recording: &Mcap, options: WriterOptions) -> Result<Vec<u8>, McapError> {
    let mut writer = McapWriter::new(options);
    let schemas: HashMap<u16, _> =
        recording.schemas().iter().map(|schema| (schema.id, schema)).collect();
    let ids: HashMap<u32, u32> = recording
        .channels()
        .iter()
        .map(|channel| {
            let schema = schemas.get(&channel.schema_id).copied();
            (u32::from(channel.id), writer.add_channel(schema, channel))
        })
        .collect();
    for words in recording.metadata() {
        writer.describe(words)?;
    }
    for attachment in recording.attachments() {
        writer.attach(&attachment)?;
    }
    let (chunks, places) = recording.timeline(|_| true)?.into_parts();
    for place in &places {
        let data = &chunks[place.chunk as usize][place.start as usize + 4..place.end as usize];
        let id = ids.get(&place.connection).copied().unwrap_or_default();
        writer.write_stamped(id, place.time, recording.stamp(place).unwrap_or_default(), data)?;
    }
    writer.finish()
}
