//! What can be wrong with a ledger.

use crate::EndpointId;

/// The ledger can't be had, or what stands in it means nothing.
#[derive(Debug, thiserror::Error)]
pub enum LedgerError {
    /// The kernel gives no such memory.
    #[error("no shared memory for the ROS 2 ledger: {0}")]
    Memory(#[from] std::io::Error),
    /// A process of the stack wrote over it. No figure of it can be believed: the case is an error.
    #[error(
        "the ROS 2 ledger is damaged at byte {offset}: {what}; a process of the stack wrote it"
    )]
    Damaged {
        /// Where in the shared memory, in bytes.
        offset: usize,
        /// What stands there, and what should.
        what: String,
    },
    /// The endpoint was retired, and its slot may have another one.
    #[error("{0:?} was retired: ask for the endpoints again")]
    Retired(EndpointId),
    /// There is no room for another publisher of the reader's.
    #[error("the ROS 2 ledger knows {most} publishers of ours, and no more: play fewer topics")]
    Full {
        /// How many have room.
        most: usize,
    },
}
