//! What can be wrong with a bag, said with the offset and what was expected.

/// Why a bag could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The file could not be read at all.
    #[error("cannot read {length} bytes at byte {offset}: {source}")]
    Io {
        /// Byte offset in the file.
        offset: u64,
        /// How many bytes were asked for.
        length: usize,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file that a bag is spilled to could not be written.
    #[error("the bag cannot be written on from byte {offset}: {source}")]
    Unwritten {
        /// Byte offset in the file.
        offset: u64,
        /// What the system said.
        source: std::io::Error,
    },
    /// The first line is not that of a bag that this crate reads.
    #[error("byte 0: expected the line \"#ROSBAG V2.0\", found {found}")]
    NotABag {
        /// What stands there, printable.
        found: String,
    },
    /// The bag is encrypted.
    #[error("the bag is encrypted with {encryptor:?}; decrypt it with `rosbag encrypt` first")]
    Encrypted {
        /// The plugin that the file header names.
        encryptor: String,
    },
    /// Bytes do not say what the format demands.
    #[error("byte {offset}: expected {expected}")]
    Damaged {
        /// Byte offset in the file.
        offset: u64,
        /// What should have been there.
        expected: String,
    },
    /// Reading on would need more memory than the caller allowed.
    #[error(
        "byte {offset}: what lies there needs {needed} bytes of memory, and the limit leaves \
         {allowed}"
    )]
    MemoryLimit {
        /// Byte offset of the chunk, or the record, in the file.
        offset: u64,
        /// Bytes that it declares.
        needed: u64,
        /// Bytes that are left of the limit.
        allowed: u64,
    },
    /// Writing on would exceed the writer's byte budget.
    #[error("the bag would grow to {needed} bytes, over its budget of {budget}")]
    BudgetExceeded {
        /// The budget in bytes.
        budget: u64,
        /// The size that it would have had.
        needed: u64,
    },
    /// A message was written to a connection that was never added.
    #[error("connection {0} was never added to this bag")]
    UnknownConnection(u32),
    /// A message is longer than the format's 32-bit length can say.
    #[error("a message of {0} bytes is longer than a bag can hold (4 GiB)")]
    MessageTooLong(usize),
    /// Compressing a chunk failed.
    #[error("cannot compress a chunk: {0}")]
    Compress(std::io::Error),
}

impl BagError {
    /// The byte offset in the file that the error is about, if it is about one.
    pub fn offset(&self) -> Option<u64> {
        match self {
            Self::Io { offset, .. }
            | Self::Damaged { offset, .. }
            | Self::MemoryLimit { offset, .. } => Some(*offset),
            Self::NotABag { .. } => Some(0),
            _ => None,
        }
    }

    pub(crate) fn damaged(offset: u64, expected: impl Into<String>) -> Self {
        Self::Damaged { offset, expected: expected.into() }
    }
}
