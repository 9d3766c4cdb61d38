//! MCAP in memory: read, order, write.
//!
//! Reading ([`Mcap`]) takes the file's bytes over. A message's frame, its length (u32) and its
//! data, needs the length before the data, where MCAP has the publish time: the length is
//! written over that time's upper half, in chunks that were uncompressed and in the file's own
//! bytes alike, so that no message is copied. [`Mcap::stamp`] still says the whole time.
//! Writing ([`McapWriter`]) goes into memory, or chunk by chunk into a file.
//!
//! Not for: deserialising messages, or rosbag2's folders of several files and their
//! metadata.yaml. Input is not trusted: every length is checked before it is believed, and
//! errors name the byte offset and what was expected there.
#![forbid(unsafe_code)]

mod build;
mod compression;
mod connection;
mod crc;
mod definition;
mod error;
mod layout;
mod loss;
mod names;
mod part;
mod publish;
mod reader;
mod record;
mod recording;
mod rewrite;
mod summary;
pub mod tail;
mod walk;
mod writer;

pub use bagpipe_log::{Connection, Loss, Message, Place};
pub use compression::Compression;
pub use definition::ros1_md5;
pub use error::McapError;
pub use reader::{Limits, Mcap, Stamp};
pub use record::{Attachment, Channel, Metadata, Schema};
pub use rewrite::rewrite;
pub use writer::{McapWriter, WriterOptions};

/// What every MCAP file begins and ends with.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
