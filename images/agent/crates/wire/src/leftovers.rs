//! What lies in a pipe after a session that broke off, and the session behind it.
//!
//! A worker that dies inside a frame leaves bytes without meaning. Its successor may open
//! the pipe and write HELLO before the agent has seen the end, and then there is no end to
//! see. So the rest of a broken session is not just thrown away: a whole HELLO with the
//! sequence 0 and a right checksum is where the next session begins.

use std::os::fd::OwnedFd;
use std::time::Instant;

use rustix::io::Errno;

use crate::frame::{FrameType, HEADER_BYTES, MAGIC, MAX_PAYLOAD, VERSION};
use crate::{Duplex, fifo};

/// Bytes taken from the pipe at once.
const READ_BYTES: usize = 256 * 1024;

/// The rest of a session.
#[derive(Debug)]
pub struct Leftovers {
    pub(crate) input: OwnedFd,
    pub(crate) bytes: Vec<u8>,
    /// The writer's stream came to its own end: what follows belongs to its successor.
    pub(crate) complete: bool,
    pub(crate) ended: bool,
}

/// What became of the rest of a session.
#[derive(Debug)]
pub enum Next {
    /// A successor's HELLO was found: its session, HELLO not yet received.
    Session(Duplex),
    /// Nobody writes any more, or nothing more is to be thrown away. The pipe must be opened
    /// again before this end is closed, so that a writer who is there never misses a reader.
    Reopen(OwnedFd),
}

impl Leftovers {
    /// A pipe in which there may be a dead session's bytes. Wait for its first bytes before
    /// [`Leftovers::skip`]: without a writer, a pipe looks like one at its end.
    pub fn new(input: OwnedFd) -> Self {
        Self { input, bytes: Vec::new(), complete: false, ended: false }
    }

    /// Reads and forgets until there is a successor, or the end, or the deadline.
    pub fn skip(mut self, deadline: Instant, stop: &dyn Fn() -> bool) -> Result<Next, Errno> {
        loop {
            match find_hello(&self.bytes) {
                Found::Whole(at) => return self.begin(at),
                Found::Perhaps(at) => drop(self.bytes.drain(..at)),
                Found::Nothing => self.bytes.clear(),
            }
            let nothing_to_skip = self.complete && self.bytes.is_empty();
            if self.ended || nothing_to_skip || stop() || Instant::now() >= deadline {
                return Ok(Next::Reopen(self.input));
            }
            self.read(deadline)?;
        }
    }

    /// Begins the last session that is there: only one worker has the lease, so an earlier
    /// one gave up already.
    fn begin(mut self, at: usize) -> Result<Next, Errno> {
        self.bytes.drain(..at);
        // Once, without waiting: the deadline has passed.
        self.read(Instant::now())?;
        while let Found::Whole(later) = find_hello(&self.bytes[1..]) {
            self.bytes.drain(..=later);
        }
        Ok(Next::Session(Duplex::resume(self.input, self.bytes)))
    }

    fn read(&mut self, deadline: Instant) -> Result<(), Errno> {
        let before = self.bytes.len();
        self.bytes.resize(before + READ_BYTES, 0);
        let outcome = rustix::io::read(&self.input, &mut self.bytes[before..]);
        self.bytes.truncate(before + *outcome.as_ref().unwrap_or(&0));
        match outcome {
            Ok(0) => self.ended = true,
            Ok(_) | Err(Errno::INTR) => {}
            Err(Errno::AGAIN) => {
                let left = deadline.saturating_duration_since(Instant::now());
                fifo::await_bytes(&self.input, left.min(crate::duplex::GLANCE))
                    .map_err(|error| Errno::from_io_error(&error).unwrap_or(Errno::IO))?;
            }
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

/// Where in some bytes a session begins.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Found {
    /// A whole HELLO begins there.
    Whole(usize),
    /// What begins there may become one.
    Perhaps(usize),
    /// None of the bytes is of use.
    Nothing,
}

/// Looks for HELLO with the sequence 0.
pub(crate) fn find_hello(bytes: &[u8]) -> Found {
    const START: [u8; 8] =
        [MAGIC[0], MAGIC[1], MAGIC[2], MAGIC[3], VERSION, FrameType::Hello as u8, 0, 0];
    let mut perhaps = None;
    for at in 0..bytes.len() {
        let rest = &bytes[at..];
        let shared = rest.len().min(START.len());
        if rest[..shared] != START[..shared] {
            continue;
        }
        match is_hello(rest) {
            Some(true) => return Found::Whole(at),
            Some(false) => {}
            None => perhaps = perhaps.or(Some(at)),
        }
    }
    perhaps.map_or(Found::Nothing, Found::Perhaps)
}

/// Whether these bytes begin with a whole and right HELLO; `None` when it takes more bytes
/// to know.
fn is_hello(bytes: &[u8]) -> Option<bool> {
    let field = |at: usize| {
        let four = bytes.get(at..at + 4)?;
        Some(u32::from_le_bytes(four.try_into().ok()?))
    };
    let (length, sequence, crc) = (field(8)? as usize, field(12)?, field(16)?);
    if sequence != 0 || length > MAX_PAYLOAD {
        return Some(false);
    }
    let payload = bytes.get(HEADER_BYTES..HEADER_BYTES + length)?;
    Some(crc == crc32c::crc32c_append(crc32c::crc32c(&bytes[..16]), payload))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Encoder;

    fn hello() -> Vec<u8> {
        let payload = b"\x80hello";
        [&Encoder::new().header(FrameType::Hello, payload).unwrap()[..], payload].concat()
    }

    #[test]
    fn a_hello_is_found_behind_anything() {
        let before = b"the rest of a frame, BPIP\x01\x01\0\0 and even that";
        let bytes = [&before[..], &hello(), b"more"].concat();
        assert_eq!(find_hello(&bytes), Found::Whole(before.len()));
        for cut in 1..hello().len() {
            let bytes = [&b"rest"[..], &hello()[..cut]].concat();
            assert_eq!(find_hello(&bytes), Found::Perhaps(4), "{cut}");
        }
    }

    #[test]
    fn nothing_else_is_a_session() {
        assert_eq!(find_hello(b"no frame at all"), Found::Nothing);
        let mut wrong = hello();
        wrong[17] ^= 1;
        assert_eq!(find_hello(&wrong), Found::Nothing);
        let mut encoder = Encoder::new();
        encoder.header(FrameType::Hello, b"").unwrap();
        let second = encoder.header(FrameType::Hello, b"").unwrap();
        assert_eq!(find_hello(&second), Found::Nothing);
    }
}
