//! Consecutive messages that go out together, at full speed.

use bagpipe_graph::{Cancelled, Outlet, SendError, Share};

/// Messages that go out in one system call at most, and their bytes: at full speed.
const BATCH: usize = 1024;
const BATCH_BYTES: usize = 1 << 20;
/// What the slowest subscriber may have left unread before it is waited for, at full speed:
/// bytes and messages, whichever is less.
const WINDOW_BYTES: u64 = 16 << 20;
const WINDOW_MESSAGES: u64 = 16_384;

/// Consecutive messages of one connection.
#[derive(Default)]
pub(crate) struct Batch<'a> {
    pub(crate) connection: u32,
    pub(crate) frames: Vec<&'a [u8]>,
    bytes: usize,
    /// Bag time of the last one.
    pub(crate) time: u64,
}

impl<'a> Batch<'a> {
    /// Whether a frame may join.
    pub(crate) fn takes(&self, connection: u32, bytes: usize) -> bool {
        let room = self.frames.len() < BATCH && self.bytes + bytes <= BATCH_BYTES;
        self.frames.is_empty() || (self.connection == connection && room)
    }

    /// One more.
    pub(crate) fn add(&mut self, connection: u32, frame: &'a [u8]) {
        self.connection = connection;
        self.bytes += frame.len();
        self.frames.push(frame);
    }

    /// Has gone out.
    pub(crate) fn clear(&mut self) {
        self.frames.clear();
        self.bytes = 0;
    }

    /// Goes out as soon as the slowest subscriber has read enough of what went before.
    pub(crate) fn go_out(
        &self,
        outlet: &(impl Outlet + ?Sized),
        share: Share,
        cancelled: Cancelled<'_>,
    ) -> Result<(), SendError> {
        outlet.await_unread(self.window(), cancelled)?;
        outlet.send(share, &self.frames, cancelled)
    }

    /// The bytes that may be unread; as many messages of this batch's size are not more than allowed.
    fn window(&self) -> u64 {
        let messages = self.frames.len().max(1) as u64;
        WINDOW_BYTES.min(WINDOW_MESSAGES * self.bytes as u64 / messages)
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::collections::VecDeque;

    use super::*;

    /// A subscriber in memory, which reads nothing until it is waited for.
    #[derive(Default)]
    struct Idle {
        unread: RefCell<VecDeque<usize>>,
        /// The most that it ever had before it: messages and bytes.
        most: RefCell<(usize, usize)>,
        waited_for: RefCell<usize>,
        read: RefCell<usize>,
    }

    impl Idle {
        fn bytes(&self) -> usize {
            self.unread.borrow().iter().sum()
        }
    }

    impl Outlet for Idle {
        fn topic(&self) -> &str {
            "/idle"
        }

        fn latch(&self, _: &str, _: Share, _: &[u8]) {}

        fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
            while self.bytes() as u64 > window {
                if cancelled() {
                    return Err(SendError::Cancelled);
                }
                *self.waited_for.borrow_mut() += 1;
                self.unread.borrow_mut().pop_front();
                *self.read.borrow_mut() += 1;
            }
            Ok(())
        }

        fn send(&self, _: Share, frames: &[&[u8]], _: Cancelled<'_>) -> Result<(), SendError> {
            self.unread.borrow_mut().extend(frames.iter().map(|frame| frame.len()));
            let (messages, bytes) = (self.unread.borrow().len(), self.bytes());
            let mut most = self.most.borrow_mut();
            *most = (most.0.max(messages), most.1.max(bytes));
            Ok(())
        }
    }

    /// Plays so many frames of one size.
    fn played(outlet: &Idle, messages: usize, size: usize) -> Result<(), SendError> {
        let frame = vec![0; size];
        let mut batch = Batch::default();
        for _ in 0..messages {
            if !batch.takes(1, size) {
                batch.go_out(outlet, Share::Counted, &mut || false)?;
                batch.clear();
            }
            batch.add(1, &frame);
        }
        batch.go_out(outlet, Share::Counted, &mut || false)
    }

    // Promise: window-of-max
    #[test]
    fn small_messages_wait_once_16384_are_unread_and_never_before() {
        let idle = Idle::default();
        played(&idle, 16_384 + 1_024, 24).unwrap();
        assert_eq!(*idle.waited_for.borrow(), 0);
        played(&idle, 40 * 1_024, 24).unwrap();
        // What goes out at once comes on top.
        assert_eq!(*idle.most.borrow(), (16_384 + 1_024, (16_384 + 1_024) * 24));
        assert_eq!(idle.read.into_inner(), 40 * 1_024);
    }

    // Promise: window-of-max
    #[test]
    fn large_messages_wait_once_16_mib_are_unread_and_never_before() {
        let idle = Idle::default();
        // Four frames of 256 KiB are a batch.
        played(&idle, 64 + 4, 256 << 10).unwrap();
        assert_eq!(*idle.waited_for.borrow(), 0);
        played(&idle, 400, 256 << 10).unwrap();
        assert_eq!(*idle.most.borrow(), (64 + 4, 17 << 20));
        assert_eq!(idle.read.into_inner(), 400);
    }

    #[test]
    fn a_message_larger_than_the_window_goes_out_alone_once_the_one_before_is_read() {
        let idle = Idle::default();
        played(&idle, 3, 20 << 20).unwrap();
        assert_eq!(*idle.most.borrow(), (1, 20 << 20));
        assert_eq!(idle.read.into_inner(), 2);
    }

    #[test]
    fn who_waits_is_asked_whether_to_give_up() {
        let idle = Idle::default();
        played(&idle, 16_384 + 1_024, 24).unwrap();
        let frame = [0; 24];
        let mut batch = Batch::default();
        batch.add(1, &frame);
        let asked = batch.go_out(&idle, Share::Counted, &mut || true);
        assert_eq!(asked, Err(SendError::Cancelled));
        assert_eq!(idle.unread.borrow().len(), 16_384 + 1_024);
    }

    #[test]
    fn a_run_holds_1024_messages_and_a_mebibyte_of_one_connection() {
        let small = [0; 8];
        let mut batch = Batch::default();
        for _ in 0..1_024 {
            assert!(batch.takes(1, small.len()));
            batch.add(1, &small);
        }
        assert!(!batch.takes(1, small.len()));
        batch.clear();
        let half = vec![0; 512 << 10];
        batch.add(1, &half);
        assert!(batch.takes(1, half.len()) && !batch.takes(1, half.len() + 1));
        assert!(!batch.takes(2, 8));
    }
}
