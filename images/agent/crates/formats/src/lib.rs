//! Recordings of every format: opened, shown, cut, joined, checked, mended and converted.
//!
//! What is here asks which format a recording has; a crate for each format does the rest. A bag
//! of ROS 1 is read chunk by chunk from its file; all others lie in memory as MCAP
//! ([`Recordings`]), within a limit.
#![forbid(unsafe_code)]

mod bag;
mod convert;
mod described;
mod error;
mod kind;
mod recordings;

pub use bag::bag_of;
pub use convert::{Converted, Packing, Target, bag_into, converted};
pub use described::{Described, Topic, described};
pub use error::FormatError;
pub use kind::{Kind, kind_of, kind_of_bytes};
pub use recordings::Recordings;
