//! The shared memory itself, and the only `unsafe` of this crate.
//!
//! It is a file without a name that is sealed against another length: who maps it can't be ended
//! by SIGBUS because somebody cut it.
#![allow(unsafe_code)]

use std::ops::Deref;
use std::os::fd::{AsFd, OwnedFd};
use std::ptr::NonNull;
use std::sync::atomic::AtomicU64;
use std::sync::atomic::Ordering::{Relaxed, SeqCst};

use rustix::fs::{MemfdFlags, SealFlags};
use rustix::mm::{MapFlags, ProtFlags};

use crate::layout::{ALIGNMENT, ENDPOINTS, Header, MAGIC, RINGS, Record, VERSION};

/// Which of the two rings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Which {
    /// Messages to publish.
    Out,
    /// Messages that were taken.
    In,
}

pub(crate) struct Memory {
    start: NonNull<u8>,
    room: usize,
    file: OwnedFd,
}

// SAFETY: what is not atomic is written by `fill` alone, whose callers have the ring's lock; the
// mapping stays until the drop.
unsafe impl Send for Memory {}
// SAFETY: as above.
unsafe impl Sync for Memory {}

impl Memory {
    /// Empty rings of `room` bytes each, a power of two and at least a page.
    pub(crate) fn new(room: usize) -> std::io::Result<Memory> {
        let flags = MemfdFlags::CLOEXEC | MemfdFlags::ALLOW_SEALING;
        let file = rustix::fs::memfd_create("bagpipe-ros2-player", flags)?;
        let length = RINGS + 2 * room;
        rustix::fs::ftruncate(&file, length as u64)?;
        rustix::fs::fcntl_add_seals(&file, SealFlags::SHRINK | SealFlags::GROW | SealFlags::SEAL)?;
        // SAFETY: a new mapping at an address that the kernel chooses, of a file that is as long.
        let address = unsafe {
            rustix::mm::mmap(
                std::ptr::null_mut(),
                length,
                ProtFlags::READ | ProtFlags::WRITE,
                MapFlags::SHARED,
                file.as_fd(),
                0,
            )
        }?;
        let start = NonNull::new(address.cast()).ok_or(std::io::ErrorKind::OutOfMemory)?;
        let memory = Memory { start, room, file };
        memory.version.store(VERSION, SeqCst);
        memory.endpoints.store(ENDPOINTS as u32, SeqCst);
        memory.header_room().store(room as u64, SeqCst);
        memory.magic.store(MAGIC, SeqCst);
        Ok(memory)
    }

    fn header_room(&self) -> &AtomicU64 {
        &self.deref().room
    }

    pub(crate) fn file(&self) -> &OwnedFd {
        &self.file
    }

    /// Bytes of each ring.
    pub(crate) fn room(&self) -> usize {
        self.room
    }

    pub(crate) fn ring(&self, which: Which) -> &crate::layout::Ring {
        match which {
            Which::Out => &self.out,
            Which::In => &self.in_,
        }
    }

    /// Where a byte of a ring is in the file.
    pub(crate) fn offset(&self, which: Which, position: u64) -> usize {
        let ring = RINGS + if which == Which::In { self.room } else { 0 };
        ring + (position as usize & (self.room - 1))
    }

    /// The bytes of a ring from `position` on; panics unless they are in it in one piece. Who
    /// writes this memory against the rules changes them while they are read: they are numbers of
    /// any value, and whoever believes them compares what was copied.
    pub(crate) fn bytes(&self, which: Which, position: u64, length: usize) -> &[u8] {
        let at = self.checked(which, position, length);
        // SAFETY: `checked` has shown that they are within the mapping.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr().add(at), length) }
    }

    /// Writes bytes into a ring; panics unless they fit in one piece.
    pub(crate) fn fill(&self, which: Which, position: u64, bytes: &[u8]) {
        let at = self.checked(which, position, bytes.len());
        // SAFETY: within the mapping, by `checked`; `bytes` are outside, or in the other ring.
        unsafe {
            std::ptr::copy_nonoverlapping(bytes.as_ptr(), self.start.as_ptr().add(at), bytes.len());
        }
    }

    /// The four numbers of a record's head; panics unless it is aligned and in the ring.
    fn head(&self, which: Which, position: u64) -> &[AtomicU64; 4] {
        assert!(position.is_multiple_of(ALIGNMENT));
        let at = self.checked(which, position, size_of::<[AtomicU64; 4]>());
        // SAFETY: within the mapping and aligned to 32 bytes, any of which are an atomic's.
        unsafe { &*self.start.as_ptr().add(at).cast() }
    }

    pub(crate) fn record(&self, which: Which, position: u64) -> Record {
        Record::from_words(self.head(which, position).each_ref().map(|word| word.load(Relaxed)))
    }

    pub(crate) fn set_record(&self, which: Which, position: u64, record: Record) {
        for (place, word) in self.head(which, position).iter().zip(record.words()) {
            place.store(word, Relaxed);
        }
    }

    fn checked(&self, which: Which, position: u64, length: usize) -> usize {
        let within = position as usize & (self.room - 1);
        assert!(length <= self.room - within, "{length} bytes from {within} of {}", self.room);
        self.offset(which, position)
    }
}

impl Deref for Memory {
    type Target = Header;

    fn deref(&self) -> &Header {
        // SAFETY: mapped in `new` for as long as `self` lives, aligned to a page, longer than a
        // `Header`, of which any bytes are valid; others write it too, and it is all atomics.
        unsafe { self.start.cast().as_ref() }
    }
}

impl Drop for Memory {
    fn drop(&mut self) {
        let length = RINGS + 2 * self.room;
        // SAFETY: mapped in `new` with this size; nobody has a reference after the drop.
        let unmapped = unsafe { rustix::mm::munmap(self.start.as_ptr().cast(), length) };
        debug_assert!(unmapped.is_ok());
    }
}
