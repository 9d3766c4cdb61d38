//! What can go wrong between us and a graph.

use std::error::Error;

/// A call to the graph failed.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {source}")]
pub struct GraphError {
    /// The reason of the ABORT frame, such as `RosMasterFailed`.
    pub reason: &'static str,
    /// What failed, as the beginning of a sentence.
    pub what: &'static str,
    /// The middleware's own error.
    pub source: Box<dyn Error + Send + Sync>,
}
