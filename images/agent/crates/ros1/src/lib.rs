//! A ROS 1 graph client on threads and blocking sockets, without any ROS library.
//!
//! What it speaks is described by the public ROS wiki: [Master API], [Slave API],
//! [TCPROS] and the [connection header]. It is made for a player and a recorder that
//! must be able to *prove* what they delivered:
//!
//! - a publication never drops: it writes frames that its caller borrows (a TCPROS
//!   frame is `u32` little-endian length and body) and waits for the slowest subscriber,
//!   up to a deadline;
//! - a [`Node`]'s subscriptions deliver every frame to one sink on one thread; while the
//!   sink is busy TCP holds the publishers back;
//! - an audit asks the subscribing nodes what they received, over `getBusStats`.
//!
//! [`Ros1`] puts it behind the seam of `bagpipe-graph`, whose words it uses.
//!
//! It is not a general client library: no services, no UDPROS, no message classes. [`Rosmaster`]
//! is the other side of the [Master API], and of the Parameter Server's.
//! [`Pages`] is not ROS: a small web server over the HTTP of the slave API.
//!
//! [Master API]: https://wiki.ros.org/ROS/Master_API
//! [Slave API]: https://wiki.ros.org/ROS/Slave_API
//! [TCPROS]: https://wiki.ros.org/ROS/TCPROS
//! [connection header]: https://wiki.ros.org/ROS/Connection%20Header

mod audit;
mod calls;
mod clock;
mod error;
mod frames;
#[cfg(feature = "fuzzing")]
pub mod fuzzing;
mod header;
mod hosts;
mod http;
mod inbox;
mod listener;
mod master;
mod middleware;
mod node;
mod pages;
mod peer_queue;
mod publisher;
mod rosmaster;
mod slave;
mod sockets;
mod stamp;
mod subscriber;
mod value;
mod xmlrpc;

pub use error::RosError;
pub use hosts::is_closed;
pub use master::Master;
pub use middleware::Ros1;
pub use node::Node;
pub use pages::{Page, Pages};
pub use rosmaster::{Meet, Rosmaster};
pub use value::Value;

/// The largest message accepted, in bytes. roscpp refuses anything above as well.
pub const MAX_MESSAGE: usize = 1_000_000_000;
