//! All messages of a bag in one order.

use std::ops::Range;

use crate::chunk::{ChunkRecord, ChunkWalk};
use crate::scan::{load, unknown_connection};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Compression, Connection, Message};

/// One message: 24 bytes, so that a bag of millions stays small.
#[derive(Debug, Clone, Copy)]
struct Entry {
    time: u64,
    chunk: u32,
    start: u32,
    end: u32,
    connection: u32,
}

/// The messages of some connections by (time, chunk, offset), borrowed from the bag.
#[derive(Debug)]
pub struct Timeline<'a> {
    chunks: Vec<&'a [u8]>,
    entries: Vec<Entry>,
}

impl<'a> Timeline<'a> {
    pub(crate) fn build<F: ChunkedFile>(
        bag: &'a Bag<F>,
        filter: impl Fn(&Connection) -> bool,
    ) -> Result<Self, BagError> {
        let mut wanted: Vec<u32> =
            bag.connections.iter().filter(|each| filter(each)).map(|each| each.id).collect();
        wanted.sort_unstable();
        let mut timeline = Self { chunks: Vec::new(), entries: Vec::new() };
        for at in 0..bag.chunks.len() {
            let chunk = &bag.chunks[at];
            if chunk.counts.iter().any(|(id, _)| wanted.binary_search(id).is_ok()) {
                let bytes = chunk_bytes(bag, at)?;
                timeline.add_chunk(bag, chunk, bytes, &wanted)?;
            }
        }
        // Entries come by (chunk, offset); a stable sort by time alone keeps that order.
        if !timeline.entries.is_sorted_by_key(|entry| entry.time) {
            timeline.entries.sort_by_key(|entry| entry.time);
        }
        Ok(timeline)
    }

    fn add_chunk<F: ChunkedFile>(
        &mut self,
        bag: &Bag<F>,
        chunk: &ChunkInfo,
        bytes: &'a [u8],
        wanted: &[u32],
    ) -> Result<(), BagError> {
        let index = self.chunks.len() as u32;
        let bytes = bytes.get(..chunk.usable as usize).unwrap_or(bytes);
        let mut walk = ChunkWalk::new(bytes);
        let damaged = |at: u64, expected: String| match chunk.compression {
            Compression::None => BagError::damaged(chunk.data_position + at, expected),
            _ => BagError::damaged(
                chunk.data_position,
                format!("{expected}, at byte {at} of the uncompressed chunk"),
            ),
        };
        loop {
            let before = walk.at as u64;
            let found = walk.next_record().map_err(|bad| damaged(bad.at as u64, bad.expected))?;
            match found {
                None => break,
                Some(ChunkRecord::Connection(_)) => {}
                Some(ChunkRecord::Message { connection, time, start, end }) => {
                    if wanted.binary_search(&connection).is_ok() {
                        self.entries.push(Entry { time, chunk: index, start, end, connection });
                    } else if !bag.by_id.contains_key(&connection) {
                        return Err(damaged(before, unknown_connection(connection)));
                    }
                }
            }
        }
        self.chunks.push(bytes);
        Ok(())
    }

    /// How many messages there are.
    pub fn len(&self) -> usize {
        self.entries.len()
    }

    /// True when there is none.
    pub fn is_empty(&self) -> bool {
        self.entries.is_empty()
    }

    /// The message at that place in the order.
    pub fn get(&self, index: usize) -> Option<Message<'a>> {
        self.entries.get(index).map(|entry| self.message(entry))
    }

    /// Its time alone, in nanoseconds.
    pub fn time(&self, index: usize) -> Option<u64> {
        self.entries.get(index).map(|entry| entry.time)
    }

    /// The places of the messages with `start <= time < end`.
    pub fn between(&self, start: u64, end: u64) -> Range<usize> {
        let first = self.entries.partition_point(|entry| entry.time < start);
        let last = self.entries.partition_point(|entry| entry.time < end);
        first..last.max(first)
    }

    /// All messages in order.
    pub fn iter(&self) -> TimelineIter<'_> {
        TimelineIter { timeline: self, range: 0..self.entries.len() }
    }

    fn message(&self, entry: &Entry) -> Message<'a> {
        let frame = &self.chunks[entry.chunk as usize][entry.start as usize..entry.end as usize];
        Message { connection: entry.connection, time: entry.time, data: &frame[4..], frame }
    }
}

/// Iterates over a [`Timeline`].
#[derive(Debug, Clone)]
pub struct TimelineIter<'a> {
    timeline: &'a Timeline<'a>,
    range: Range<usize>,
}

impl<'a> Iterator for TimelineIter<'a> {
    type Item = Message<'a>;

    fn next(&mut self) -> Option<Message<'a>> {
        self.range.next().and_then(|at| self.timeline.get(at))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.range.size_hint()
    }
}

impl ExactSizeIterator for TimelineIter<'_> {}

impl<'a> IntoIterator for &'a Timeline<'a> {
    type Item = Message<'a>;
    type IntoIter = TimelineIter<'a>;

    fn into_iter(self) -> TimelineIter<'a> {
        self.iter()
    }
}

/// A chunk's uncompressed bytes: the file's own, or made once and kept by the bag.
fn chunk_bytes<F: ChunkedFile>(bag: &Bag<F>, at: usize) -> Result<&[u8], BagError> {
    let chunk = &bag.chunks[at];
    if let Some(made) = bag.made[at].get() {
        return Ok(made);
    }
    if chunk.compression == Compression::None
        && let Some(bytes) = bag.file.slice(chunk.data_position, chunk.data_length as usize)
    {
        return Ok(bytes);
    }
    let (bytes, wrong) = load(&bag.file, chunk, bag.limits.decompressed_bytes, bag.made_bytes())?;
    if let (Some(expected), true) = (wrong, chunk.usable == chunk.size) {
        return Err(BagError::damaged(chunk.data_position, expected));
    }
    Ok(bag.made[at].get_or_init(|| bytes.into_owned()))
}
