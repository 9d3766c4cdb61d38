//! Which format a recording has.

use std::fs::File;
use std::io::Read;
use std::path::Path;

/// A format of recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A bag of ROS 1, or bytes of no known format: what is wrong with them is named as of a bag.
    Bag,
    /// An MCAP file.
    Mcap,
}

/// The format of a file, by the bytes with which it begins.
///
/// # Errors
/// The file can't be read.
pub fn kind_of(path: &Path) -> std::io::Result<Kind> {
    let mut head = Vec::new();
    File::open(path)?.take(bagpipe_mcap::MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok(kind_of_bytes(&head))
}

/// The format of a file that begins with these bytes.
pub fn kind_of_bytes(head: &[u8]) -> Kind {
    if bagpipe_mcap::is_mcap(head) { Kind::Mcap } else { Kind::Bag }
}
