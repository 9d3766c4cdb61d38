//! What the fuzz targets share: memory is counted, and streams come in pieces.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::{self, Read};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Counts what is allocated and the most that was.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged; only sizes are counted.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(held, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// What `parse` makes of its input, which may take at most `bound` bytes at a time.
pub fn bounded<T>(bound: usize, parse: impl FnOnce() -> T) -> T {
    let held = HELD.load(Ordering::Relaxed);
    MOST.store(held, Ordering::Relaxed);
    let made = parse();
    let taken = MOST.load(Ordering::Relaxed).saturating_sub(held);
    assert!(taken <= bound, "{taken} bytes were allocated, and the bound is {bound}");
    made
}

/// The bytes that a bag may have uncompressed.
pub const LIMIT: u64 = 1 << 20;

/// What reading a bag of so many bytes within [`LIMIT`] may take: as the example `damage`.
pub fn bag_bound(length: usize) -> usize {
    16 * length + 3 * LIMIT as usize + (8 << 20)
}

/// The metadata.yaml and the files of a folder of rosbag2, from an input that begins with the
/// length of the first.
pub fn split_folder(bytes: &[u8]) -> (&[u8], &[u8]) {
    let Some((length, rest)) = bytes.split_first_chunk() else { return (&[], bytes) };
    rest.split_at(rest.len().min(u16::from_le_bytes(*length).into()))
}

/// A stream that gives so many bytes at a time.
pub struct Pieces<'a> {
    /// What is left of it.
    pub bytes: &'a [u8],
    /// At least 1.
    pub size: usize,
}

impl Read for Pieces<'_> {
    fn read(&mut self, into: &mut [u8]) -> io::Result<usize> {
        let length = self.size.min(into.len()).min(self.bytes.len());
        let (given, rest) = self.bytes.split_at(length);
        into[..length].copy_from_slice(given);
        self.bytes = rest;
        Ok(length)
    }
}
