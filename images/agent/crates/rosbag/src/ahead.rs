//! Asking memory for bytes before they are needed.
//!
//! Each record's length says where the next one is, so that the processor would wait for
//! memory at every one. A prefetch waits for nothing and holds nothing up, unlike a load, and
//! the language has no safe one.
#![allow(unsafe_code)]

/// Asks for the lines of memory in which `at` and, a record's head later, `at + length` lie;
/// what is beyond the end is not asked for.
#[inline]
pub(crate) fn ask(bytes: &[u8], at: usize, length: usize) {
    for at in [at, at.saturating_add(length)] {
        if let Some(byte) = bytes.get(at) {
            prefetch(byte);
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[inline]
fn prefetch(byte: &u8) {
    use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
    // SAFETY: a prefetch reads and writes nothing, and `byte` is a live reference; SSE is part
    // of x86_64.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(byte).cast()) };
}

#[cfg(not(target_arch = "x86_64"))]
#[inline]
fn prefetch(byte: &u8) {
    // A load that nobody uses is the next best.
    std::hint::black_box(*byte);
}
