//! ROS 1 bags (format 2.0; 1.2 is read as well) in memory: open, order, write.
//!
//! Two layers: [`Bag`] understands records, chunks and connections; below it a
//! [`ChunkedFile`] hands out bytes, from memory ([`MemoryChunkedFile`]) or from a file
//! ([`DiskChunkedFile`]). Reading never copies an uncompressed message, and a message's
//! bytes come with the length before them, which together are its TCPROS frame.
//!
//! Beside that: [`slice`], [`merge`], [`reindex`] (which also writes bags of format 1.2 as 2.0)
//! and [`check`]. Each has a twin whose memory is bounded by [`Limits`].
//! [`tail`] says where what lies, of bytes that others have read.
//!
//! Not for: deserialising messages, or encrypted bags (refused with a sentence).
//! Input is not trusted: every length is checked before it is believed, and errors name
//! the byte offset and what was expected there.

mod ahead;
mod bag;
mod build;
mod check;
mod chunk;
mod compression;
mod copy;
mod error;
mod file;
#[cfg(feature = "fuzzing")]
pub mod fuzzing;
mod merge;
mod messages;
mod model;
mod record;
mod recording;
mod reindex;
mod scan;
mod slice;
pub mod tail;
mod timeline;
mod unpack;
mod upgrade;
mod writer;

pub use bag::{Bag, Limits};
pub use bagpipe_log::{Checked, Connection, Loss, Message, Place, Window};
pub use check::{check, check_limited};
pub use compression::Compression;
pub use error::BagError;
pub use file::{ChunkedFile, DiskChunkedFile, MemoryChunkedFile};
pub use merge::merge;
pub use messages::Messages;
pub use model::ChunkInfo;
pub use reindex::{Reindexed, reindex, reindex_limited};
pub use slice::{Sliced, slice};
pub use timeline::{Timeline, TimelineIter};
pub use writer::{BagWriter, WriterOptions};

/// The line that every bag 2.0 begins with.
pub const MAGIC: &[u8; 13] = b"#ROSBAG V2.0\n";
