//! Both directions of a session, moved with `poll`.

use std::collections::VecDeque;
use std::io::IoSlice;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::io::Errno;

use crate::frame::{FrameError, FrameType, OwnedFrame};
use crate::leftovers::{Found, find_hello};
use crate::{Decoder, Encoder, Leftovers};

/// How often cancellation is looked at while nothing moves.
pub(crate) const GLANCE: Duration = Duration::from_millis(50);
/// Frames that wait to be looked at while we write; then reading pauses.
const INBOX_FRAMES: usize = 4;
/// Bytes taken from the pipe at once: its usual size.
const READ_BYTES: usize = 256 * 1024;
/// A write of at most so many bytes to a pipe goes through as a whole or not at all.
const ATOMIC_BYTES: usize = 4096;

/// Why a session cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum PipeError {
    /// The stream holds something that is no frame, or no frame that may come now.
    #[error("{0}")]
    Frame(#[from] FrameError),
    /// The peer closed its end without a word.
    #[error("the peer closed the pipe after {0} frames, without END or ABORT")]
    PeerGone(u64),
    /// The peer sent nothing, or took nothing, for too long.
    #[error("the peer did not {0} in time")]
    Deadline(&'static str),
    /// The caller wants no more.
    #[error("the session was cancelled")]
    Cancelled,
    /// The system refused.
    #[error("the pipe failed: {0}")]
    Io(#[from] Errno),
    /// A payload that no frame can carry.
    #[error("a {0} payload of {1} bytes does not fit into a frame")]
    Payload(&'static str, usize),
}

/// A session's two pipes and the state of their streams.
#[derive(Debug)]
pub struct Duplex {
    input: OwnedFd,
    output: Option<OwnedFd>,
    decoder: Decoder,
    encoder: Encoder,
    /// Bytes read and not yet decoded.
    bytes: Vec<u8>,
    taken: usize,
    inbox: VecDeque<OwnedFrame>,
    received: u64,
    ended: bool,
    /// END or ABORT was received.
    complete: bool,
    /// Where bytes of DATA are counted as they come.
    count: Option<Arc<AtomicU64>>,
}

impl Duplex {
    /// A session that can receive; both ends must be non-blocking.
    pub fn new(input: OwnedFd) -> Self {
        Self {
            input,
            output: None,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            bytes: Vec::new(),
            taken: 0,
            inbox: VecDeque::new(),
            received: 0,
            ended: false,
            complete: false,
            count: None,
        }
    }

    /// Adds the bytes of each DATA that is received to `count`, for whoever looks on.
    pub fn count_data(&mut self, count: Arc<AtomicU64>) {
        self.count = Some(count);
    }

    /// The pipe that is read, to wait for its first bytes.
    pub fn input(&self) -> &OwnedFd {
        &self.input
    }

    /// Adds the way back.
    pub fn set_output(&mut self, output: OwnedFd) {
        self.output = Some(output);
    }

    /// True when there is a way back.
    pub fn has_output(&self) -> bool {
        self.output.is_some()
    }

    /// Closes the way back: the peer reads the end.
    pub fn close_output(&mut self) {
        self.output = None;
    }

    /// What was received, for END's totals.
    pub fn decoder(&self) -> &Decoder {
        &self.decoder
    }

    /// What was sent, for END's totals.
    pub fn encoder(&self) -> &Encoder {
        &self.encoder
    }

    /// Waits for the next frame.
    pub fn receive(
        &mut self,
        deadline: Instant,
        stop: &dyn Fn() -> bool,
    ) -> Result<OwnedFrame, PipeError> {
        loop {
            if let Some(frame) = self.glance()? {
                return Ok(frame);
            }
            check(deadline, stop, "send")?;
            let idle = !self.wait(PollFlags::IN, PollFlags::empty(), deadline)?;
            if idle && matches!(find_hello(self.decoder.unfinished()), Found::Whole(1..)) {
                // The writer died inside a frame, and its successor waits for an answer.
                return Err(PipeError::PeerGone(self.received));
            }
        }
    }

    /// The next frame if it is there already; an error when the peer is gone.
    pub fn glance(&mut self) -> Result<Option<OwnedFrame>, PipeError> {
        if let Some(frame) = self.inbox.pop_front() {
            return Ok(Some(frame));
        }
        match self.read_frame()? {
            Some(frame) => Ok(Some(frame)),
            None if self.ended => Err(PipeError::PeerGone(self.received)),
            None if self.output_is_dead()? => Err(PipeError::PeerGone(self.received)),
            None => Ok(None),
        }
    }

    /// Sends a frame; what arrives meanwhile is kept for [`Duplex::receive`].
    pub fn send(
        &mut self,
        kind: FrameType,
        payload: &[u8],
        deadline: Instant,
        stop: &dyn Fn() -> bool,
    ) -> Result<(), PipeError> {
        let header = self
            .encoder
            .header(kind, payload)
            .ok_or(PipeError::Payload(kind.name(), payload.len()))?;
        let mut sent = 0;
        while sent < header.len() + payload.len() {
            sent += self.write(&header, payload, sent)?;
            if sent == header.len() + payload.len() {
                break;
            }
            check(deadline, stop, "read")?;
            if self.inbox.len() < INBOX_FRAMES
                && !self.ended
                && let Some(frame) = self.read_frame()?
            {
                self.inbox.push_back(frame);
                continue;
            }
            let listening = !self.ended && self.inbox.len() < INBOX_FRAMES;
            let input = if listening { PollFlags::IN } else { PollFlags::empty() };
            self.wait(input, PollFlags::OUT, deadline)?;
        }
        Ok(())
    }

    /// Sends a small frame if the pipe takes it now; `false` when it was left out.
    pub fn offer(&mut self, kind: FrameType, payload: &[u8]) -> Result<bool, PipeError> {
        let mut encoder = self.encoder.clone();
        let header =
            encoder.header(kind, payload).ok_or(PipeError::Payload(kind.name(), payload.len()))?;
        if header.len() + payload.len() > ATOMIC_BYTES {
            return Err(PipeError::Payload(kind.name(), payload.len()));
        }
        if self.write(&header, payload, 0)? == 0 {
            return Ok(false);
        }
        self.encoder = encoder;
        Ok(true)
    }

    /// True when behind the frames so far a new session begins: this one's worker is dead,
    /// and a successor was quicker than the news.
    pub fn is_superseded(&mut self) -> Result<bool, PipeError> {
        if self.taken == self.bytes.len() && !self.ended {
            self.fill()?;
        }
        Ok(matches!(find_hello(&self.bytes[self.taken..]), Found::Whole(_)))
    }

    /// Goes on receiving where `other` is; what was received before is forgotten.
    pub fn adopt_input(&mut self, other: Self) {
        let output = self.output.take();
        let encoder = std::mem::take(&mut self.encoder);
        *self = Self { output, encoder, ..other };
    }

    /// The rest of the session, when it is over; the way back is closed.
    pub fn into_leftovers(self) -> Leftovers {
        let mut bytes = self.decoder.unfinished().to_vec();
        bytes.extend_from_slice(&self.bytes[self.taken..]);
        Leftovers { input: self.input, bytes, complete: self.complete, ended: self.ended }
    }

    /// A session whose first bytes were read already.
    pub(crate) fn resume(input: OwnedFd, bytes: Vec<u8>) -> Self {
        Self { bytes, ..Self::new(input) }
    }

    /// Decodes one frame from what is there.
    fn read_frame(&mut self) -> Result<Option<OwnedFrame>, PipeError> {
        loop {
            let mut rest = &self.bytes[self.taken..];
            let frame = self.decoder.next_frame(&mut rest)?.map(crate::Frame::to_owned);
            self.taken = self.bytes.len() - rest.len();
            if let Some(frame) = frame {
                self.received += 1;
                self.complete |= matches!(frame.kind, FrameType::End | FrameType::Abort);
                if let (FrameType::Data, Some(count)) = (frame.kind, &self.count) {
                    count.fetch_add(frame.payload.len() as u64, Ordering::Relaxed);
                }
                return Ok(Some(frame));
            }
            if self.ended || !self.fill()? {
                return Ok(None);
            }
        }
    }

    /// Reads once; `false` when nothing is there. At the end, a frame must not be open.
    fn fill(&mut self) -> Result<bool, PipeError> {
        self.taken = 0;
        self.bytes.resize(READ_BYTES, 0);
        let outcome = rustix::io::read(&self.input, &mut self.bytes[..]);
        let length = *outcome.as_ref().unwrap_or(&0);
        self.bytes.truncate(length);
        match outcome {
            Ok(0) => {
                self.ended = true;
                self.decoder.finish()?;
                Ok(false)
            }
            Ok(_) => Ok(true),
            Err(Errno::AGAIN | Errno::INTR) => Ok(false),
            Err(error) => Err(error.into()),
        }
    }

    /// Writes what is left of a frame once; 0 when the pipe is full.
    fn write(&self, header: &[u8], payload: &[u8], sent: usize) -> Result<usize, PipeError> {
        let Some(output) = &self.output else { return Err(PipeError::PeerGone(self.received)) };
        let outcome = match header.get(sent..) {
            Some(rest) => rustix::io::writev(output, &[IoSlice::new(rest), IoSlice::new(payload)]),
            None => rustix::io::write(output, &payload[sent - header.len()..]),
        };
        match outcome {
            Ok(length) => Ok(length),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(Errno::PIPE) => Err(PipeError::PeerGone(self.received)),
            Err(error) => Err(error.into()),
        }
    }

    /// Returns false when nothing happened for a while.
    fn wait(&self, input: PollFlags, output: PollFlags, deadline: Instant) -> Result<bool, Errno> {
        let left = deadline.saturating_duration_since(Instant::now()).min(GLANCE);
        let timeout = Timespec { tv_sec: 0, tv_nsec: i64::from(left.subsec_nanos()) };
        let mut both = Vec::with_capacity(2);
        if !self.ended {
            both.push(PollFd::new(&self.input, input));
        }
        if let Some(pipe) = &self.output {
            both.push(PollFd::new(pipe, output));
        }
        match poll(&mut both, Some(&timeout)) {
            Ok(ready) => Ok(ready > 0),
            Err(Errno::INTR) => Ok(true),
            Err(error) => Err(error),
        }
    }

    /// True when nobody reads what we write, whatever there still is to read.
    pub fn is_peer_deaf(&self) -> Result<bool, PipeError> {
        Ok(self.output_is_dead()?)
    }

    /// `poll` reports an error on our end.
    fn output_is_dead(&self) -> Result<bool, Errno> {
        let Some(output) = &self.output else { return Ok(false) };
        let mut one = [PollFd::new(output, PollFlags::empty())];
        match poll(&mut one, Some(&Timespec { tv_sec: 0, tv_nsec: 0 })) {
            Ok(_) => Ok(one[0].revents().contains(PollFlags::ERR)),
            Err(Errno::INTR) => Ok(false),
            Err(error) => Err(error),
        }
    }
}

fn check(deadline: Instant, stop: &dyn Fn() -> bool, what: &'static str) -> Result<(), PipeError> {
    if stop() {
        return Err(PipeError::Cancelled);
    }
    if Instant::now() >= deadline {
        return Err(PipeError::Deadline(what));
    }
    Ok(())
}
