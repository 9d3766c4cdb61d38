//! What went out, and whether there is room for more.

use std::collections::VecDeque;

use bagpipe_graph::Share;

use crate::link::Totals;
use crate::subscriptions::MOST_WAITING;

/// Bytes that may be on their way to a subscriber: with more in flight of large messages a
/// middleware that fragments them gets slower, not faster (measured with Cyclone DDS).
const WINDOW: u64 = 1 << 20;

/// What went out.
#[derive(Default)]
pub(super) struct Sent {
    pub(super) totals: Totals,
    bytes: u64,
    /// The bytes that had gone out before each of the last messages, oldest first.
    before: VecDeque<u64>,
}

impl Sent {
    pub(super) fn add(&mut self, share: Share, bytes: usize) {
        if self.before.len() as u64 > MOST_WAITING {
            self.before.pop_front();
        }
        self.before.push_back(self.bytes);
        self.totals.add(share, bytes);
        self.bytes += bytes as u64;
    }

    /// Bytes of the last `messages`.
    fn bytes_of_last(&self, messages: u64) -> u64 {
        let from = (self.before.len() as u64).saturating_sub(messages);
        let before = usize::try_from(from).ok().and_then(|from| self.before.get(from));
        before.map_or(0, |before| self.bytes - before)
    }

    /// Whether one more message of `bytes` may go out to somebody who has `waiting` of them
    /// before it, in a queue of `depth`.
    pub(super) fn has_room(&self, waiting: u64, depth: u64, bytes: u64) -> bool {
        waiting == 0 || (waiting < depth && self.bytes_of_last(waiting) + bytes <= WINDOW)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_queue_and_a_mebibyte_give_credit_and_an_empty_queue_always_does() {
        let mut sent = Sent::default();
        assert!(sent.has_room(0, 1, 5 << 20));
        for _ in 0..10 {
            sent.add(Share::Counted, 100 << 10);
        }
        // Nine of a hundred KiB are below a mebibyte with one more, and below the depth.
        assert!(sent.has_room(9, 10, 100 << 10));
        assert!(!sent.has_room(9, 9, 100 << 10));
        assert!(!sent.has_room(9, 10, 200 << 10));
        assert!(sent.has_room(8, 10, 200 << 10));
    }

    #[test]
    fn only_the_last_messages_are_remembered() {
        let mut sent = Sent::default();
        for _ in 0..5 * MOST_WAITING {
            sent.add(Share::LeadIn, 3);
        }
        assert_eq!(sent.bytes_of_last(MOST_WAITING), 3 * MOST_WAITING);
        assert_eq!(sent.bytes_of_last(1), 3);
        assert_eq!(sent.before.len() as u64, MOST_WAITING + 1);
    }
}
