//! Messages of a recording, or of several, in one order.

use std::collections::HashMap;
use std::ops::Range;

use crate::Message;

/// Where one message lies: 24 bytes, so that a recording of millions stays small.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    /// When it was received by the recorder, in nanoseconds.
    pub time: u64,
    /// Its chunk's number, from 0.
    pub chunk: u32,
    /// Where its frame begins in the chunk's uncompressed data; its data begins 4 bytes on.
    pub start: u32,
    /// Where both end.
    pub end: u32,
    /// The id of its connection.
    pub connection: u32,
}

/// The messages of some connections by time, borrowed from the chunks that hold them.
#[derive(Debug, Default)]
pub struct Timeline<'a> {
    /// Each chunk's uncompressed data by its number; empty where it holds nothing wanted.
    chunks: Vec<&'a [u8]>,
    places: Vec<Place>,
}

impl<'a> Timeline<'a> {
    /// Orders messages that lie in `chunks`; those of the same time keep the order of `places`.
    /// Every place must lie within its chunk and be 4 bytes long at the least, since
    /// [`Timeline::get`] panics at another.
    pub fn new(chunks: Vec<&'a [u8]>, places: Vec<Place>) -> Self {
        let mut timeline = Self { chunks, places };
        if !timeline.places.is_sorted_by_key(|place| place.time) {
            timeline.places.sort_by_key(|place| place.time);
        }
        timeline
    }

    /// Several timelines as one; messages of the same time keep the order of the parts. Their
    /// bytes stay where they are. Each part comes with the numbers that its connections have in
    /// the whole, since every recording counts its own; a message of any other connection is
    /// left out.
    pub fn join(parts: Vec<(Timeline<'a>, HashMap<u32, u32>)>) -> Self {
        let (mut chunks, mut places) = (Vec::new(), Vec::new());
        for (part, numbers) in parts {
            let before = chunks.len() as u32;
            places.extend(part.places.into_iter().filter_map(|place| {
                let connection = *numbers.get(&place.connection)?;
                Some(Place { connection, chunk: before + place.chunk, ..place })
            }));
            chunks.extend(part.chunks);
        }
        Self::new(chunks, places)
    }

    /// The chunks' data and where each message lies, in order.
    pub fn into_parts(self) -> (Vec<&'a [u8]>, Vec<Place>) {
        (self.chunks, self.places)
    }

    /// How many messages there are.
    #[inline]
    pub fn len(&self) -> usize {
        self.places.len()
    }

    /// True when there is none.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.places.is_empty()
    }

    /// The message at that place in the order.
    #[inline]
    pub fn get(&self, index: usize) -> Option<Message<'a>> {
        self.places.get(index).map(|place| self.message(place))
    }

    /// Its time alone, in nanoseconds.
    #[inline]
    pub fn time(&self, index: usize) -> Option<u64> {
        self.places.get(index).map(|place| place.time)
    }

    /// The first message of each connection that has one.
    pub fn firsts(&self) -> HashMap<u32, Message<'a>> {
        let mut firsts = HashMap::new();
        for place in &self.places {
            firsts.entry(place.connection).or_insert_with(|| self.message(place));
        }
        firsts
    }

    /// The places of the messages with `start <= time < end`.
    pub fn between(&self, start: u64, end: u64) -> Range<usize> {
        let first = self.places.partition_point(|place| place.time < start);
        let last = self.places.partition_point(|place| place.time < end);
        first..last.max(first)
    }

    #[inline]
    fn message(&self, place: &Place) -> Message<'a> {
        let frame = &self.chunks[place.chunk as usize][place.start as usize..place.end as usize];
        Message { connection: place.connection, time: place.time, data: &frame[4..], frame }
    }
}
