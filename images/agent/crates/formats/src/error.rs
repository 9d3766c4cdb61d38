//! Why a recording of any format was not read or made.

use bagpipe_log::RecordingError;
use bagpipe_mcap::McapError;
use bagpipe_rosbag::BagError;
use bagpipe_rosbag2::Rosbag2Error;

/// Why a recording was not read or made; the text is that of the format's own error.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// A bag.
    #[error(transparent)]
    Bag(#[from] BagError),
    /// MCAP.
    #[error(transparent)]
    Mcap(#[from] McapError),
    /// A folder of rosbag2, or a file of one.
    #[error(transparent)]
    Rosbag2(#[from] Rosbag2Error),
    /// Any, through the seam.
    #[error(transparent)]
    Recording(#[from] RecordingError),
    /// The system refused a file.
    #[error(transparent)]
    System(#[from] std::io::Error),
    /// What was asked for can't be; the sentence says why, and what to do.
    #[error("{0}")]
    Refused(String),
}

impl FormatError {
    /// Whether more memory would help.
    pub fn over_memory(&self) -> bool {
        match self {
            Self::Bag(error) => {
                matches!(error, BagError::MemoryLimit { .. } | BagError::BudgetExceeded { .. })
            }
            Self::Mcap(error) => {
                matches!(error, McapError::MemoryLimit { .. } | McapError::BudgetExceeded { .. })
            }
            Self::Rosbag2(error) => error.over_memory(),
            Self::Recording(error) => matches!(error, RecordingError::OverBudget(_)),
            Self::System(_) | Self::Refused(_) => false,
        }
    }
}
