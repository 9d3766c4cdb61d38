//! The parts that a recording's messages lie in: chunks, and the data section between two.

use std::ops::Range;
use std::sync::OnceLock;

use crate::loss::Tally;
use crate::promise::Promise;
use crate::walk::{Channels, LEAST_MESSAGE, Walk, Walked};
use crate::{Compression, Loss};

/// A chunk, or what lies between two.
#[derive(Debug)]
pub(crate) struct Part {
    /// Byte offset of its first record in the file.
    pub position: usize,
    /// Where its (compressed) records lie in the file.
    pub data: Range<usize>,
    /// How they must be uncompressed, if they must.
    pub packed: Option<Packed>,
    /// The message indexes behind the chunk.
    pub promised: Vec<Promise>,
    /// The first and the last time that the chunk states.
    pub stated: (u64, u64),
    /// Set once its messages are found: for what lies in the file as it is, when that is opened.
    pub made: OnceLock<Box<Made>>,
}

/// What a compressed chunk says of its records.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Packed {
    pub compression: Compression,
    pub size: u32,
    /// 0 where it is not known.
    pub crc: u32,
}

impl Packed {
    /// Uncompresses a chunk's records in place of what `bytes` holds; says what is wrong with them,
    /// and how many bytes are lost.
    fn unpack(self, data: &[u8], bytes: &mut Vec<u8>) -> Option<(String, u64)> {
        let size = self.size as usize;
        let mut wrong = self.compression.decompress(data, self.size, bytes);
        bytes.truncate(size);
        if bytes.len() == size
            && let Some(expected) = wrong_crc(self.crc, || crc32fast::hash(bytes))
        {
            // No one knows which of them are wrong.
            bytes.clear();
            wrong.get_or_insert(expected);
        }
        let missing = (size - bytes.len()).max(1) as u64;
        wrong.map(|expected| (expected, missing))
    }
}

/// Records whose messages are found.
#[derive(Debug, Default)]
pub(crate) struct Made {
    /// What came out of a compressed chunk; empty where the file has the records.
    pub bytes: Vec<u8>,
    pub walked: Walked,
}

impl Part {
    /// Whether it is a chunk, whose records lie behind a head of its own.
    pub fn is_chunk(&self) -> bool {
        self.position != self.data.start
    }

    /// How many messages there are, as far as it is known.
    pub fn messages(&self) -> u64 {
        match self.made.get() {
            Some(made) => made.walked.places.len() as u64,
            None => self.promised.iter().map(Promise::messages).sum(),
        }
    }

    /// The times of the first and the last message, which nobody looked at in a chunk that is
    /// still compressed.
    pub fn times(&self) -> Option<(u64, u64)> {
        if self.messages() == 0 {
            return None;
        }
        Some(self.made.get().map_or(self.stated, |made| made.walked.times))
    }

    /// Whether it has messages of such a channel.
    pub fn holds(&self, wanted: impl Fn(u16) -> bool) -> bool {
        match self.made.get() {
            Some(made) => made.walked.counts.iter().any(|count| wanted(count.channel)),
            None => self.promised.iter().any(|each| wanted(each.channel)),
        }
    }

    /// Adds to what it lost where a message lies outside of the times that it states itself, by which
    /// it is chosen. Some writers state none.
    pub fn compare_times(&self, walked: &mut Walked) {
        let ((first, last), (stated, until)) = (walked.times, self.stated);
        let inside = stated <= first && last <= until;
        if inside || until == 0 || walked.places.is_empty() {
            return;
        }
        let expected =
            format!("messages from {stated} to {until} ns in a chunk, found {first} to {last} ns");
        walked.lost.add(self.position, expected, 0, Some(0));
    }

    /// Uncompresses it and finds its messages, whose places get the number `chunk`, in the
    /// memory of another.
    pub fn make(
        &self,
        (packed, chunk): (Packed, u32),
        file: &[u8],
        channels: &mut Channels,
        memory: Made,
    ) -> Made {
        let Made { mut bytes, mut walked } = memory;
        walked.clear();
        let data = &file[self.data.clone()];
        let mut lost = Tally::default();
        if let Some((expected, bytes)) = packed.unpack(data, &mut bytes) {
            lost.add(self.data.start, expected, bytes, None);
        }
        let promised: u64 = self.promised.iter().map(Promise::messages).sum();
        walked.places.reserve((bytes.len() / LEAST_MESSAGE).min(promised as usize));
        Walk { walked: &mut walked, channels, chunk, inside: true }.run(&mut bytes, 0);
        channels.forget(&walked.counts);
        if let Some(inner) = std::mem::take(&mut walked.lost).as_ref() {
            let Loss { offset, description, .. } = inner;
            let expected = format!("{description}, at byte {offset} of the uncompressed chunk");
            lost.add(self.data.start, expected, inner.bytes, inner.messages);
        }
        walked.lost = lost;
        self.compare_times(&mut walked);
        Made { bytes, walked }
    }
}

/// What is wrong with bytes of that CRC-32, which is 0 where it is not known.
pub(crate) fn wrong_crc(expected: u32, found: impl FnOnce() -> u32) -> Option<String> {
    let found = if expected == 0 { 0 } else { found() };
    (expected != found).then(|| format!("data of the CRC-32 {expected:08x}, found {found:08x}"))
}
