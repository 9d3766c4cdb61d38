//! Folders of rosbag2: `metadata.yaml`, and files of MCAP or SQLite as one recording.
//!
//! Everything becomes MCAP in memory: a file of SQLite is read once, by row, and each message
//! that was compressed alone is uncompressed. So whatever reads MCAP reads a folder as well.
//! A file is never written to, and what it says is not trusted: paths stay within the folder,
//! memory within a limit, and errors name the file and what was expected there.
//!
//! Not for: writing folders, or deserialising messages.
#![forbid(unsafe_code)]

mod bounds;
mod channel;
mod compressed;
mod error;
mod folder;
mod in_force;
mod metadata;
mod rows;
mod selection;
mod sqlite;
mod unpacked;
mod yaml;

pub use compressed::uncompress;
pub use error::Rosbag2Error;
pub use folder::{Folder, METADATA, Reading, mcap_of_database};
pub use metadata::{Compressed, MOST_METADATA_BYTES, Metadata, Storage, TopicCount, metadata};
pub use rows::{Rows, Stretch, rows};
pub use selection::Selection;
pub use sqlite::{Database, SQLITE_MAGIC};
pub use unpacked::unpacked;
