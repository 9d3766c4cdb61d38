//! What can be wrong with a recording: each error states the offset and what was expected.

use bagpipe_log::RecordingError;

/// Why an MCAP file could not be read or written.
#[derive(Debug, thiserror::Error)]
pub enum McapError {
    /// The first bytes are not those of an MCAP file.
    #[error("byte 0: expected the 8 bytes that MCAP files begin with, found {found}")]
    NotMcap {
        /// What stands there, printable.
        found: String,
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
        /// Byte offset of the chunk in the file.
        offset: u64,
        /// Bytes that it declares.
        needed: u64,
        /// Bytes that are left of the limit.
        allowed: u64,
    },
    /// Writing on would exceed the writer's byte budget.
    #[error("the recording would grow to {needed} bytes, over its budget of {budget}")]
    BudgetExceeded {
        /// The budget in bytes.
        budget: u64,
        /// The size that it would have had.
        needed: u64,
    },
    /// The file that a recording is spilled to could not be written.
    #[error("the recording cannot be written on from byte {offset}: {source}")]
    Unwritten {
        /// Byte offset in the file.
        offset: u64,
        /// The system's error.
        source: std::io::Error,
    },
    /// A message was written to a connection that was never added.
    #[error("connection {0} was never added to this recording")]
    UnknownConnection(u32),
    /// More channels than the format's 16-bit numbers can name.
    #[error("channel {0} is one too many: an MCAP file can name 65535")]
    TooManyChannels(u32),
    /// A message that no chunk of less than 4 GiB holds.
    #[error("a message of {0} bytes is longer than a chunk can hold (4 GiB)")]
    MessageTooLong(usize),
    /// Compressing a chunk failed.
    #[error("cannot compress a chunk: {0}")]
    Compress(std::io::Error),
}

impl McapError {
    /// The byte offset in the file that the error is about, if it is about one.
    pub fn offset(&self) -> Option<u64> {
        match self {
            Self::Damaged { offset, .. } | Self::MemoryLimit { offset, .. } => Some(*offset),
            Self::NotMcap { .. } => Some(0),
            _ => None,
        }
    }

    pub(crate) fn damaged(offset: usize, expected: impl Into<String>) -> Self {
        Self::Damaged { offset: offset as u64, expected: expected.into() }
    }
}

impl From<McapError> for RecordingError {
    fn from(error: McapError) -> Self {
        match error {
            McapError::BudgetExceeded { .. } => Self::OverBudget(error.into()),
            McapError::NotMcap { .. }
            | McapError::Damaged { .. }
            | McapError::MemoryLimit { .. } => Self::Unreadable(error.into()),
            McapError::Unwritten { .. }
            | McapError::UnknownConnection(_)
            | McapError::TooManyChannels(_)
            | McapError::MessageTooLong(_)
            | McapError::Compress(_) => Self::Unwritten(error.into()),
        }
    }
}
