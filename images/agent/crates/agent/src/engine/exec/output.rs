//! The program's stdout: frames, or a sentence about what is none.

use std::os::fd::OwnedFd;

use bagpipe_wire::{Decoder, Frame, FrameError, FrameType, OwnedFrame};
use rustix::io::Errno;

use crate::case::failure::Failure;

/// Bytes taken from the pipe at once: its usual size.
const READ_BYTES: usize = 256 * 1024;
/// How much is shown of what is no frame.
const SHOWN_BYTES: usize = 80;
/// Every frame begins so.
const MAGIC: &[u8] = b"BPIP";
/// What the program itself did wrong; unlike `ProtocolError` no other attempt will mend it.
pub const REASON: &str = "StackProtocolError";

/// Decodes what the program writes.
#[derive(Debug)]
pub struct ProgramOutput {
    pipe: OwnedFd,
    decoder: Decoder,
    bytes: Vec<u8>,
    taken: usize,
    ended: bool,
}

impl ProgramOutput {
    /// `pipe` must be non-blocking.
    pub fn new(pipe: OwnedFd) -> Self {
        Self { pipe, decoder: Decoder::new(), bytes: Vec::new(), taken: 0, ended: false }
    }

    /// The pipe, while it may bring more.
    pub fn waiting(&self) -> Option<&OwnedFd> {
        (!self.ended).then_some(&self.pipe)
    }

    /// What came so far, to compare with END.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// The next frame, if it is there.
    pub fn next_frame(&mut self) -> Result<Option<OwnedFrame>, Failure> {
        loop {
            let mut rest = &self.bytes[self.taken..];
            let outcome =
                self.decoder.next_frame(&mut rest).map(|frame| frame.map(Frame::to_owned));
            self.taken = self.bytes.len() - rest.len();
            match outcome {
                Ok(Some(frame)) => return Ok(Some(frame)),
                Ok(None) => self.check_beginning()?,
                Err(error) => return Err(self.no_frame(&error)),
            }
            if self.ended || !self.fill()? {
                return Ok(None);
            }
        }
    }

    /// Reads once; `false` when nothing is there.
    fn fill(&mut self) -> Result<bool, Failure> {
        self.taken = 0;
        self.bytes.resize(READ_BYTES, 0);
        let outcome = rustix::io::read(&self.pipe, &mut self.bytes[..]);
        self.bytes.truncate(*outcome.as_ref().unwrap_or(&0));
        match outcome {
            Ok(0) => {
                self.ended = true;
                self.decoder.finish().map_err(|error| self.no_frame(&error))?;
                Ok(false)
            }
            Ok(_) => Ok(true),
            Err(Errno::AGAIN | Errno::INTR) => Ok(false),
            Err(error) => Err(Failure::new("Internal", format!("the program's stdout: {error}"))),
        }
    }

    /// A printed line is often shorter than a header, and the program may go on for long.
    fn check_beginning(&self) -> Result<(), Failure> {
        let begun = self.decoder.unfinished();
        let known = begun.len().min(MAGIC.len());
        if begun[..known] == MAGIC[..known] {
            return Ok(());
        }
        let offset = self.decoder.offset();
        let expected = String::new();
        Err(self.no_frame(&FrameError { offset, field: "magic", expected }))
    }

    fn no_frame(&self, error: &FrameError) -> Failure {
        let begun = self.decoder.unfinished();
        if begun.starts_with(MAGIC) {
            return Failure::new(REASON, format!("the program's stdout is damaged: {error}"));
        }
        let bytes = [begun, &self.bytes[self.taken..]].concat();
        let shown = String::from_utf8_lossy(&bytes[..bytes.len().min(SHOWN_BYTES)]).into_owned();
        Failure::new(
            REASON,
            format!(
                "at byte {} the program's stdout holds no frame but {shown:?}: stdout is for \
                 frames alone, so print to stderr",
                error.offset
            ),
        )
    }
}

/// The name of a frame that may not come now, in a sentence.
pub fn unexpected(kind: FrameType, when: &str) -> Failure {
    Failure::new(REASON, format!("the program sent {} {when}", kind.name()))
}
