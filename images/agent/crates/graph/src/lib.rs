//! The seam between the player and a middleware, of which ROS 1 is the first.
//!
//! A [`Middleware`] makes a [`Node`] in somebody's graph. The node advertises topics, each a
//! [`Publication`] that never drops a message, and hands what it receives to one [`Sink`]. Its
//! [`Audit`] asks the subscribers what they received, for the ledger.
//!
//! A *frame* is a message as it is played: `u32` little-endian length, then the serialised message.
#![forbid(unsafe_code)]

mod error;
mod evidence;
mod incoming;
mod middleware;
mod publication;
mod waits;

pub use error::GraphError;
pub use evidence::{Audit, Received};
pub use incoming::{Incoming, Publisher, ReadStamp, Sink};
pub use middleware::{Middleware, Node, NodeOptions, PacedBy, Seen, SystemState};
pub use publication::{
    Cancelled, FarEnd, HANGS, LinkState, Outlet, Publication, SendError, Share, TopicInfo,
};
pub use waits::Waits;
