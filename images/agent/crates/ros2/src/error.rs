//! What the graph's callers get when it fails.

use bagpipe_graph::GraphError;

/// An error of the graph, with its cause.
pub(crate) fn failed(source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> GraphError {
    GraphError { reason: "Ros2Failed", what: "the ROS 2 graph failed", source: source.into() }
}
