//! The messages of a bag one after the other, without ordering all of them first.

use std::mem;

use bagpipe_log::Timeline;

use crate::timeline::{Draft, Wanted};
use crate::unpack::unpack;
use crate::{Bag, BagError, ChunkedFile, Connection, Message};

/// The messages of some connections by (time, chunk, offset), as in a [`crate::Timeline`],
/// borrowed from the bag. Only chunks whose times overlap are ordered together, so that a usual
/// recording takes the memory of a chunk's order, which the processor still has at hand when
/// it gives the messages out.
///
/// An error ends it. Every message before it was whole, and none earlier than the one before.
#[derive(Debug)]
pub struct Messages<'a, F: ChunkedFile> {
    bag: &'a Bag<F>,
    wanted: Wanted,
    /// The chunks to read, in file order, cut into runs that follow each other in time.
    chunks: Vec<usize>,
    /// Where each run ends in `chunks`; the last one first.
    ends: Vec<usize>,
    /// How many of `chunks` have been read.
    read: usize,
    /// The present run, and how many of its messages have been given out.
    run: Timeline<'a>,
    given: usize,
    /// The time of the last message of the run before.
    last: u64,
}

impl<'a, F: ChunkedFile> Messages<'a, F> {
    pub(crate) fn new(bag: &'a Bag<F>, filter: impl Fn(&Connection) -> bool) -> Self {
        let wanted = Wanted::new(bag.connections.iter().filter(|each| filter(each)));
        let chunks = wanted.chunks(bag);
        unpack(bag, &chunks);
        let ends = ends(bag, &chunks);
        let run = Timeline::default();
        Self { bag, wanted, chunks, ends, read: 0, run, given: 0, last: 0 }
    }

    /// Reads on to the next message.
    #[cold]
    fn refill(&mut self) -> Option<Result<Message<'a>, BagError>> {
        while let Some(end) = self.ends.pop() {
            let last = self.run.len().checked_sub(1).and_then(|place| self.run.time(place));
            self.last = last.unwrap_or(self.last);
            self.given = 0;
            if let Err(error) = self.read_run(end) {
                self.run = Timeline::default();
                self.ends.clear();
                return Some(Err(error));
            }
            if let Some(message) = self.run.get(0) {
                self.given = 1;
                return Some(Ok(message));
            }
        }
        None
    }

    fn read_run(&mut self, end: usize) -> Result<(), BagError> {
        let run = &self.chunks[self.read..end];
        self.read = end;
        let mut draft = Draft::in_place_of(mem::take(&mut self.run));
        for at in run {
            draft.add_next(self.bag, *at, &self.wanted)?;
        }
        self.run = draft.order();
        // The runs were cut where, by the index, one ends before the next begins.
        match (self.run.time(0), run.first()) {
            (Some(time), Some(first)) if time < self.last => {
                let position = self.bag.chunks[*first].position;
                let expected = format!(
                    "no message before {} ns, as the index says of this chunk, found one at \
                     {time} ns; reindex the bag",
                    self.last
                );
                Err(BagError::damaged(position, expected))
            }
            _ => Ok(()),
        }
    }
}

/// Where a run may end: nothing before ends later than anything behind begins.
fn ends<F: ChunkedFile>(bag: &Bag<F>, chunks: &[usize]) -> Vec<usize> {
    let mut ends = Vec::with_capacity(chunks.len());
    let mut latest: Vec<u64> = Vec::with_capacity(chunks.len());
    for at in chunks {
        let before = latest.last().copied().unwrap_or(0);
        latest.push(before.max(bag.chunks[*at].end));
    }
    let mut behind = u64::MAX;
    for (place, at) in chunks.iter().enumerate().rev() {
        if latest[place] <= behind {
            ends.push(place + 1);
        }
        behind = behind.min(bag.chunks[*at].start);
    }
    ends
}

impl<'a, F: ChunkedFile> Iterator for Messages<'a, F> {
    type Item = Result<Message<'a>, BagError>;

    #[inline]
    fn next(&mut self) -> Option<Self::Item> {
        match self.run.get(self.given) {
            Some(message) => {
                self.given += 1;
                Some(Ok(message))
            }
            None => self.refill(),
        }
    }
}
