//! All messages of a bag in one order.

use std::ops::{Deref, Range};

use bagpipe_log::Place;

use crate::chunk::{AHEAD, ChunkRecord, ChunkWalk, LEAST_MESSAGE, Usual};
use crate::scan::unknown_connection;
use crate::unpack::{chunk_bytes, unpack};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Connection, Message, Window, ahead};

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

/// All messages of the connections that `filter` keeps, without chunks that lie outside the
/// window as a whole.
pub(crate) fn ordered<F: ChunkedFile>(
    bag: &Bag<F>,
    window: Window,
    filter: impl Fn(&Connection) -> bool,
) -> Result<bagpipe_log::Timeline<'_>, BagError> {
    let wanted = Wanted::new(bag.connections.iter().filter(|each| filter(each)));
    let mut chunks = wanted.chunks(bag);
    chunks.retain(|at| window.overlaps(bag.chunks[*at].start, bag.chunks[*at].end));
    unpack(bag, &chunks);
    let expected: u64 = chunks.iter().map(|at| expected(&bag.chunks[*at], &wanted)).sum();
    let mut draft = Draft {
        chunks: vec![&[]; bag.chunks.len()],
        places: Vec::with_capacity(expected as usize),
    };
    for at in chunks {
        draft.chunks[at] = draft.add_chunk(bag, at, at as u32, &wanted)?;
    }
    Ok(draft.order())
}

/// A timeline while chunks are added to it: messages by (chunk, offset).
#[derive(Debug)]
pub(crate) struct Draft<'a> {
    /// Each of the bag's chunks; those that hold nothing wanted are empty.
    chunks: Vec<&'a [u8]>,
    places: Vec<Place>,
}

impl<'a> Draft<'a> {
    /// An empty one in the memory of a timeline that is over.
    pub fn in_place_of(timeline: bagpipe_log::Timeline<'a>) -> Self {
        let (mut chunks, mut places) = timeline.into_parts();
        chunks.clear();
        places.clear();
        Self { chunks, places }
    }

    /// All that was added, by (time, chunk, offset).
    pub fn order(self) -> bagpipe_log::Timeline<'a> {
        bagpipe_log::Timeline::new(self.chunks, self.places)
    }

    /// Adds the next chunk of a run, whose messages count chunks from the run's beginning.
    pub fn add_next<F: ChunkedFile>(
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
                self.places.push(Place { time, chunk: index, start, end, connection });
            } else if !bag.by_id.contains_key(&connection) {
                return Err(damaged(before, unknown_connection(connection)));
            }
        }
        Ok(bytes)
    }
}

/// The messages of some connections by (time, chunk, offset), borrowed from the bag. Chunks are
/// numbered by their places in [`Bag::chunks`].
#[derive(Debug)]
pub struct Timeline<'a> {
    order: bagpipe_log::Timeline<'a>,
}

impl<'a> Timeline<'a> {
    pub(crate) fn build<F: ChunkedFile>(
        bag: &'a Bag<F>,
        window: Window,
        filter: impl Fn(&Connection) -> bool,
    ) -> Result<Self, BagError> {
        Ok(Self { order: ordered(bag, window, filter)? })
    }

    /// All messages in order.
    pub fn iter(&self) -> TimelineIter<'_> {
        TimelineIter { order: &self.order, range: 0..self.order.len() }
    }

    /// Where each message lies, in order: for those who can't keep a borrow of the bag, and
    /// get the bytes by [`Bag::chunk_data`].
    pub fn into_places(self) -> Vec<Place> {
        self.order.into_parts().1
    }
}

impl<'a> Deref for Timeline<'a> {
    type Target = bagpipe_log::Timeline<'a>;

    #[inline]
    fn deref(&self) -> &Self::Target {
        &self.order
    }
}

/// Iterates over a [`Timeline`], and asks memory for what comes later.
#[derive(Debug, Clone)]
pub struct TimelineIter<'a> {
    order: &'a bagpipe_log::Timeline<'a>,
    range: Range<usize>,
}

impl<'a> Iterator for TimelineIter<'a> {
    type Item = Message<'a>;

    #[inline]
    fn next(&mut self) -> Option<Message<'a>> {
        let at = self.range.next()?;
        if let Some(later) = self.order.get(at + AHEAD) {
            ahead::ask(later.frame, 0, 4);
        }
        self.order.get(at)
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
