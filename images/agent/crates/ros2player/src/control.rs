//! Requests and answers over the socket (the other end is `player/answer.h`): frames of a length,
//! a sequence number, a verb or a status, and what belongs to it; numbers are little-endian.

use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::{Duration, Instant};

use crate::PlayerError;
use crate::program::{Program, lock};

/// The most that an answer has, in bytes: a graph of some hundred thousand topics.
const ANSWER_MOST: usize = 1 << 24;
/// The most that a request has: what the program reads.
const REQUEST_MOST: usize = 1 << 20;
const CHUNK: usize = 1 << 16;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Verb {
    Start,
    Advertise,
    Subscribe,
    Subscribers,
    Publishers,
    Graph,
    Refusal,
    Listen,
    State,
    Topics,
    Topic,
}

/// A request, written up.
pub(crate) struct Request(Vec<u8>);

impl Request {
    pub(crate) fn new(verb: Verb) -> Request {
        Request(vec![0; 8]).number(verb as u32)
    }

    pub(crate) fn number(mut self, number: u32) -> Request {
        self.0.extend(number.to_le_bytes());
        self
    }

    /// A text, which ends where it has a zero.
    pub(crate) fn text(self, text: &str) -> Request {
        let text = text.split('\0').next().unwrap_or_default();
        let mut with = self.number(text.len() as u32 + 1);
        with.0.extend(text.as_bytes());
        with.0.push(0);
        with
    }

    fn framed(&self, sequence: u32) -> Result<Vec<u8>, PlayerError> {
        let length = self.0.len() - 4;
        if length > REQUEST_MOST {
            return Err(PlayerError::Answer(format!("a request of {length} bytes is too long")));
        }
        let mut frame = self.0.clone();
        frame[..4].copy_from_slice(&(length as u32).to_le_bytes());
        frame[4..8].copy_from_slice(&sequence.to_le_bytes());
        Ok(frame)
    }
}

/// An answer, to be read from its beginning.
#[derive(Debug)]
pub(crate) struct Answer {
    bytes: Vec<u8>,
    at: usize,
}

impl Answer {
    fn take(&mut self, length: usize) -> Result<&[u8], PlayerError> {
        let from = self.at;
        let bytes = self.bytes.get(from..).and_then(|rest| rest.get(..length));
        self.at += length.min(self.bytes.len() - from);
        bytes.ok_or_else(|| PlayerError::Answer(format!("it ends before byte {}", from + length)))
    }

    pub(crate) fn number(&mut self) -> Result<u32, PlayerError> {
        let bytes = self.take(4)?;
        Ok(bytes.iter().rev().fold(0, |number, byte| number << 8 | u32::from(*byte)))
    }

    pub(crate) fn long(&mut self) -> Result<u64, PlayerError> {
        let low = self.number()?;
        Ok(u64::from(self.number()?) << 32 | u64::from(low))
    }

    pub(crate) fn text(&mut self) -> Result<String, PlayerError> {
        let length = self.number()? as usize;
        Ok(String::from_utf8_lossy(self.take(length)?).into_owned())
    }

    pub(crate) fn gid(&mut self) -> Result<Option<[u8; 16]>, PlayerError> {
        let known = self.number()? != 0;
        let gid = u128::from(self.long()?) | u128::from(self.long()?) << 64;
        Ok(known.then(|| gid.to_le_bytes()))
    }
}

/// The socket, which one call has at a time.
pub(crate) struct Control {
    line: Mutex<Line>,
    freed: Condvar,
    limit: Duration,
}

enum Line {
    Free(Open),
    Taken,
    /// A request was sent in part: no other can follow it.
    Broken,
}

struct Open {
    socket: UnixStream,
    /// Received, and not yet a whole answer.
    received: Vec<u8>,
    sequence: u32,
}

impl Control {
    /// A socket whose calls take `limit` at the most.
    pub(crate) fn new(socket: UnixStream, limit: Duration) -> Control {
        let open = Open { socket, received: Vec::new(), sequence: 0 };
        Control { line: Mutex::new(Line::Free(open)), freed: Condvar::new(), limit }
    }

