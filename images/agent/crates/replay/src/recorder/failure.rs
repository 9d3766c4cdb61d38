//! Why a recording has failed.

use bagpipe_log::RecordingError;

use crate::ReplayError;

#[derive(Clone)]
pub(super) enum Failure {
    Budget(String),
    Other(String),
}

impl From<RecordingError> for Failure {
    fn from(error: RecordingError) -> Failure {
        match error {
            RecordingError::OverBudget(_) => Failure::Budget(error.to_string()),
            RecordingError::Unreadable(_) | RecordingError::Unwritten(_) => {
                Failure::Other(error.to_string())
            }
        }
    }
}

impl From<Failure> for ReplayError {
    fn from(failure: Failure) -> ReplayError {
        match failure {
            Failure::Budget(why) => ReplayError::RecorderBudgetExceeded(why),
            Failure::Other(why) => ReplayError::Internal(why),
        }
    }
}
