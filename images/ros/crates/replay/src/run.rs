//! Consecutive messages that go out together, at full speed.

/// Messages that go out in one system call at most, and their bytes: at full speed.
const RUN: usize = 1024;
const RUN_BYTES: usize = 1 << 20;
/// Consecutive messages of one connection.
#[derive(Default)]
pub(crate) struct Run<'a> {
    pub(crate) connection: u32,
    pub(crate) frames: Vec<&'a [u8]>,
    pub(crate) bytes: usize,
    /// Bag time of the last one.
    pub(crate) time: u64,
}

impl Run<'_> {
    /// Whether a frame may join.
    pub(crate) fn takes(&self, connection: u32, bytes: usize) -> bool {
        let room = self.frames.len() < RUN && self.bytes + bytes <= RUN_BYTES;
        self.frames.is_empty() || (self.connection == connection && room)
    }
}
