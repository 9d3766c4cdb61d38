//! What can go wrong between us and the ROS graph, as sentences.

/// An error of the ROS graph client.
#[derive(Debug, thiserror::Error)]
pub enum RosError {
    /// The URI can't be used, with what is wrong about it.
    #[error("the URI \"{uri}\" can't be used: {why}; write http://host:port/")]
    BadUri {
        /// The URI as given.
        uri: String,
        /// What is wrong about it.
        why: String,
    },
    /// A call did not come back: no connection, a timeout or an HTTP error.
    #[error("{method} at {uri} did not answer: {why}")]
    Unreachable {
        /// The XML-RPC method.
        method: String,
        /// The server.
        uri: String,
        /// What the HTTP client said.
        why: String,
    },
    /// A call came back with a refusal (ROS status code below 1, or an XML-RPC fault).
    #[error("{method} at {uri} was refused: {why}")]
    Refused {
        /// The XML-RPC method.
        method: String,
        /// The server.
        uri: String,
        /// The status message.
        why: String,
    },
    /// An answer that does not have the form that the ROS wiki describes.
    #[error("{method} at {uri} gave an answer of the wrong form: {why}")]
    BadAnswer {
        /// The XML-RPC method.
        method: String,
        /// The server.
        uri: String,
        /// What was expected.
        why: String,
    },
    /// An integer that XML-RPC has no room for.
    #[error(
        "the integer {0} does not fit into 32 bits, which is all that ROS parameters have; \
         write it as a string or as a floating-point number"
    )]
    IntegerTooLarge(i64),
    /// A TCPROS handshake failed.
    #[error("the TCPROS handshake with {peer} failed: {why}")]
    Handshake {
        /// Address or name of the other side.
        peer: String,
        /// What was wrong.
        why: String,
    },
    /// A system call failed.
    #[error("{what}: {source}")]
    Io {
        /// What we were doing.
        what: String,
        /// The system's answer.
        source: std::io::Error,
    },
}

impl RosError {
    /// Wraps a system error with what was being done.
    pub(crate) fn io(what: impl Into<String>) -> impl FnOnce(std::io::Error) -> RosError {
        let what = what.into();
        move |source| RosError::Io { what, source }
    }
}
