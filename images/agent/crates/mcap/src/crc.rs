//! The CRC-32 of a data section, which chunks' own are a part of.

use std::ops::Range;

use crc32fast::Hasher;

use crate::record::{DATA_END, FOOTER, HEAD, Head};

/// A Footer record and what follows it.
const FOOTER_LENGTH: usize = HEAD + 20;
/// A DataEnd record.
const DATA_END_LENGTH: usize = HEAD + 4;
/// So many bytes are in the processor's own memory when they are looked at again.
pub(crate) const STRIDE: usize = 256 << 10;

/// The CRC-32 that a data section ends in, and that of what was read of it.
#[derive(Debug)]
pub(crate) struct DataCrc {
    pub expected: u32,
    /// Where the DataEnd record must lie.
    pub end: usize,
    hasher: Hasher,
    /// Bytes before this are in the hasher.
    read: usize,
}

impl DataCrc {
    /// `None` where the file has no such checksum, or not at the place that its footer says.
    pub fn of(file: &[u8], magic: usize) -> Option<Self> {
        let footer = file.len().checked_sub(magic + FOOTER_LENGTH)?;
        let head = Head::read(file, footer).ok().filter(|head| head.op == FOOTER)?;
        let summary = u64::from_le_bytes(*file.get(head.start..)?.first_chunk()?);
        let next = if summary == 0 { footer } else { usize::try_from(summary).ok()? };
        let end = next.checked_sub(DATA_END_LENGTH)?;
        let head = Head::read(file, end).ok().filter(|head| head.op == DATA_END)?;
        let expected = u32::from_le_bytes(*file.get(head.start..)?.first_chunk()?);
        (expected != 0).then(|| Self { expected, end, hasher: Hasher::new(), read: 0 })
    }

    /// Takes what lies before `end`, if it was not taken yet.
    pub fn take(&mut self, file: &[u8], end: usize) {
        if let Some(bytes) = file.get(self.read..end) {
            self.hasher.update(bytes);
            self.read = end;
        }
    }

    /// Takes a chunk's records, of which this is the CRC-32.
    pub fn take_chunk(&mut self, file: &[u8], records: Range<usize>, crc: &Hasher) {
        if self.read <= records.start {
            self.take(file, records.start);
            self.hasher.combine(crc);
            self.read = records.end;
        }
    }

    /// The CRC-32 of all that was taken.
    pub fn found(self) -> u32 {
        self.hasher.finalize()
    }
}
