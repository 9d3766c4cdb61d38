//! ROS 2: the stack's nodes count in a ledger of the case, and a player joins them, by the image's
//! own client library or on DDS alone.

mod domain;
pub(crate) mod entry;
mod environment;
mod fastdds;
mod files;
pub(crate) mod host;
mod parameters;
mod players;
mod roll;
mod shared_memory;
mod transports;
mod zenoh;
