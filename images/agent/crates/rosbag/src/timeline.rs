//! All messages of a bag in one order.

use std::collections::HashMap;
use std::ops::Range;

use crate::chunk::{AHEAD, ChunkRecord, ChunkWalk, LEAST_MESSAGE, Usual};
use crate::scan::unknown_connection;
use crate::unpack::{chunk_bytes, unpack};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Connection, Message, Window, ahead};

/// Where one message lies: 24 bytes, so that a bag of millions stays small.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// When it was received by the recorder, in nanoseconds.
    pub time: u64,
    /// Its chunk's place in [`Bag::chunks`].
    pub chunk: u32,
    /// Where its frame begins in the chunk's uncompressed data; its data begins 4 bytes on.
    pub start: u32,
    /// Where both end.
    pub end: u32,
    /// The id of its connection.
    pub connection: u32,
}

/// The connections whose messages are asked for; looked up once for every message.
#[derive(Debug)]
pub(crate) struct Wanted {
    /// By id, for the small ids that recorders give.
    dense: Vec<bool>,
    /// The others, in order.
    sparse: Vec<u32>,
}

/// Ids below this are looked up in a table.
const DENSE: u32 = 1 << 16;

impl Wanted {
    pub fn new<'c>(connections: impl Iterator<Item = &'c Connection>) -> Self {
        let (small, mut sparse): (Vec<u32>, Vec<u32>) =
            connections.map(|each| each.id).partition(|id| *id < DENSE);
        sparse.sort_unstable();
        let mut dense = vec![false; small.iter().max().map_or(0, |most| *most as usize + 1)];
        for id in small {
            dense[id as usize] = true;
        }
        Self { dense, sparse }
    }

    #[inline]
    fn has(&self, id: u32) -> bool {
        match self.dense.get(id as usize) {
            Some(wanted) => *wanted,
            None => self.sparse.binary_search(&id).is_ok(),
        }
    }

    /// The chunks that hold such messages, in file order.
    pub fn chunks<F: ChunkedFile>(&self, bag: &Bag<F>) -> Vec<usize> {
        let holds = |at: &usize| bag.chunks[*at].counts.iter().any(|(id, _)| self.has(*id));
        (0..bag.chunks.len()).filter(holds).collect()
    }
}

/// How many wanted messages the index promises, but no more than there can be in the bytes.
fn expected(chunk: &ChunkInfo, wanted: &Wanted) -> u64 {
    let counts = chunk.counts.iter().filter(|(id, _)| wanted.has(*id));
    let promised: u64 = counts.map(|(_, count)| u64::from(*count)).sum();
    promised.min(u64::from(chunk.data_length.max(chunk.usable)) / LEAST_MESSAGE)
}

/// The messages of some connections by (time, chunk, offset), borrowed from the bag.
#[derive(Debug, Default)]
pub struct Timeline<'a> {
    /// Each of the bag's chunks; those that hold nothing wanted are empty.
    chunks: Vec<&'a [u8]>,
    entries: Vec<Place>,
}

impl<'a> Timeline<'a> {
    pub(crate) fn build<F: ChunkedFile>(
        bag: &'a Bag<F>,
        window: Window,
        filter: impl Fn(&Connection) -> bool,
    ) -> Result<Self, BagError> {
        let wanted = Wanted::new(bag.connections.iter().filter(|each| filter(each)));
        let mut chunks = wanted.chunks(bag);
        chunks.retain(|at| window.overlaps(&bag.chunks[*at]));
        unpack(bag, &chunks);
        let expected: u64 = chunks.iter().map(|at| expected(&bag.chunks[*at], &wanted)).sum();
        let mut timeline = Self {
            chunks: vec![&[]; bag.chunks.len()],
            entries: Vec::with_capacity(expected as usize),
        };
        for at in chunks {
            timeline.chunks[at] = timeline.add_chunk(bag, at, at as u32, &wanted)?;
        }
        timeline.order();
        Ok(timeline)
    }

    /// Entries come by (chunk, offset); a stable sort by time alone keeps that order.
    pub(crate) fn order(&mut self) {
        if !self.entries.is_sorted_by_key(|entry| entry.time) {
            self.entries.sort_by_key(|entry| entry.time);
        }
    }

    /// Forgets all messages, and keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.chunks.clear();
        self.entries.clear();
    }

    /// The time of the last message in order.
    pub(crate) fn last_time(&self) -> Option<u64> {
        self.entries.last().map(|entry| entry.time)
    }

    /// Adds the next chunk of a run, whose messages count chunks from the run's beginning.
    pub(crate) fn add_next<F: ChunkedFile>(
        &mut self,
        bag: &'a Bag<F>,
        at: usize,
        wanted: &Wanted,
    ) -> Result<(), BagError> {
        let bytes = self.add_chunk(bag, at, self.chunks.len() as u32, wanted)?;
        self.chunks.push(bytes);
        Ok(())
    }

    /// Adds the messages of chunk `at` under the number `index`, and gives its data.
    fn add_chunk<F: ChunkedFile>(
        &mut self,
        bag: &'a Bag<F>,
        at: usize,
        index: u32,
        wanted: &Wanted,
    ) -> Result<&'a [u8], BagError> {
        let chunk = &bag.chunks[at];
        let bytes = chunk_bytes(bag, at)?;
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
                self.entries.push(Place { time, chunk: index, start, end, connection });
            } else if !bag.by_id.contains_key(&connection) {
                return Err(damaged(before, unknown_connection(connection)));
            }
        }
        Ok(bytes)
    }

    /// Several timelines as one; messages of the same time keep the order of the parts. Their
    /// bytes stay where they are. Each part comes with the numbers that its connections have in
    /// the whole, since every bag counts its own; a message of any other connection is left out.
    pub fn join(parts: Vec<(Timeline<'a>, HashMap<u32, u32>)>) -> Self {
        let mut whole = Self { chunks: Vec::new(), entries: Vec::new() };
        for (part, numbers) in parts {
            let before = whole.chunks.len() as u32;
            whole.entries.extend(part.entries.into_iter().filter_map(|entry| {
                let connection = *numbers.get(&entry.connection)?;
                Some(Place { connection, chunk: before + entry.chunk, ..entry })
            }));
            whole.chunks.extend(part.chunks);
        }
        if !whole.entries.is_sorted_by_key(|entry| entry.time) {
            whole.entries.sort_by_key(|entry| entry.time);
        }
        whole
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
    #[inline]
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

    /// Where each message lies, in order: for those who can't keep a borrow of the bag, and
    /// get the bytes by [`Bag::chunk_data`].
    pub fn into_places(self) -> Vec<Place> {
        self.entries
    }

    #[inline]
    fn message(&self, entry: &Place) -> Message<'a> {
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

    #[inline]
    fn next(&mut self) -> Option<Message<'a>> {
        let at = self.range.next()?;
        if let Some(later) = self.timeline.entries.get(at + AHEAD) {
            ahead::ask(self.timeline.chunks[later.chunk as usize], later.start as usize, 4);
        }
        self.timeline.get(at)
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
