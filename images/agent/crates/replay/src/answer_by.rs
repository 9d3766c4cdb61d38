//! How an answer is matched to its input: as cases ask for it, and as results report it.

use serde::{Deserialize, Serialize};

/// How the answer that is waited for is recognised.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum AnswerBy {
    /// One more message than there was.
    #[default]
    Count,
    /// A header stamp not before the input's own.
    Stamp,
}
