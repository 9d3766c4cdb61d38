//! All messages of a bag in one order.

use std::ops::Range;

use crate::chunk::{ChunkRecord, ChunkWalk, LEAST_MESSAGE, Usual};
use crate::scan::unknown_connection;
use crate::unpack::{chunk_bytes, unpack};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Connection, Message};

/// One message: 24 bytes, so that a bag of millions stays small.
#[derive(Debug, Clone, Copy)]
struct Entry {
    time: u64,
    chunk: u32,
    start: u32,
    end: u32,
    connection: u32,
}

/// The connections whose messages are asked for; looked up once for every message.
struct Wanted {
    /// By id, for the small ids that recorders give.
    dense: Vec<bool>,
    /// The others, in order.
    sparse: Vec<u32>,
}

/// Ids below this are looked up in a table.
const DENSE: u32 = 1 << 16;

impl Wanted {
    fn new<'c>(connections: impl Iterator<Item = &'c Connection>) -> Self {
        let (small, mut sparse): (Vec<u32>, Vec<u32>) =
            connections.map(|each| each.id).partition(|id| *id < DENSE);
        sparse.sort_unstable();
        let mut dense = vec![false; small.iter().max().map_or(0, |most| *most as usize + 1)];
        for id in small {
            dense[id as usize] = true;
        }
        Self { dense, sparse }
    }

    fn has(&self, id: u32) -> bool {
        match self.dense.get(id as usize) {
            Some(wanted) => *wanted,
            None => self.sparse.binary_search(&id).is_ok(),
        }
    }
}

/// How many wanted messages the index promises, but no more than there can be in the bytes.
fn expected(chunk: &ChunkInfo, wanted: &Wanted) -> u64 {
    let counts = chunk.counts.iter().filter(|(id, _)| wanted.has(*id));
    let promised: u64 = counts.map(|(_, count)| u64::from(*count)).sum();
    promised.min(u64::from(chunk.data_length.max(chunk.usable)) / LEAST_MESSAGE)
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
        let wanted = Wanted::new(bag.connections.iter().filter(|each| filter(each)));
        let chunks: Vec<usize> = (0..bag.chunks.len())
            .filter(|at| bag.chunks[*at].counts.iter().any(|(id, _)| wanted.has(*id)))
            .collect();
        unpack(bag, &chunks);
        let expected: u64 = chunks.iter().map(|at| expected(&bag.chunks[*at], &wanted)).sum();
        let mut timeline = Self {
            chunks: Vec::with_capacity(chunks.len()),
            entries: Vec::with_capacity(expected as usize),
        };
        for at in chunks {
            let bytes = chunk_bytes(bag, at)?;
            timeline.add_chunk(bag, &bag.chunks[at], bytes, &wanted)?;
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
        wanted: &Wanted,
    ) -> Result<(), BagError> {
        let index = self.chunks.len() as u32;
        let bytes = bytes.get(..chunk.usable as usize).unwrap_or(bytes);
        let mut walk = ChunkWalk::new(bytes);
        let damaged = |at: u64, expected: String| chunk.damaged(at, &expected);
        loop {
            let before = walk.at as u64;
            // Most records by the short way, which keeps them out of memory.
            let (connection, time, start, end) = match walk.next_usual() {
                Some(Usual { connection, time, start, end }) => (connection, time, start, end),
                None => {
                    match walk.next_record().map_err(|bad| damaged(bad.at as u64, bad.expected))? {
                        None => break,
                        Some(ChunkRecord::Connection(_)) => continue,
                        Some(ChunkRecord::Message { connection, time, start, end }) => {
                            (connection, time, start, end)
                        }
                    }
                }
            };
            if wanted.has(connection) {
                self.entries.push(Entry { time, chunk: index, start, end, connection });
            } else if !bag.by_id.contains_key(&connection) {
                return Err(damaged(before, unknown_connection(connection)));
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
