//! The nodes that are there when the play begins, and what has become of them at its end.

/// A node when the play began.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Known {
    pub name: String,
    /// Where it answers, or whatever else distinguishes it from one that takes its name later.
    pub uri: String,
    /// None where it did not say.
    pub pid: Option<i32>,
    /// Whether the graph still had it when all input was out.
    pub stayed: bool,
}

/// What has become of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// It is there, as it was; or nobody could say.
    Same,
    /// The graph does not have it any more.
    Unregistered,
    /// The graph has it, and nobody answers.
    Unreachable,
    /// Another process has its name.
    Another,
}
