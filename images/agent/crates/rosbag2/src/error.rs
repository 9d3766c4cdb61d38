//! What can be wrong with a folder.

use std::path::PathBuf;

use bagpipe_mcap::McapError;

/// Why a folder of rosbag2, or a file of one, was not read.
#[derive(Debug, thiserror::Error)]
pub enum Rosbag2Error {
    /// metadata.yaml does not say what rosbag2 writes.
    #[error("metadata.yaml, line {line}: expected {expected}")]
    Metadata {
        /// Counted from 1; 0 where it is about all of it.
        line: usize,
        /// What should have been there.
        expected: String,
    },
    /// A file of SQLite does not hold what rosbag2 writes.
    #[error("{table}: expected {expected}")]
    Database {
        /// The table, and the row where it is about one.
        table: String,
        /// What should have been there.
        expected: String,
    },
    /// SQLite can't read the file.
    #[error("SQLite can't read it: {0}")]
    Sqlite(#[source] rusqlite::Error),
    /// Compressed bytes that can't be uncompressed.
    #[error("{what}: expected {expected}")]
    Compressed {
        /// The file or the message.
        what: String,
        /// What should have been there.
        expected: String,
    },
    /// Reading on would need more memory than the caller allowed.
    #[error("{what} needs more than the {allowed} bytes of memory that the limit leaves")]
    MemoryLimit {
        /// The file or the message.
        what: String,
        /// Bytes that are left of the limit.
        allowed: u64,
    },
    /// A file of MCAP, or the MCAP that is made of another.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// One of the files.
    #[error("{}: {source}", file.display())]
    File {
        /// Its path in the folder.
        file: PathBuf,
        /// What is wrong with it.
        source: Box<Rosbag2Error>,
    },
    /// The system refused a file.
    #[error(transparent)]
    System(#[from] std::io::Error),
}

impl From<rusqlite::Error> for Rosbag2Error {
    fn from(error: rusqlite::Error) -> Self {
        // Nothing but our own bound interrupts a query.
        match error.sqlite_error_code() {
            Some(rusqlite::ErrorCode::OperationInterrupted) => {
                let expected = "tables with no more rows than fit in a file of its size";
                Self::database("the file", expected)
            }
            _ => Self::Sqlite(error),
        }
    }
}

impl Rosbag2Error {
    pub(crate) fn metadata(line: usize, expected: impl Into<String>) -> Self {
        Self::Metadata { line, expected: expected.into() }
    }

    pub(crate) fn database(table: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Database { table: table.into(), expected: expected.into() }
    }

    /// Whether more memory would help.
    pub fn over_memory(&self) -> bool {
        match self {
            Self::MemoryLimit { .. } => true,
            Self::Mcap(error) => {
                matches!(error, McapError::MemoryLimit { .. } | McapError::BudgetExceeded { .. })
            }
            Self::File { source, .. } => source.over_memory(),
            _ => false,
        }
    }

    /// With the name of the file that it is about.
    pub(crate) fn of(self, file: &str) -> Self {
        Self::File { file: PathBuf::from(file), source: Box::new(self) }
    }
}
