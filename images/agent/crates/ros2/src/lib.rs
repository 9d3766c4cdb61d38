//! A ROS 2 graph behind the seam of `bagpipe-graph`.
//!
//! The graph is reached by a player that loads the image's own client library, or has a DDS of its
//! own (`bagpipe-ros2player`), and what its nodes take, call and publish is counted inside of them
//! (`bagpipe-ros2ledger`). Of both together comes what ROS 2 itself does not have:
//!
//! - *credit*: a message goes out once every subscriber has room for it, by its own queue's depth
//!   and a mebibyte in flight, so that none is overwritten at any speed;
//! - *proof*: what a subscriber has taken and called back, by its own process;
//! - *whole recordings*: what is published on a recorded topic is counted where it is published,
//!   and the recording is compared with it.
//!
//! Nodes that do not count (started with another environment, as another user, or linked
//! statically) are subscribers of which nothing is proved.
#![forbid(unsafe_code)]

mod absence;
mod account;
mod accounts;
mod acquaintance;
mod arrivals;
mod audit;
mod clock;
mod connections;
mod definition;
mod error;
mod handed;
mod life;
mod link;
mod middleware;
mod node;
mod options;
mod other_types;
mod publishers;
mod qos;
mod recording;
mod seen;
mod stamp;
mod stillness;
mod subscriptions;
mod succession;
mod taken;
mod topic;
mod undetermined;
mod unmet;
mod unnamed;
mod unnamed_topics;
mod unreported;

pub use middleware::Ros2;
pub use options::Ros2Options;
pub use qos::QosOverride;
pub use seen::is_of_command_line;
