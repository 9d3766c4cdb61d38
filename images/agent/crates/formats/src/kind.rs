//! Which format a recording has.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use bagpipe_rosbag2::{METADATA, SQLITE_MAGIC};

/// A format of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A bag of ROS 1, or bytes of no known format: what is wrong with them is named as of a bag.
    Bag,
    /// An MCAP file.
    Mcap,
    /// A file of SQLite, as rosbag2 writes it.
    Database,
    /// A folder of rosbag2, or its `metadata.yaml`.
    Folder,
}

/// The format of a file, by the bytes with which it begins; a folder is rosbag2's.
///
/// # Errors
/// The file can't be read.
pub fn kind_of(path: &Path) -> std::io::Result<Kind> {
    if path.is_dir() || path.file_name().is_some_and(|name| name == METADATA) {
        return Ok(Kind::Folder);
    }
    let mut head = Vec::new();
    File::open(path)?.take(SQLITE_MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(kind_of_bytes(&head))
}

/// The format of a file that begins with these bytes.
pub fn kind_of_bytes(head: &[u8]) -> Kind {
    if bagpipe_mcap::is_mcap(head) {
        Kind::Mcap
    } else if head.starts_with(SQLITE_MAGIC) {
        Kind::Database
    } else {
        Kind::Bag
    }
}
