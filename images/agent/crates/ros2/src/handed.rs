//! How many messages of a recorded topic were handed to the sink, in all and of each publisher.

use std::collections::BTreeMap;

/// By what a publisher is known in the graph, in the ledger and with each message.
pub(crate) type Gid = [u8; 16];

/// How many messages of a topic were handed to the sink.
#[derive(Clone, Debug, Default)]
pub(crate) struct Handed {
    pub(crate) all: u64,
    of: BTreeMap<Gid, u64>,
}

impl Handed {
    /// So many in `all`, and of those whose publishers are known.
    pub(crate) fn new(all: u64, of: BTreeMap<Gid, u64>) -> Handed {
        Handed { all, of }
    }

    /// Of one publisher.
    pub(crate) fn of(&self, gid: &Gid) -> u64 {
        self.of.get(gid).copied().unwrap_or(0)
    }

    /// Of those whose publisher is not known.
    pub(crate) fn of_nobody(&self) -> u64 {
        self.all - self.of.values().sum::<u64>()
    }
}
