//! Why a case has no result.

use bagpipe_wire::{Abort, PipeError};

/// An end without a result.
#[derive(Debug)]
pub enum Failure {
    /// The worker is told.
    Abort(Box<Abort>),
    /// There is nobody to tell, or no need: the reason is for the log.
    Silent(String),
}

impl Failure {
    pub fn new(reason: &str, message: impl Into<String>) -> Self {
        let abort =
            Abort { reason: reason.to_owned(), message: message.into(), ..Abort::default() };
        Self::Abort(Box::new(abort))
    }

    pub fn protocol(message: impl Into<String>) -> Self {
        Self::new("ProtocolError", message)
    }
}

impl From<PipeError> for Failure {
    fn from(error: PipeError) -> Self {
        match error {
            PipeError::Frame(_) | PipeError::Payload(..) => Self::protocol(error.to_string()),
            PipeError::Deadline(_) => Self::new("CaseDeadlineExceeded", error.to_string()),
            PipeError::Io(_) => Self::new("Internal", error.to_string()),
            PipeError::PeerGone(_) | PipeError::Cancelled => Self::Silent(error.to_string()),
        }
    }
}
