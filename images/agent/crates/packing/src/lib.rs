//! Chunks of any recording's format: LZ4 frames, and compressing side by side.
//!
//! Not for: what lies in a chunk, or how it is found, which belong to a format's own crate.
#![forbid(unsafe_code)]

mod compressor;
pub mod lz4;
mod threads;

pub use compressor::{Compressed, Compressor, Packing};
pub use threads::threads;
