//! Frames in, headers out: the payload is never copied.

use crate::frame::{FrameType, HEADER_BYTES, MAGIC, MAX_PAYLOAD, VERSION};
use crate::message::End;

/// Numbers and sums up one direction of a session.
#[derive(Debug, Clone, Default)]
pub struct Encoder {
    sequence: u32,
    digest: u32,
    files: u64,
    data_bytes: u64,
}

impl Encoder {
    /// An encoder at the beginning of a stream.
    pub fn new() -> Self {
        Self::default()
    }

    /// The header that goes before `payload`; `None` when the payload is too long, or is
    /// DATA and empty.
    pub fn header(&mut self, kind: FrameType, payload: &[u8]) -> Option<[u8; HEADER_BYTES]> {
        let is_data = kind == FrameType::Data;
        if payload.len() > MAX_PAYLOAD || (is_data && payload.is_empty()) {
            return None;
        }
        let mut header = [0; HEADER_BYTES];
        header[..4].copy_from_slice(&MAGIC);
        header[4] = VERSION;
        header[5] = kind as u8;
        header[8..12].copy_from_slice(&(payload.len() as u32).to_le_bytes());
        header[12..16].copy_from_slice(&self.sequence.to_le_bytes());
        let crc = crc32c::crc32c_append(crc32c::crc32c(&header[..16]), payload);
        header[16..].copy_from_slice(&crc.to_le_bytes());
        self.sequence = self.sequence.wrapping_add(1);
        if kind != FrameType::End {
            self.digest = crc32c::crc32c_append(self.digest, &header[16..]);
        }
        match kind {
            FrameType::File => self.files += 1,
            FrameType::Data => self.data_bytes += payload.len() as u64,
            _ => {}
        }
        Some(header)
    }

    /// What END must say about everything before it.
    pub fn end(&self) -> End {
        End { files: self.files, bytes: self.data_bytes, digest: self.digest }
    }
}
