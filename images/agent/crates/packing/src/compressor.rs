//! Compressing chunks beside the thread that fills them.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, Sender, SyncSender, TryRecvError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};
use std::{io, mem, thread};

use crate::threads;

/// How a chunk is compressed.
pub trait Packing: Copy + Send + 'static {
    /// Compresses a whole chunk into `out`, in place of what it holds, and returns how many
    /// of its bytes the chunk takes: what lies behind them is left, not to be cleared again.
    ///
    /// # Errors
    /// The compressor's own.
    fn compress(self, data: &[u8], out: &mut Vec<u8>) -> io::Result<usize>;
}

/// Smaller chunks are compressed sooner than another thread takes them over.
const LEAST_BYTES: usize = 64 << 10;
/// So many chunks more than processors may be under way, so that a thread that has finished one
/// finds the next while the caller fills another.
const EXTRA: usize = 1;

/// A chunk to be compressed; the buffers are used again.
#[derive(Debug)]
struct Task<P> {
    packing: P,
    raw: Vec<u8>,
    small: Vec<u8>,
    done: SyncSender<Job>,
}

/// A chunk before and after; `used` are the bytes of `small` that it takes now.
#[derive(Debug)]
struct Job {
    raw: Vec<u8>,
    small: Vec<u8>,
    used: io::Result<usize>,
}

impl<P: Packing> Task<P> {
    fn run(self) {
        let Self { packing, raw, mut small, done } = self;
        let used = packing.compress(&raw, &mut small);
        // Who no longer waits for it has dropped the whole recording.
        let _ = done.send(Job { raw, small, used });
    }
}

#[derive(Debug)]
struct Flight<T> {
    job: Receiver<Job>,
    /// Bytes before compression.
    length: u32,
    rest: T,
}

/// A compressed chunk, in the order in which it was given.
#[derive(Debug)]
pub struct Compressed<T> {
    /// Its bytes are the first `used` ones.
    pub buffer: Vec<u8>,
    /// How many they are.
    pub used: usize,
    /// Bytes before compression.
    pub length: u32,
    /// What was given along with it.
    pub rest: T,
}

/// A bounded queue of chunks; each comes out compressed, in order. As many threads as there
/// are processors work at it: the caller is one of them, once the queue is full.
#[derive(Debug)]
pub struct Compressor<P, T> {
    packing: P,
    flights: VecDeque<Flight<T>>,
    tasks: Sender<Task<P>>,
    waiting: Arc<Mutex<Receiver<Task<P>>>>,
    /// How many threads have been asked for.
    workers: usize,
    spare_raw: Vec<Vec<u8>>,
    spare_small: Vec<Vec<u8>>,
    /// Bytes before compression of all that is in the queue.
    bytes: u64,
}

impl<P: Packing, T> Compressor<P, T> {
    /// An empty queue.
    pub fn new(packing: P) -> Self {
        let (tasks, waiting) = channel();
        Self {
            packing,
            flights: VecDeque::new(),
            tasks,
            waiting: Arc::new(Mutex::new(waiting)),
            workers: 0,
            spare_raw: Vec::new(),
            spare_small: Vec::new(),
            bytes: 0,
        }
    }

    /// Bytes before compression of what has not come out yet.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// How many chunks have not come out yet.
    pub fn len(&self) -> usize {
        self.flights.len()
    }

    /// True when all came out.
    pub fn is_empty(&self) -> bool {
        self.flights.is_empty()
    }

    /// Takes the chunk out of `chunk`, which is empty then and may be filled again.
    ///
    /// # Errors
    /// As [`Compressor::pop`].
    pub fn push(&mut self, chunk: &mut Vec<u8>, rest: T) -> io::Result<()> {
        let length = chunk.len() as u32;
        let raw = mem::replace(chunk, self.spare_raw.pop().unwrap_or_default());
        let small = self.spare_small.pop().unwrap_or_default();
        let (done, job) = sync_channel(1);
        let task = Task { packing: self.packing, raw, small, done };
        if length < LEAST_BYTES as u32 {
            task.run();
        } else {
            self.start_worker();
            let gone = |_| io::Error::other("its queue is gone");
            self.tasks.send(task).map_err(gone)?;
        }
        self.bytes += u64::from(length);
        self.flights.push_back(Flight { job, length, rest });
        Ok(())
    }

