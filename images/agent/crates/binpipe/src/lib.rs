//! The Rust side of user logic: records come in on stdin, records go out on stdout.
//!
//! ```no_run
//! # use bagpipe_binpipe::{Fields, Pipe};
//! # fn rotated(bytes: Vec<u8>) -> Vec<u8> { bytes }
//! # fn main() -> Result<(), bagpipe_binpipe::Error> {
//! let mut pipe = Pipe::standard()?;
//! while let Some(record) = pipe.next_record()? {
//!     let bytes = pipe.read()?;
//!     pipe.write(&record.name, &rotated(bytes), &Fields::new())?;
//! }
//! pipe.finish()
//! # }
//! ```
//! The protocol: docs/reference/binpipe.md, "User logic on stdin and stdout". What a program
//! returns as an error ends it with a status that is not 0, and its text on stderr reaches the
//! driver.
#![forbid(unsafe_code)]

mod field;
mod pipe;

pub use field::{Field, Fields};
pub use pipe::{Error, Pipe, Record};
