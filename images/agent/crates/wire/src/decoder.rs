//! Bytes in, frames out.

use crate::End;
use crate::frame::{Frame, FrameError, FrameType, HEADER_BYTES, MAGIC, MAX_PAYLOAD, VERSION};

/// Decodes one direction of a session from pieces of any size. Holds one frame at most.
#[derive(Debug, Default)]
pub struct Decoder {
    /// Offset of the frame that is being received.
    offset: u64,
    /// Its sequence number.
    sequence: u32,
    /// Its bytes so far.
    frame: Vec<u8>,
    /// True when `frame` is whole and was handed out.
    handed_out: bool,
    digest: u32,
    files: u64,
    data_bytes: u64,
}

impl Decoder {
    /// A decoder at the beginning of a stream.
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes bytes from the front of `input` until a frame is whole; `None` when all of it
    /// was taken before that. After an error the stream has no meaning any more.
    pub fn next_frame(&mut self, input: &mut &[u8]) -> Result<Option<Frame<'_>>, FrameError> {
        if self.handed_out {
            self.offset += self.frame.len() as u64;
            self.sequence = self.sequence.wrapping_add(1);
            self.frame.clear();
            self.handed_out = false;
        }
        if self.frame.len() < HEADER_BYTES {
            self.take(input, HEADER_BYTES);
            if self.frame.len() < HEADER_BYTES {
                return Ok(None);
            }
            self.check_header()?;
        }
        let whole = HEADER_BYTES + self.u32_at(8) as usize;
        self.take(input, whole);
        if self.frame.len() < whole {
            return Ok(None);
        }
        let (kind, sequence) = self.check_whole()?;
        self.handed_out = true;
        Ok(Some(Frame { kind, flags: 0, sequence, payload: &self.frame[HEADER_BYTES..] }))
    }

    /// Says that the stream ended: an error inside a frame.
    pub fn finish(&self) -> Result<(), FrameError> {
        if self.frame.is_empty() || self.handed_out {
            return Ok(());
        }
        let expected = match self.frame.len() {
            found if found < HEADER_BYTES => {
                format!("{HEADER_BYTES} bytes of header, found the end after {found}")
            }
            found => {
                let (found, length) = (found - HEADER_BYTES, self.u32_at(8));
                format!("{length} bytes of payload, found the end after {found}")
            }
        };
        Err(self.wrong("truncated", expected))
    }

    /// The bytes of a frame that is not whole, or is wrong: what a successor of a dead peer
    /// wrote may be among them.
    pub fn unfinished(&self) -> &[u8] {
        if self.handed_out { &[] } else { &self.frame }
    }

    /// Offset of the frame that is being received.
    pub fn offset(&self) -> u64 {
        let done = if self.handed_out { self.frame.len() as u64 } else { 0 };
        self.offset + done
    }

    /// CRC-32C over the checksums of all frames before END.
    pub fn digest(&self) -> u32 {
        self.digest
    }

    /// Bytes of DATA so far.
    pub fn data_bytes(&self) -> u64 {
        self.data_bytes
    }

    /// Whether the END of the other side counts what arrived here.
    ///
    /// # Errors
    /// A sentence with both.
    pub fn check_end(&self, claimed: End) -> Result<(), String> {
        let found = End { files: self.files, bytes: self.data_bytes, digest: self.digest };
        if claimed == found {
            return Ok(());
        }
        Err(format!("END says {claimed:?}, and what came is {found:?}"))
    }

    fn take(&mut self, input: &mut &[u8], whole: usize) {
        let missing = whole.saturating_sub(self.frame.len()).min(input.len());
        let (taken, rest) = input.split_at(missing);
        self.frame.extend_from_slice(taken);
        *input = rest;
    }

    fn check_header(&self) -> Result<(), FrameError> {
        let header = &self.frame;
        if header[..4] != MAGIC {
            let found = header[..4].escape_ascii();
            return Err(self.wrong("magic", format!("\"BPIP\", found \"{found}\"")));
        }
        if header[4] != VERSION {
            return Err(self.wrong("version", format!("{VERSION}, found {}", header[4])));
        }
        let Some(kind) = FrameType::from_number(header[5]) else {
            return Err(self.wrong("type", format!("1 to 9, found {}", header[5])));
        };
        let flags = u16::from_le_bytes([header[6], header[7]]);
        if flags != 0 {
            return Err(self.wrong("flags", format!("no flag, found {flags:#06x}")));
        }
        let length = self.u32_at(8) as usize;
        let least = usize::from(kind == FrameType::Data);
        if !(least..=MAX_PAYLOAD).contains(&length) {
            let expected = format!("{least} to {MAX_PAYLOAD} bytes, found {length}");
            return Err(self.wrong("length", expected));
        }
        let sequence = self.u32_at(12);
        if sequence != self.sequence {
            let expected = format!("{}, found {sequence}", self.sequence);
            return Err(self.wrong("sequence", expected));
        }
        Ok(())
    }

    fn check_whole(&mut self) -> Result<(FrameType, u32), FrameError> {
        let crc =
            crc32c::crc32c_append(crc32c::crc32c(&self.frame[..16]), &self.frame[HEADER_BYTES..]);
        let found = self.u32_at(16);
        if crc != found {
            return Err(self.wrong("crc32c", format!("{crc:#010x}, found {found:#010x}")));
        }
        let number = self.frame[5];
        let kind = FrameType::from_number(number)
            .ok_or_else(|| self.wrong("type", format!("1 to 9, found {number}")))?;
        match kind {
            FrameType::File => self.files += 1,
            FrameType::Data => self.data_bytes += (self.frame.len() - HEADER_BYTES) as u64,
            _ => {}
        }
        if kind != FrameType::End {
            self.digest = crc32c::crc32c_append(self.digest, &self.frame[16..HEADER_BYTES]);
        }
        Ok((kind, self.sequence))
    }

    fn u32_at(&self, at: usize) -> u32 {
        let mut four = [0; 4];
        four.copy_from_slice(&self.frame[at..at + 4]);
        u32::from_le_bytes(four)
    }

    fn wrong(&self, field: &'static str, expected: String) -> FrameError {
        FrameError { offset: self.offset, field, expected }
    }
}
