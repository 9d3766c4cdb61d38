//! Carrying messages of recordings into another, with their numbers and publish times.

use std::collections::HashMap;

use bagpipe_log::{Place, Timeline};

use crate::{Channel, Connection, Mcap, McapError, McapWriter, Schema, WriterOptions};

/// What makes two channels the same: the type's place in what is written, and all but their
/// numbers; and which one of those that are alike in one recording, since these are several
/// publishers.
type Key = (Option<usize>, Channel, usize);

/// Writes messages of several recordings into one.
pub(crate) struct Carrier {
    pub writer: McapWriter,
    known: HashMap<Key, u32>,
}

impl Carrier {
    pub fn new(options: WriterOptions) -> Self {
        Self { writer: McapWriter::new(options), known: HashMap::new() }
    }

    /// Adds the channels that `wanted` keeps, and says what their numbers are here; one that an
    /// earlier recording declared alike is the same.
    pub fn channels(
        &mut self,
        recording: &Mcap,
        wanted: impl Fn(&Connection) -> bool,
    ) -> HashMap<u32, u32> {
        let schemas: HashMap<u16, &Schema> =
            recording.schemas().iter().map(|schema| (schema.id, schema)).collect();
        let mut places: HashMap<u16, usize> = HashMap::new();
        let mut alike: HashMap<Key, usize> = HashMap::new();
        let mut ids = HashMap::new();
        for (channel, connection) in recording.channels().iter().zip(recording.connections()) {
            if !wanted(connection) {
                continue;
            }
            let writer = &mut self.writer;
            let schema = schemas.get(&channel.schema_id).map(|schema| {
                *places.entry(schema.id).or_insert_with(|| writer.add_schema(schema))
            });
            let plain = Channel { id: 0, schema_id: 0, ..channel.clone() };
            let mut key: Key = (schema, plain, 0);
            let before = alike.entry(key.clone()).or_default();
            key.2 = *before;
            *before += 1;
            let id =
                *self.known.entry(key).or_insert_with(|| writer.add_channel_of(schema, channel));
            ids.insert(u32::from(channel.id), id);
        }
        ids
    }

    /// Writes one message of a recording, as recorded at that time.
    #[inline]
    pub fn message(
        &mut self,
        (recording, chunks, ids): (&Mcap, &[&[u8]], &HashMap<u32, u32>),
        place: &Place,
        time: u64,
    ) -> Result<(), McapError> {
        let data = &chunks[place.chunk as usize][place.start as usize + 4..place.end as usize];
        let unknown = McapError::UnknownConnection(place.connection);
        let id = *ids.get(&place.connection).ok_or(unknown)?;
        let stamp = recording.stamp(place).unwrap_or_default();
        self.writer.write_stamped(id, time, stamp, data)
    }

    /// Writes all messages of a timeline, in its order; returns how many.
    pub fn messages(
        &mut self,
        recording: &Mcap,
        timeline: Timeline<'_>,
        ids: &HashMap<u32, u32>,
    ) -> Result<u64, McapError> {
        let (chunks, places) = timeline.into_parts();
        for place in &places {
            self.message((recording, &chunks, ids), place, place.time)?;
        }
        Ok(places.len() as u64)
    }

    /// Writes the files and the words about a recording.
    pub fn surroundings(
        &mut self,
        recording: &Mcap,
        kept: impl Fn(&str) -> bool,
    ) -> Result<(), McapError> {
        for words in recording.metadata().iter().filter(|words| kept(&words.name)) {
            self.writer.describe(words)?;
        }
        for attachment in recording.attachments() {
            self.writer.attach(&attachment)?;
        }
        Ok(())
    }
}