    /// Starts one more thread, up to as many as there are other processors.
    fn start_worker(&mut self) {
        if self.workers >= threads().saturating_sub(1).max(1) {
            return;
        }
        self.workers += 1;
        let waiting = Arc::clone(&self.waiting);
        let work = move || {
            loop {
                // The lock is given back before the work begins, and the end of the recording ends
                // the wait.
                let task = waiting.lock().unwrap_or_else(PoisonError::into_inner).recv();
                match task {
                    Ok(task) => task.run(),
                    Err(_) => return,
                }
            }
        };
        // A thread that can't start leaves its part to the others, and to the caller.
        let _ = thread::Builder::new().name("compress".to_owned()).spawn(work);
    }

    /// Compresses a chunk that no thread has taken yet; false when there is none.
    fn help(&self) -> bool {
        let task = match self.waiting.try_lock() {
            Ok(waiting) => waiting.try_recv().ok(),
            Err(TryLockError::Poisoned(waiting)) => waiting.into_inner().try_recv().ok(),
            // A thread waits there for a chunk: there is none, or that thread takes it.
            Err(TryLockError::WouldBlock) => None,
        };
        task.map(Task::run).is_some()
    }

    /// The next chunk if it is ready; waits for it when the queue is full, or `all` must come.
    ///
    /// # Errors
    /// The compressor's own, or its thread ended.
    pub fn pop(&mut self, all: bool) -> io::Result<Option<Compressed<T>>> {
        let must = all || self.flights.len() > threads() + EXTRA;
        let died = || io::Error::other("its thread died");
        let job = loop {
            let Some(first) = self.flights.front() else { return Ok(None) };
            match first.job.try_recv() {
                Ok(job) => break job,
                Err(TryRecvError::Disconnected) => return Err(died()),
                Err(TryRecvError::Empty) if !must => return Ok(None),
                Err(TryRecvError::Empty) => {}
            }
            if !self.help() {
                break first.job.recv().map_err(|_| died())?;
            }
        };
        let Some(Flight { length, rest, .. }) = self.flights.pop_front() else {
            return Ok(None);
        };
        self.bytes -= u64::from(length);
        let Job { mut raw, small: buffer, used } = job;
        raw.clear();
        self.spare_raw.push(raw);
        Ok(Some(Compressed { used: used?, buffer, length, rest }))
    }

    /// Takes back the buffer of a chunk that came out, to be used again.
    pub fn give_back(&mut self, buffer: Vec<u8>) {
        self.spare_small.push(buffer);
    }
}

#[cfg(test)]
mod tests {
    use std::io;

    use super::{Compressed, Compressor, EXTRA, LEAST_BYTES, Packing};
    use crate::threads;

    /// Each byte's complement, which is a compression that shows what it was given.
    #[derive(Clone, Copy)]
    struct Turned;

    impl Packing for Turned {
        fn compress(self, data: &[u8], out: &mut Vec<u8>) -> io::Result<usize> {
            if out.len() < data.len() {
                out.resize(data.len(), 0);
            }
            out.iter_mut().zip(data).for_each(|(to, from)| *to = !from);
            Ok(data.len())
        }
    }

    #[test]
    fn chunks_of_all_sizes_come_out_whole_and_in_order() {
        let chunk = |number: usize| -> Vec<u8> {
            let length = [10, LEAST_BYTES, 3 * LEAST_BYTES + number][number % 3];
            (0..length).map(|at| (at / 9 * (number + 1)) as u8).collect()
        };
        let mut compressor = Compressor::new(Turned);
        let mut next = 0;
        let mut check = |out: Compressed<usize>, compressor: &mut Compressor<Turned, usize>| {
            assert_eq!(out.rest, next);
            let back: Vec<u8> = out.buffer[..out.used].iter().map(|byte| !byte).collect();
            assert!(back == chunk(next) && out.length as usize == back.len(), "chunk {next}");
            compressor.give_back(out.buffer);
            next += 1;
        };
        for number in 0..40 {
            let mut filled = chunk(number);
            compressor.push(&mut filled, number).unwrap();
            assert!(filled.is_empty());
            while let Some(out) = compressor.pop(false).unwrap() {
                check(out, &mut compressor);
            }
            // A fast writer does not fill memory with what waits.
            assert!(compressor.flights.len() <= threads() + EXTRA);
        }
        while let Some(out) = compressor.pop(true).unwrap() {
            check(out, &mut compressor);
        }
        assert_eq!((next, compressor.bytes()), (40, 0));
        assert!(compressor.spare_small.len() <= threads() + EXTRA + 1);
    }
}
