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
    /// How often something was staged, and what of it stands there still.
    stagings: u64,
    staged: Option<Staged>,
}

/// A record that stands behind all that the reader may read, until it is released or written over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Staged {
    number: u64,
    end: u64,
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
        Writer { which, head: 0, stagings: 0, staged: None }
    }

    /// Puts a record into the ring, whose bytes are `parts`; false if there is no room by now.
    /// `record.length` is their sum, and at most [`most`].
    pub(crate) fn write(
        &mut self,
        memory: &Memory,
        record: Record,
        parts: &[&[u8]],
    ) -> Result<bool, PlayerError> {
        let staged = self.stage(memory, record, parts)?;
        Ok(staged.is_some_and(|staged| self.release(memory, staged)))
    }

    /// The same, but the reader learns of it by [`release`](Writer::release) only: what is staged or
    /// written meanwhile takes its place.
    pub(crate) fn stage(
        &mut self,
        memory: &Memory,
        record: Record,
        parts: &[&[u8]],
    ) -> Result<Option<Staged>, PlayerError> {
        self.staged = None;
        let whole = HEAD + u64::from(record.length).next_multiple_of(ALIGNMENT);
        let behind = memory.room() as u64 - (self.head & (memory.room() as u64 - 1));
        let padding = if whole > behind { behind } else { 0 };
        if self.waiting(memory)? + padding + whole > memory.room() as u64 {
            return Ok(None);
        }
        if padding > 0 {
            let length = (padding - HEAD) as u32;
            let pad = Record { length, kind: RECORD_PAD, ..Record::default() };
            memory.set_record(self.which, self.head, pad);
        }
        let start = self.head + padding;
        memory.set_record(self.which, start, record);
        let mut at = start + HEAD;
        for part in parts {
            memory.fill(self.which, at, part);
            at += part.len() as u64;
        }
        self.stagings += 1;
        self.staged = Some(Staged { number: self.stagings, end: start + whole });
        Ok(self.staged)
    }

    /// Lets the reader have what was staged; false if something else took its place.
    pub(crate) fn release(&mut self, memory: &Memory, staged: Staged) -> bool {
        if self.staged != Some(staged) {
            return false;
        }
        self.staged = None;
        self.head = staged.end;
        let ring = memory.ring(self.which);
        ring.head.store(self.head, SeqCst);
        wake(&ring.reader_sleeps);
        true
    }

    /// Bytes that were ever written.
    pub(crate) fn written(&self) -> u64 {
        self.head
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
        // One that went back is, by this difference, far ahead.
        if waiting > memory.room() as u64 || !head.is_multiple_of(ALIGNMENT) {
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{Header, RECORD_MESSAGE, RINGS};

    const ROOM: usize = 1 << 16;

    struct Chance(u64);

    impl Chance {
        fn next(&mut self) -> u64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            self.0
        }

        /// A length: most are short, some as long as can be.
        fn length(&mut self) -> usize {
            match self.next() % 16 {
                0 => most(ROOM) - (self.next() % 40) as usize,
                1..4 => (self.next() % (ROOM as u64 / 4)) as usize,
                _ => (self.next() % 200) as usize,
            }
        }
    }

    fn record(length: usize, stamp: i64) -> Record {
        let publisher = [stamp as u8; 16];
        Record { length: length as u32, endpoint: 3, kind: RECORD_MESSAGE, stamp, publisher }
    }

    /// Sleeps for ten seconds at the most, which would be a wake that is lost.
    fn woken(sleep: impl FnOnce(Duration) -> Result<(), PlayerError>) {
        let begun = std::time::Instant::now();
        sleep(Duration::from_secs(10)).unwrap();
        assert!(begun.elapsed() < Duration::from_secs(9), "nobody woke us");
    }

    fn write_all(memory: &Memory, writer: &mut Writer, record: Record, parts: &[&[u8]]) {
        let mut written = writer.write(memory, record, parts).unwrap();
        while !written {
            let attempt = || {
                written = writer.write(memory, record, parts)?;
                Ok(written)
            };
            woken(|limit| sleep_for_room(memory, Which::Out, limit, attempt));
        }
    }

    /// Stages something that is never released, as long as can be, and the record behind it, which is
    /// released where there is room for it by now.
    fn write_staged(memory: &Memory, writer: &mut Writer, record: Record, parts: &[&[u8]]) -> bool {
        let other = vec![255; most(ROOM)];
        let fill = Record { length: other.len() as u32, ..record };
        let abandoned = writer.stage(memory, fill, &[&other]).unwrap();
        let staged = writer.stage(memory, record, parts).unwrap();
        assert!(abandoned.is_none_or(|one| !writer.release(memory, one)));
        staged.is_some_and(|one| writer.release(memory, one))
    }

    /// Whoever sleeps is woken, and what is read is what was written, in its order, whatever the
    /// lengths, and whatever was staged in its place before.
    #[test]
    fn two_threads_pass_on_all_of_it_in_order() {
        for seed in 1..=20 {
            let memory = Memory::new(ROOM).unwrap();
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    let mut writer = Writer::new(Which::Out);
                    let mut chance = Chance(seed);
                    for number in 0..2000 {
                        let bytes = vec![number as u8; chance.length()];
                        let (some, rest) = bytes.split_at(bytes.len() / 3);
                        let (record, parts) = (record(bytes.len(), number), [some, rest]);
                        if number % 3 > 0 || !write_staged(&memory, &mut writer, record, &parts) {
                            write_all(&memory, &mut writer, record, &parts);
                        }
                    }
                });
                let mut reader = Reader::new(Which::Out);
                let mut chance = Chance(seed);
                let mut number = 0;
                while number < 2000 {
                    while !reader.look(&memory).unwrap() {
                        woken(|limit| reader.sleep(&memory, limit));
                    }
                    while let Some((found, bytes)) = reader.next(&memory).unwrap() {
                        assert_eq!(found, record(chance.length(), number));
                        assert!(bytes.iter().all(|byte| *byte == number as u8), "{number}");
                        reader.done(&memory, found);
                        number += 1;
                    }
                }
            });
            assert_eq!(memory.out.head.load(SeqCst), memory.out.tail.load(SeqCst));
        }
    }

    #[test]
    fn a_ring_that_is_full_takes_no_more_until_something_was_read() {
        let memory = Memory::new(ROOM).unwrap();
        let (mut writer, mut reader) = (Writer::new(Which::In), Reader::new(Which::In));
        let half = vec![1; most(ROOM)];
        assert!(writer.write(&memory, record(half.len(), 0), &[&half]).unwrap());
        assert!(writer.write(&memory, record(half.len(), 1), &[&half]).unwrap());
        assert!(!writer.write(&memory, record(0, 2), &[]).unwrap());
        assert!(reader.look(&memory).unwrap());
        let (first, _) = reader.next(&memory).unwrap().unwrap();
        reader.done(&memory, first);
        assert!(writer.write(&memory, record(0, 2), &[]).unwrap());
        // Half a ring does not fit before its end by now: its start must be free.
        assert!(!writer.write(&memory, record(half.len(), 3), &[&half]).unwrap());
        for stamp in [1, 2] {
            assert!(reader.look(&memory).unwrap());
            let (found, _) = reader.next(&memory).unwrap().unwrap();
            assert_eq!(found.stamp, stamp);
            reader.done(&memory, found);
        }
        assert!(writer.write(&memory, record(half.len(), 3), &[&half]).unwrap());
        assert!(reader.look(&memory).unwrap());
        assert_eq!(reader.next(&memory).unwrap().unwrap().0.stamp, 3);
    }

    #[test]
    fn what_is_staged_is_read_once_released_unless_something_took_its_place() {
        let memory = Memory::new(ROOM).unwrap();
        let (mut writer, mut reader) = (Writer::new(Which::Out), Reader::new(Which::Out));
        let stage = |writer: &mut Writer, stamp| {
            writer.stage(&memory, record(8, stamp), &[b"1234", b"5678"]).unwrap().unwrap()
        };
        let replaced = stage(&mut writer, 1);
        let staged = stage(&mut writer, 2);
        assert!(!reader.look(&memory).unwrap() && writer.written() == 0);
        assert!(!writer.release(&memory, replaced));
        assert!(writer.release(&memory, staged) && !writer.release(&memory, staged));
        let overtaken = stage(&mut writer, 3);
        assert!(writer.write(&memory, record(3, 4), &[b"abc"]).unwrap());
        assert!(!writer.release(&memory, overtaken));
        assert!(reader.look(&memory).unwrap());
        for (expected, bytes) in [(record(8, 2), &b"12345678"[..]), (record(3, 4), b"abc")] {
            assert_eq!(reader.next(&memory).unwrap(), Some((expected, bytes)));
            reader.done(&memory, expected);
        }
        assert_eq!(reader.next(&memory).unwrap(), None);
        let half = vec![0; most(ROOM)];
        assert!(writer.write(&memory, record(half.len(), 5), &[&half]).unwrap());
        assert!(writer.stage(&memory, record(half.len(), 6), &[&half]).unwrap().is_none());
    }

    /// The place and the sentence of what a reader refuses.
    fn refusal(memory: &Memory, reader: &mut Reader) -> (usize, String) {
        match reader.look(memory).and_then(|_| reader.next(memory)) {
            Err(PlayerError::Damaged { offset, what }) => (offset, what),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn what_can_not_be_in_a_ring_is_refused_with_its_place() {
        let head = std::mem::offset_of!(Header, in_);
        let start = RINGS + ROOM;
        for (position, found, place, sentence) in [
            (8, record(0, 0), head, "8 bytes were written, and 0 read"),
            (ROOM as u64 + 32, record(0, 0), head, "65568 bytes were written"),
            (u64::MAX - 31, record(0, 0), head, "bytes were written, and 0 read"),
            (32, record(1, 0), start, "a record of 1 bytes"),
            (64, record(33, 0), start, "a record of 33 bytes"),
            (64, record(u32::MAX as usize, 0), start, "a record of 4294967295 bytes"),
            (64, Record { kind: 4, ..record(0, 0) }, start, "4 is no kind of record"),
            (64, Record { kind: RECORD_PAD, ..record(40, 0) }, start, "a record of 40 bytes"),
        ] {
            let memory = Memory::new(ROOM).unwrap();
            memory.set_record(Which::In, 0, found);
            memory.in_.head.store(position, SeqCst);
            let (offset, what) = refusal(&memory, &mut Reader::new(Which::In));
            assert!(offset == place && what.contains(sentence), "{offset}: {what}");
        }
    }

    #[test]
    fn a_head_that_goes_back_and_a_tail_from_the_future_are_refused() {
        let memory = Memory::new(ROOM).unwrap();
        let (mut writer, mut reader) = (Writer::new(Which::In), Reader::new(Which::In));
        for _ in 0..2 {
            assert!(writer.write(&memory, record(0, 0), &[]).unwrap());
            assert!(reader.look(&memory).unwrap());
            let (found, _) = reader.next(&memory).unwrap().unwrap();
            reader.done(&memory, found);
        }
        memory.in_.head.store(32, SeqCst);
        assert!(refusal(&memory, &mut reader).1.contains("32 bytes were written, and 64 read"));
        for tail in [96, u64::MAX] {
            memory.in_.tail.store(tail, SeqCst);
            let error = writer.write(&memory, record(0, 0), &[]).unwrap_err().to_string();
            assert!(error.contains(&format!("{tail} bytes were read of 64")), "{error}");
        }
    }

    #[test]
    fn any_bytes_are_records_or_an_error_and_never_a_panic() {
        let mut chance = Chance(7);
        let (mut refused, mut read) = (0, 0);
        for _ in 0..20_000 {
            let memory = Memory::new(ROOM).unwrap();
            // What is plausible gets further than noise.
            let mut at = 0;
            while at < 512 {
                let words = Record {
                    length: (chance.next() % 64) as u32,
                    endpoint: chance.next() as u16,
                    kind: (chance.next() % 5) as u16,
                    ..Record::default()
                };
                memory.set_record(Which::In, at, words);
                at += ALIGNMENT * (1 + chance.next() % 4);
            }
            memory.in_.head.store(chance.next() % 20 * ALIGNMENT + chance.next() % 30 / 29, SeqCst);
            let mut reader = Reader::new(Which::In);
            let mut all = || {
                reader.look(&memory)?;
                let mut bytes = 0;
                while let Some((found, data)) = reader.next(&memory)? {
                    bytes += data.len();
                    reader.done(&memory, found);
                }
                Ok::<usize, PlayerError>(bytes)
            };
            match all() {
                Ok(bytes) => read += bytes,
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 5000 && read > 5000, "{refused} {read}");
    }
}