    /// Sends a request, and returns the answer to it. `what` says what it is for, in an error.
    pub(crate) fn call(
        &self,
        what: &str,
        program: &Program,
        request: &Request,
    ) -> Result<Answer, PlayerError> {
        let until = Instant::now() + self.limit;
        let late = || PlayerError::Late { what: what.to_owned(), limit: self.limit };
        if program.has_ended() {
            return Err(ended(program));
        }
        let mut open = self.take(until).ok_or_else(late)?;
        let answer = open.exchange(request, until, program, &late);
        *lock(&self.line) = match open.is_broken(&answer) {
            true => Line::Broken,
            false => Line::Free(open),
        };
        self.freed.notify_all();
        answer
    }

    /// The socket, once nobody else has it; `None` when it is too late.
    fn take(&self, until: Instant) -> Option<Open> {
        let limit = until.saturating_duration_since(Instant::now());
        let taken = |line: &mut Line| matches!(line, Line::Taken);
        let waited = self.freed.wait_timeout_while(lock(&self.line), limit, taken);
        let mut line = waited.unwrap_or_else(PoisonError::into_inner).0;
        match std::mem::replace(&mut *line, Line::Taken) {
            Line::Free(open) => Some(open),
            other => {
                *line = other;
                None
            }
        }
    }
}

impl Open {
    fn is_broken(&self, answer: &Result<Answer, PlayerError>) -> bool {
        self.sequence == u32::MAX || matches!(answer, Err(PlayerError::Memory(_)))
    }

    fn exchange(
        &mut self,
        request: &Request,
        until: Instant,
        program: &Program,
        late: &dyn Fn() -> PlayerError,
    ) -> Result<Answer, PlayerError> {
        self.sequence += 1;
        let sequence = self.sequence;
        let frame = request.framed(sequence)?;
        self.socket.set_write_timeout(left(until))?;
        match self.socket.write_all(&frame) {
            Ok(()) => {}
            Err(error) if error.kind() == ErrorKind::BrokenPipe => return Err(ended(program)),
            Err(error) => return Err(error.into()),
        }
        loop {
            while let Some((number, answer)) = self.whole()? {
                // One that came too late for its own call is passed over.
                if number == sequence {
                    return Ok(answer);
                }
            }
            if Instant::now() >= until {
                return Err(late());
            }
            self.socket.set_read_timeout(left(until))?;
            let mut chunk = vec![0; CHUNK];
            match self.socket.read(&mut chunk) {
                Ok(0) => return Err(ended(program)),
                Ok(some) => self.received.extend_from_slice(&chunk[..some]),
                Err(error) => match error.kind() {
                    ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted => {}
                    ErrorKind::ConnectionReset => return Err(ended(program)),
                    _ => return Err(error.into()),
                },
            }
        }
    }

    /// The next whole answer of what was received, with its sequence number.
    fn whole(&mut self) -> Result<Option<(u32, Answer)>, PlayerError> {
        let Some(head) = self.received.first_chunk::<4>() else { return Ok(None) };
        let length = u32::from_le_bytes(*head) as usize;
        if !(8..=ANSWER_MOST).contains(&length) {
            self.sequence = u32::MAX;
            return Err(PlayerError::Answer(format!("it has {length} bytes")));
        }
        if self.received.len() < 4 + length {
            return Ok(None);
        }
        let rest = self.received.split_off(4 + length);
        let bytes = std::mem::replace(&mut self.received, rest);
        let mut answer = Answer { bytes, at: 4 };
        let sequence = answer.number()?;
        Ok(Some((sequence, answer)))
    }
}

/// What is left until then, as a socket takes it: not 0, which would be for ever.
fn left(until: Instant) -> Option<Duration> {
    Some(until.saturating_duration_since(Instant::now()).max(Duration::from_millis(1)))
}

/// That the program has ended, or is about to.
pub(crate) fn ended(program: &Program) -> PlayerError {
    program.end().unwrap_or_else(|| PlayerError::Answer("it closed its socket and runs on".into()))
}
