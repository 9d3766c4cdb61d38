//! Why a recording could not be read or written, as far as its user must know.

/// The format's own error, whose text and source are also those of what holds it.
type Cause = Box<dyn std::error::Error + Send + Sync>;

/// Why a recording could not be read or written; its text is that of the format's own error.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// Writing on would exceed the byte budget.
    #[error(transparent)]
    OverBudget(Cause),
    /// What is there can't be read.
    #[error(transparent)]
    Unreadable(Cause),
    /// Writing failed for another reason than the budget.
    #[error(transparent)]
    Unwritten(Cause),
}
