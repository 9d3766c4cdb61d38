//! ROS 2: the stack's nodes count in a ledger of the case, and a player that loads the image's own
//! client library joins them.

mod domain;
pub(crate) mod entry;
mod environment;
mod files;
pub(crate) mod host;
mod parameters;
mod roll;
