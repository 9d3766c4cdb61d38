//! Frames and sessions over a pair of named pipes: how Spark and the agent talk.
//!
//! The format is docs/reference/binpipe.md; its test vectors are read by this crate's tests
//! and by the Python side's. [`Decoder`] and [`Encoder`] know bytes only; [`fifo`] opens
//! named pipes with deadlines; [`Duplex`] moves frames both ways at once with `poll`.
//!
//! Not for: what a case means. That is the agent's.
#![forbid(unsafe_code)]

mod decoder;
mod duplex;
mod encoder;
pub mod fifo;
mod frame;
mod leftovers;
mod message;

pub use decoder::Decoder;
pub use duplex::{Duplex, PipeError};
pub use encoder::Encoder;
pub use frame::{Frame, FrameError, FrameType, HEADER_BYTES, MAX_PAYLOAD, OwnedFrame};
pub use leftovers::{Leftovers, Next};
pub use message::{
    Abort, AgentHello, End, FileHeader, Metric, PROTOCOL, WorkerHello, from_map, to_map,
};
