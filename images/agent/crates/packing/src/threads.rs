//! How many threads work at chunks side by side.

use std::thread;

/// More threads than this gain nothing: memory is the limit by then.
const MOST_THREADS: usize = 8;

/// How many threads compression and decompression may use.
pub fn threads() -> usize {
    thread::available_parallelism().map_or(1, usize::from).min(MOST_THREADS)
}
