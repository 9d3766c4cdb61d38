//! MCAP in memory: read, order, write.
//!
//! Reading ([`Mcap`]) takes the file's bytes over. A message's frame, its length (u32) and its
//! data, needs the length before the data, where MCAP has the publish time: the length is
//! written over that time's upper half, in chunks that were uncompressed and in the file's own
//! bytes alike, so that no message is copied. [`Mcap::stamp`] still says the whole time.
//! Writing ([`McapWriter`]) goes into memory, or chunk by chunk into a file. Beside that:
//! [`slice`], [`merge`], [`rewrite`] and [`check`].
//!
//! Not for: deserialising messages, or rosbag2's folders (`crates/rosbag2`). Input is not trusted: every length is checked before it is believed, and
//! errors name the byte offset and what was expected there.
#![forbid(unsafe_code)]

mod asked;
mod build;
mod carry;
mod check;
mod compression;
mod connection;
mod crc;
mod definition;
mod error;
mod facts;
mod layout;
mod loss;
mod merge;
mod names;
mod packed;
mod part;
mod promise;
mod publish;
mod reader;
mod record;
mod recording;
mod rewrite;
mod slice;
mod summary;
pub mod tail;
mod walk;
mod writer;

pub use bagpipe_log::{Checked, Connection, Loss, Message, Place, Window};
pub use check::{check, is_mcap};
pub use compression::Compression;
pub use definition::ros1_md5;
pub use error::McapError;
pub use merge::merge;
pub use reader::{Limits, Mcap, Stamp};
pub use record::{Attachment, Channel, Metadata, Schema};
pub use rewrite::rewrite;
pub use slice::{Latched, Sliced, slice};
pub use writer::{McapWriter, WriterOptions};

/// What every MCAP file begins and ends with.
pub const MAGIC: &[u8; 8] = b"\x89MCAP0\r\n";
