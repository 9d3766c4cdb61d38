//! MCAP whose messages were compressed one by one, as MCAP.

use std::collections::HashMap;

use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};

use crate::{Rosbag2Error, compressed};

/// What rosbag2 writes into each file of a folder about that folder.
const OF_THE_FOLDER: &str = "rosbag2";

/// The same recording with each message uncompressed, in at most `memory` bytes.
///
/// # Errors
/// [`Rosbag2Error::Compressed`], [`Rosbag2Error::MemoryLimit`], [`Rosbag2Error::Mcap`].
pub fn unpacked(recording: &Mcap, memory: u64) -> Result<Vec<u8>, Rosbag2Error> {
    let profile = recording.profile().to_owned();
    let options = WriterOptions { profile, byte_budget: Some(memory), ..WriterOptions::default() };
    // In a buffer of our own, because a budget is reserved otherwise.
    let mut writer = McapWriter::with_buffer(options, Vec::new());
    let schemas: HashMap<u16, _> =
        recording.schemas().iter().map(|schema| (schema.id, schema)).collect();
    let mut ids = HashMap::new();
    for channel in recording.channels() {
        let schema = schemas.get(&channel.schema_id).copied();
        let id = writer.add_channel(schema, channel);
        ids.insert(u32::from(channel.id), (id, channel.topic.as_str()));
    }
    // The recorder's own words say that the messages are compressed, and rosbag2 believes them.
    for words in recording.metadata().iter().filter(|words| words.name != OF_THE_FOLDER) {
        writer.describe(words)?;
    }
    for attachment in recording.attachments() {
        writer.attach(&attachment)?;
    }
    let (chunks, places) = recording.timeline(|_| true)?.into_parts();
    let mut bytes = Vec::new();
    for place in &places {
        let Some((id, topic)) = ids.get(&place.connection) else { continue };
        let data = &chunks[place.chunk as usize][place.start as usize + 4..place.end as usize];
        let what = || format!("the message of {topic} at {} ns", place.time);
        compressed::message(data, memory, &mut bytes, what)?;
        let stamp = recording.stamp(place).unwrap_or_default();
        writer.write_stamped(*id, place.time, stamp, &bytes)?;
    }
    Ok(writer.finish()?)
}
