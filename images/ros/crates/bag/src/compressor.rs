//! Compressing chunks beside the thread that fills them.

use std::collections::VecDeque;
use std::thread::{self, JoinHandle};
use std::{io, mem};

use crate::unpack::threads;
use crate::{BagError, Compression};

/// Smaller chunks are compressed sooner than a thread starts.
const LEAST_BYTES: usize = 64 << 10;

/// A chunk on its way: compressed, or being so.
#[derive(Debug)]
enum Work {
    Done(Vec<u8>),
    Running(JoinHandle<Job>),
}

/// A chunk before and after, and whether it went well; the buffers are used again.
struct Job {
    raw: Vec<u8>,
    small: Vec<u8>,
    outcome: io::Result<()>,
}

#[derive(Debug)]
struct Flight<T> {
    work: Work,
    /// Bytes before compression.
    length: u32,
    rest: T,
}

/// A compressed chunk, in the order in which it was given.
pub(crate) struct Compressed<T> {
    pub bytes: Vec<u8>,
    pub length: u32,
    /// What was given along with it.
    pub rest: T,
}

/// A bounded queue of chunks; each comes out compressed, in order.
#[derive(Debug)]
pub(crate) struct Compressor<T> {
    compression: Compression,
    flights: VecDeque<Flight<T>>,
    most: usize,
    spare_raw: Vec<Vec<u8>>,
    spare_small: Vec<Vec<u8>>,
    /// Bytes before compression of all that is in the queue.
    bytes: u64,
}

impl<T> Compressor<T> {
    pub fn new(compression: Compression) -> Self {
        Self {
            compression,
            flights: VecDeque::new(),
            most: threads() + 1,
            spare_raw: Vec::new(),
            spare_small: Vec::new(),
            bytes: 0,
        }
    }

    /// Bytes before compression of what has not come out yet.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Takes the chunk out of `chunk`, which is empty then and may be filled again.
    pub fn push(&mut self, chunk: &mut Vec<u8>, rest: T) -> Result<(), BagError> {
        let (compression, length) = (self.compression, chunk.len() as u32);
        let mut small = self.spare_small.pop().unwrap_or_default();
        let work = if chunk.len() < LEAST_BYTES {
            compression.compress(chunk, &mut small).map_err(BagError::Compress)?;
            chunk.clear();
            Work::Done(small)
        } else {
            let raw = mem::replace(chunk, self.spare_raw.pop().unwrap_or_default());
            let job = move || {
                let outcome = compression.compress(&raw, &mut small);
                Job { raw, small, outcome }
            };
            let spawned = thread::Builder::new().name("compress".to_owned()).spawn(job);
            Work::Running(spawned.map_err(BagError::Compress)?)
        };
        self.bytes += u64::from(length);
        self.flights.push_back(Flight { work, length, rest });
        Ok(())
    }

    /// The next chunk if it is ready; waits for it when the queue is full, or `all` must come.
    pub fn pop(&mut self, all: bool) -> Result<Option<Compressed<T>>, BagError> {
        let full = self.flights.len() >= self.most;
        let ready = match self.flights.front() {
            None => return Ok(None),
            Some(Flight { work: Work::Running(job), .. }) => job.is_finished(),
            Some(_) => true,
        };
        if !(ready || full || all) {
            return Ok(None);
        }
        let Some(Flight { work, length, rest }) = self.flights.pop_front() else {
            return Ok(None);
        };
        self.bytes -= u64::from(length);
        let bytes = match work {
            Work::Done(bytes) => bytes,
            Work::Running(job) => {
                let died = |_| BagError::Compress(io::Error::other("its thread died"));
                let Job { mut raw, small, outcome } = job.join().map_err(died)?;
                raw.clear();
                self.spare_raw.push(raw);
                outcome.map_err(BagError::Compress)?;
                small
            }
        };
        Ok(Some(Compressed { bytes, length, rest }))
    }

    /// Takes back the bytes of a chunk that came out, to be used again.
    pub fn give_back(&mut self, bytes: Vec<u8>) {
        self.spare_small.push(bytes);
    }
}
