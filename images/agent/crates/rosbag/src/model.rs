//! What of a bag other formats have not: its chunks.

use crate::Compression;

/// Where a chunk lies and what it holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChunkInfo {
    /// Byte offset of the CHUNK record in the file.
    pub position: u64,
    /// Time of the earliest message, in nanoseconds.
    pub start: u64,
    /// Time of the latest message, in nanoseconds.
    pub end: u64,
    /// Messages for each connection id.
    pub counts: Vec<(u32, u32)>,
    /// How its data is compressed.
    pub compression: Compression,
    /// Byte offset of its (compressed) data in the file.
    pub data_position: u64,
    /// Bytes of its (compressed) data that the file has.
    pub data_length: u32,
    /// Bytes of its data once uncompressed, as the bag declares it.
    pub size: u32,
    /// Bytes of its uncompressed data that are whole records: `size` unless it is damaged.
    pub usable: u32,
    /// True when a scan found it damaged: even where all came out, its bytes are not whole.
    pub damaged: bool,
}

impl ChunkInfo {
    /// How many messages the chunk holds.
    pub fn messages(&self) -> u64 {
        self.counts.iter().map(|(_, count)| u64::from(*count)).sum()
    }
}
