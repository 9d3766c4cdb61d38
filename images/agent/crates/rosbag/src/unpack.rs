//! Uncompressing many chunks side by side, ahead of the walk that needs them.

use std::borrow::Cow;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use bagpipe_packing::threads;

use crate::scan::load;
use crate::{Bag, BagError, ChunkedFile, Compression};

/// Less than this is done sooner than threads start.
const LEAST_BYTES: u64 = 1 << 20;

/// Uncompresses those of the chunks that must be, as far as the memory limit reaches. What
/// fails is left to [`chunk_bytes`], which says why, in the chunks' own order.
pub(crate) fn unpack<F: ChunkedFile>(bag: &Bag<F>, wanted: &[usize]) {
    let mut left = bag.limits.decompressed_bytes.saturating_sub(bag.made_bytes());
    let mut bytes = 0;
    let fits = |at: &usize| {
        let size = u64::from(bag.chunks[*at].size);
        bytes += size;
        let fits = size <= left;
        left = left.saturating_sub(size);
        fits
    };
    let packed = |at: &usize| {
        bag.chunks[*at].compression != Compression::None && bag.made[*at].get().is_none()
    };
    let work: Vec<usize> = wanted
        .iter()
        .copied()
        .filter(packed)
        .collect::<Vec<_>>()
        .into_iter()
        .take_while(fits)
        .collect();
    let threads = threads().min(work.len());
    if threads < 2 || bytes < LEAST_BYTES {
        return;
    }
    let next = AtomicUsize::new(0);
    thread::scope(|scope| {
        for _ in 1..threads {
            // A thread that can't start leaves its part to the others.
            let _ = thread::Builder::new().spawn_scoped(scope, || work_off(bag, &work, &next));
        }
        work_off(bag, &work, &next);
    });
}

fn work_off<F: ChunkedFile>(bag: &Bag<F>, work: &[usize], next: &AtomicUsize) {
    while let Some(at) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
        if let Ok((bytes, None)) = load(&bag.file, &bag.chunks[*at], u64::MAX, 0) {
            keep(bag, *at, bytes.into_owned());
        }
    }
}

fn keep<F: ChunkedFile>(bag: &Bag<F>, at: usize, bytes: Vec<u8>) -> &[u8] {
    bag.made[at].get_or_init(|| {
        bag.made_bytes.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        bytes
    })
}

/// A chunk's uncompressed bytes: the file's own, or made once and kept by the bag.
pub(crate) fn chunk_bytes<F: ChunkedFile>(bag: &Bag<F>, at: usize) -> Result<&[u8], BagError> {
    match passing_bytes(bag, at)? {
        Cow::Borrowed(bytes) => Ok(bytes),
        Cow::Owned(made) => Ok(keep(bag, at, made)),
    }
}

/// The same for who needs them only once: what is made for it is not kept.
pub(crate) fn passing_bytes<F: ChunkedFile>(
    bag: &Bag<F>,
    at: usize,
) -> Result<Cow<'_, [u8]>, BagError> {
    let chunk = &bag.chunks[at];
    if let Some(made) = bag.made[at].get() {
        return Ok(Cow::Borrowed(made));
    }
    let (bytes, wrong) = load(&bag.file, chunk, bag.limits.decompressed_bytes, bag.made_bytes())?;
    if let (Some(expected), false) = (wrong, chunk.damaged) {
        return Err(BagError::damaged(chunk.data_position, expected));
    }
    Ok(bytes)
}
