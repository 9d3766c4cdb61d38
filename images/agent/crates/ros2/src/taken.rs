//! What a subscription has taken, and of whom.

use bagpipe_ros2ledger::Counts;

/// What a subscription has taken.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Taken {
    /// Whoever published it.
    pub(crate) all: u64,
    /// Of which it is known that it was ours.
    pub(crate) own: u64,
    /// Of which it is not known whose it was.
    pub(crate) unclear: u64,
}

impl Taken {
    pub(crate) fn of(counts: &Counts, known: bool) -> Taken {
        let Counts { taken: all, taken_own: own, taken_unknown: unclear, .. } = *counts;
        match known {
            true => Taken { all, own, unclear },
            false => Taken { all, own: 0, unclear: all },
        }
    }

    pub(crate) fn since(self, before: Taken) -> Taken {
        Taken {
            all: self.all.saturating_sub(before.all),
            own: self.own.saturating_sub(before.own),
            unclear: self.unclear.saturating_sub(before.unclear),
        }
    }

    /// Messages of ours. A middleware that says of none whose it is gives ours like all others; one that
    /// says it of some says it of ours, as our publisher is there.
    pub(crate) fn ours(self) -> u64 {
        if self.unclear == self.all { self.all } else { self.own }
    }

    /// Whether others' may be among them, beside somebody who has `published`; or where somebody was there
    /// whom nobody has seen.
    pub(crate) fn is_unclear(self, published: bool) -> bool {
        self.unclear > 0 && (published || self.unclear < self.all)
    }
}
