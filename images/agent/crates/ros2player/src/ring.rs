//! The two sides of a ring. Each keeps its own position for itself, and believes of the other's
//! only what can be.

use std::sync::atomic::AtomicU32;
use std::sync::atomic::Ordering::SeqCst;
use std::time::Duration;

use rustix::fs::Timespec;
use rustix::thread::futex;

use crate::PlayerError;
use crate::layout::{ALIGNMENT, RECORD_FAILED, RECORD_PAD, Record};
use crate::memory::{Memory, Which};

/// A record's head, in bytes.
const HEAD: u64 = ALIGNMENT;

/// What the longest message of a ring has, in bytes.
pub(crate) fn most(room: usize) -> usize {
    room / 2 - HEAD as usize
}

/// The side that writes.
pub(crate) struct Writer {
    which: Which,
    head: u64,
}

/// The side that reads.
pub(crate) struct Reader {
    which: Which,
    tail: u64,
    /// The other's position, as it was read last.
    head: u64,
}

impl Writer {
    pub(crate) fn new(which: Which) -> Writer {
        Writer { which, head: 0 }
    }

    /// Puts a record into the ring, whose bytes are `parts`; false if there is no room by now.
    /// `record.length` is their sum, and at most [`most`].
    pub(crate) fn write(
        &mut self,
        memory: &Memory,
        record: Record,
        parts: &[&[u8]],
    ) -> Result<bool, PlayerError> {
        let whole = HEAD + u64::from(record.length).next_multiple_of(ALIGNMENT);
        let behind = memory.room() as u64 - (self.head & (memory.room() as u64 - 1));
        let padding = if whole > behind { behind } else { 0 };
        if self.waiting(memory)? + padding + whole > memory.room() as u64 {
            return Ok(false);
        }
        if padding > 0 {
            let length = (padding - HEAD) as u32;
            let pad = Record { length, endpoint: 0, kind: RECORD_PAD, stamp: 0 };
            memory.set_record(self.which, self.head, pad);
        }
        let start = self.head + padding;
        memory.set_record(self.which, start, record);
        let mut at = start + HEAD;
        for part in parts {
            memory.fill(self.which, at, part);
            at += part.len() as u64;
        }
        self.head = start + whole;
        let ring = memory.ring(self.which);
        ring.head.store(self.head, SeqCst);
        wake(&ring.reader_sleeps);
        Ok(true)
    }

    /// Bytes that were written and are not read.
    pub(crate) fn waiting(&self, memory: &Memory) -> Result<u64, PlayerError> {
        let ring = memory.ring(self.which);
        let tail = ring.tail.load(SeqCst);
        match self.head.checked_sub(tail) {
            Some(waiting) if waiting <= memory.room() as u64 => Ok(waiting),
            _ => Err(PlayerError::Damaged {
                offset: std::ptr::from_ref(&ring.tail).addr()
                    - std::ptr::from_ref(&**memory).addr(),
                what: format!("{tail} bytes were read of {} that were written", self.head),
            }),
        }
    }
}

/// Sleeps until the reader has read something, for `limit` at the most. Who asks for room first
/// and then comes here may sleep that long for nothing.
pub(crate) fn sleep_for_room(
    memory: &Memory,
    which: Which,
    limit: Duration,
    needless: impl FnOnce() -> Result<bool, PlayerError>,
) -> Result<(), PlayerError> {
    sleep(&memory.ring(which).writer_sleeps, limit, needless)
}

impl Reader {
    pub(crate) fn new(which: Which) -> Reader {
        Reader { which, tail: 0, head: 0 }
    }

    /// Whether something is to be read; what [`next`](Reader::next) reads ends where it ends now.
    pub(crate) fn look(&mut self, memory: &Memory) -> Result<bool, PlayerError> {
        let ring = memory.ring(self.which);
        let head = ring.head.load(SeqCst);
        let waiting = head.wrapping_sub(self.tail);
        if head < self.tail || waiting > memory.room() as u64 || !head.is_multiple_of(ALIGNMENT) {
            return Err(PlayerError::Damaged {
                offset: std::ptr::from_ref(&ring.head).addr()
                    - std::ptr::from_ref(&**memory).addr(),
                what: format!("{head} bytes were written, and {} read", self.tail),
            });
        }
        self.head = head;
        Ok(waiting > 0)
    }

    /// The next record before the end that [`look`](Reader::look) saw, with its bytes; it is to be
    /// given back by [`done`](Reader::done) before the next.
    pub(crate) fn next<'memory>(
        &mut self,
        memory: &'memory Memory,
    ) -> Result<Option<(Record, &'memory [u8])>, PlayerError> {
        while self.tail < self.head {
            let record = memory.record(self.which, self.tail);
            let room = memory.room() as u64;
            let behind = room - (self.tail & (room - 1));
            if whole(record) > behind.min(self.head - self.tail) {
                let what = format!("a record of {} bytes, which the ring has not", record.length);
                return Err(self.damage(memory, what));
            }
            if record.kind > RECORD_FAILED {
                return Err(self.damage(memory, format!("{} is no kind of record", record.kind)));
            }
            if record.kind != RECORD_PAD {
                let bytes = memory.bytes(self.which, self.tail + HEAD, record.length as usize);
                return Ok(Some((record, bytes)));
            }
            self.done(memory, record);
        }
        Ok(None)
    }

    /// That what is to be read next can't be.
    pub(crate) fn damage(&self, memory: &Memory, what: String) -> PlayerError {
        PlayerError::Damaged { offset: memory.offset(self.which, self.tail), what }
    }

    /// Gives the room of a record back.
    pub(crate) fn done(&mut self, memory: &Memory, record: Record) {
        self.tail += whole(record);
        let ring = memory.ring(self.which);
        ring.tail.store(self.tail, SeqCst);
        // A writer that waits for room gets much at once, instead of a wake for each record.
        if ring.head.load(SeqCst).wrapping_sub(self.tail) <= memory.room() as u64 / 2 {
            wake(&ring.writer_sleeps);
        }
    }

    /// Sleeps until something was written, for `limit` at the most.
    pub(crate) fn sleep(&mut self, memory: &Memory, limit: Duration) -> Result<(), PlayerError> {
        sleep(&memory.ring(self.which).reader_sleeps, limit, || self.look(memory))
    }
}

fn whole(record: Record) -> u64 {
    HEAD + u64::from(record.length).next_multiple_of(ALIGNMENT)
}

/// Wakes who sleeps there, if somebody does.
fn wake(sleeps: &AtomicU32) {
    if sleeps.load(SeqCst) != 0 && sleeps.swap(0, SeqCst) != 0 {
        // Who does not wake by it does so at the end of its slice.
        let _woken = futex::wake(sleeps, futex::Flags::empty(), i32::MAX as u32);
    }
}

/// Sleeps until somebody wakes us, for `limit` at the most, unless `needless` says otherwise once
/// others can see that we sleep.
fn sleep(
    sleeps: &AtomicU32,
    limit: Duration,
    needless: impl FnOnce() -> Result<bool, PlayerError>,
) -> Result<(), PlayerError> {
    use rustix::io::Errno;
    sleeps.store(1, SeqCst);
    if needless()? {
        return Ok(());
    }
    let limit = Timespec::try_from(limit).map_err(std::io::Error::other)?;
    match futex::wait(sleeps, futex::Flags::empty(), 1, Some(&limit)) {
        Ok(()) | Err(Errno::AGAIN | Errno::INTR | Errno::TIMEDOUT) => Ok(()),
        Err(other) => Err(PlayerError::Memory(other.into())),
    }
}
