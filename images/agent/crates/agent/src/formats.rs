//! Recordings of every format that the agent reads: the one place that asks which one it is.

use std::path::Path;

use bagpipe_log::{Loss, Recording};
use bagpipe_rosbag::{Bag, BagError, ChunkedFile, DiskChunkedFile, Limits, MemoryChunkedFile};

/// A recording that is open, and what its format knows of it before a message is read.
pub struct Opened {
    pub recording: Box<dyn Recording>,
    /// What is lost to damage; the rest can be played.
    pub loss: Option<Loss>,
    /// The times of the first and the last message, in nanoseconds.
    pub span: Option<(u64, u64)>,
}

/// Why bytes are no recording; the text begins with `byte N: ` where `offset` is known.
#[derive(Debug)]
pub struct Refused {
    /// True where more memory would help.
    pub over_memory: bool,
    pub offset: Option<u64>,
    pub text: String,
}

impl From<BagError> for Refused {
    fn from(error: BagError) -> Self {
        Self {
            over_memory: matches!(error, BagError::MemoryLimit { .. }),
            offset: error.offset(),
            text: error.to_string(),
        }
    }
}

/// A file that was read as a whole, with its index where it has one. `memory` is how many bytes
/// may be taken beside it.
pub fn file(bytes: Vec<u8>, memory: u64) -> Result<Opened, Refused> {
    let limits = Limits { decompressed_bytes: memory };
    Ok(opened(Bag::open_limited(MemoryChunkedFile::new(bytes), limits)?))
}

/// What came over a pipe, which ends without an index.
pub fn stream(bytes: Vec<u8>, memory: u64) -> Result<Opened, Refused> {
    unindexed(MemoryChunkedFile::new(bytes), memory)
}

/// The same, where it was written to a file, of which parts are read as they are needed.
///
/// # Errors
/// The outer one: the file can't be opened.
pub fn stream_on_disk(path: &Path, memory: u64) -> std::io::Result<Result<Opened, Refused>> {
    DiskChunkedFile::open(path).map(|file| unindexed(file, memory))
}

fn unindexed<F: ChunkedFile + 'static>(file: F, memory: u64) -> Result<Opened, Refused> {
    let limits = Limits { decompressed_bytes: memory };
    Ok(opened(Bag::open_unindexed_limited(file, limits)?))
}

fn opened<F: ChunkedFile + 'static>(bag: Bag<F>) -> Opened {
    Opened { loss: bag.loss().cloned(), span: bag.time_range(), recording: Box::new(bag) }
}
