//! Recordings of every format that the agent reads: the one place that asks which one it is.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use bagpipe_log::{Loss, Recording};
use bagpipe_mcap::{Mcap, McapError};
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

impl From<McapError> for Refused {
    fn from(error: McapError) -> Self {
        Self {
            over_memory: matches!(error, McapError::MemoryLimit { .. }),
            offset: error.offset(),
            text: error.to_string(),
        }
    }
}

/// A file that was read as a whole, with its index where it has one. `memory` is how many bytes
/// may be taken beside it.
pub fn file(bytes: Vec<u8>, memory: u64) -> Result<Opened, Refused> {
    if bytes.starts_with(bagpipe_mcap::MAGIC) {
        return mcap(bytes, memory);
    }
    let limits = Limits { decompressed_bytes: memory };
    Ok(opened(Bag::open_limited(MemoryChunkedFile::new(bytes), limits)?))
}

/// What came over a pipe, which ends without an index.
pub fn stream(bytes: Vec<u8>, memory: u64) -> Result<Opened, Refused> {
    if bytes.starts_with(bagpipe_mcap::MAGIC) {
        return mcap(bytes, memory);
    }
    unindexed(MemoryChunkedFile::new(bytes), memory)
}

/// The same, where it was written to a file, of which parts are read as they are needed; but MCAP
/// is read as a whole.
///
/// # Errors
/// The outer one: the file can't be read.
pub fn stream_on_disk(path: &Path, memory: u64) -> std::io::Result<Result<Opened, Refused>> {
    let mut file = File::open(path)?;
    let mut bytes = Vec::new();
    file.by_ref().take(bagpipe_mcap::MAGIC.len() as u64).read_to_end(&mut bytes)?;
    if bytes == bagpipe_mcap::MAGIC {
        file.read_to_end(&mut bytes)?;
        return Ok(mcap(bytes, memory));
    }
    DiskChunkedFile::open(path).map(|file| unindexed(file, memory))
}

fn mcap(bytes: Vec<u8>, memory: u64) -> Result<Opened, Refused> {
    let limits = bagpipe_mcap::Limits { decompressed_bytes: memory };
    let mcap = Mcap::open_limited(bytes, limits)?;
    let (loss, span) = (mcap.loss().cloned(), mcap.time_range());
    Ok(Opened { loss, span, recording: Box::new(mcap) })
}

fn unindexed<F: ChunkedFile + 'static>(file: F, memory: u64) -> Result<Opened, Refused> {
    let limits = Limits { decompressed_bytes: memory };
    Ok(opened(Bag::open_unindexed_limited(file, limits)?))
}

fn opened<F: ChunkedFile + 'static>(bag: Bag<F>) -> Opened {
    Opened { loss: bag.loss().cloned(), span: bag.time_range(), recording: Box::new(bag) }
}
