//! Where messages go out.

use bagpipe_ros1::{Publication, SendError, Share};

/// A published topic and its subscribers.
pub(crate) trait Outlet {
    /// The topic's name, with its leading slash.
    fn topic(&self) -> &str;
    /// As [`Publication::latch`].
    fn latch(&self, publisher: &str, share: Share, frame: &[u8]);
    /// As [`Publication::send`].
    fn send(&self, share: Share, frames: &[&[u8]], c: Cancelled<'_>) -> Result<(), SendError>;
    /// As [`Publication::await_unread`].
    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError>;
}

/// Asked now and then whether to give up.
pub(crate) type Cancelled<'a> = &'a mut dyn FnMut() -> bool;

impl Outlet for Publication {
    fn topic(&self) -> &str {
        &self.info().topic
    }

    fn latch(&self, publisher: &str, share: Share, frame: &[u8]) {
        Publication::latch(self, publisher, share, frame);
    }

    fn send(&self, share: Share, frames: &[&[u8]], c: Cancelled<'_>) -> Result<(), SendError> {
        Publication::send(self, share, frames, c)
    }

    fn await_unread(&self, window: u64, cancelled: Cancelled<'_>) -> Result<(), SendError> {
        Publication::await_unread(self, window, cancelled)
    }
}
