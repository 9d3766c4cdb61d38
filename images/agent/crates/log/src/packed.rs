//! Messages that were compressed one by one, where nothing in the recording says so.

use crate::MessageEncoding;

/// What every frame of zstd begins with.
const ZSTD: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

impl MessageEncoding {
    /// Whether a message of this encoding is a frame of zstd in its place, as rosbag2 stores it with
    /// `--compression-mode message`. That stands in `metadata.yaml` alone; but no CDR begins so, as
    /// its first byte is 0.
    pub fn is_packed(&self, data: &[u8]) -> bool {
        *self == Self::Cdr && data.starts_with(&ZSTD)
    }
}

/// The sentence about a topic with such messages.
pub fn packed(topic: &str) -> String {
    format!(
        "the messages of {topic} were compressed one by one (--compression-mode message), which only \
         the metadata.yaml of their folder states: name that folder, or make MCAP of it by `bagpipe \
         bag convert`"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_of_zstd_is_no_cdr_and_may_be_anything_else() {
        let frame = [0x28, 0xb5, 0x2f, 0xfd, 0x20];
        assert!(MessageEncoding::Cdr.is_packed(&frame));
        assert!(!MessageEncoding::Cdr.is_packed(&frame[..3]));
        assert!(!MessageEncoding::Cdr.is_packed(&[0, 1, 0, 0, 0x28, 0xb5, 0x2f, 0xfd]));
        // 4247762216 as the first field.
        assert!(!MessageEncoding::Ros1.is_packed(&frame));
    }
}
