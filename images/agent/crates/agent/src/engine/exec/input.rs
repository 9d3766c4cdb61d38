//! The program's stdin: a stream of frames of its own, written as the pipe takes it.

use std::io::IoSlice;
use std::os::fd::OwnedFd;

use bagpipe_wire::{Encoder, End, FrameType, HEADER_BYTES};
use rustix::io::Errno;

use crate::case::failure::Failure;

/// One frame at a time; the next one is taken when it is written.
#[derive(Debug)]
pub struct ProgramInput {
    /// None once the program has all, or wants no more.
    pipe: Option<OwnedFd>,
    encoder: Encoder,
    header: [u8; HEADER_BYTES],
    payload: Vec<u8>,
    /// Bytes of the frame that are left to write.
    left: usize,
    last: bool,
}

impl ProgramInput {
    /// `pipe` must be non-blocking.
    pub fn new(pipe: OwnedFd) -> Self {
        Self {
            pipe: Some(pipe),
            encoder: Encoder::new(),
            header: [0; HEADER_BYTES],
            payload: Vec::new(),
            left: 0,
            last: false,
        }
    }

    /// True when the next frame may be put.
    pub fn is_idle(&self) -> bool {
        self.left == 0
    }

    /// The pipe, while there is something to write to it.
    pub fn waiting(&self) -> Option<&OwnedFd> {
        self.pipe.as_ref().filter(|_| !self.is_idle())
    }

    /// What was given to the program so far.
    pub fn given(&self) -> End {
        self.encoder.end()
    }

    /// Takes a frame; one that nobody will read is dropped.
    pub fn put(&mut self, kind: FrameType, payload: Vec<u8>) -> Result<(), Failure> {
        if self.pipe.is_none() {
            return Ok(());
        }
        let header = self.encoder.header(kind, &payload).ok_or_else(|| {
            let (kind, length) = (kind.name(), payload.len());
            Failure::protocol(format!("a {kind} payload of {length} bytes fits into no frame"))
        })?;
        self.header = header;
        self.left = HEADER_BYTES + payload.len();
        self.payload = payload;
        self.last = kind == FrameType::End;
        Ok(())
    }

    /// Writes once; `false` when nothing moved.
    pub fn write(&mut self) -> Result<bool, Failure> {
        let Some(pipe) = self.waiting() else { return Ok(false) };
        let sent = HEADER_BYTES + self.payload.len() - self.left;
        let outcome = match self.header.get(sent..) {
            Some(rest) => {
                rustix::io::writev(pipe, &[IoSlice::new(rest), IoSlice::new(&self.payload)])
            }
            None => rustix::io::write(pipe, &self.payload[sent - HEADER_BYTES..]),
        };
        match outcome {
            Ok(length) => {
                self.left -= length;
                if self.left == 0 && self.last {
                    self.pipe = None;
                }
                Ok(length > 0)
            }
            Err(Errno::AGAIN | Errno::INTR) => Ok(false),
            Err(Errno::PIPE) => {
                // A program may know enough before it has read all.
                self.pipe = None;
                self.left = 0;
                Ok(true)
            }
            Err(error) => Err(Failure::new("Internal", format!("the program's stdin: {error}"))),
        }
    }
}
