//! What ROS 2 nodes take, call and publish: counted inside of them, read and waited for from outside.
//!
//! In ROS 2 a message waits in the middleware until the node's executor *takes* it; what the queue
//! overwrites before is gone, and nothing reports it. A library that is preloaded into the nodes
//! ([`LIBRARY`], built from `preload/`) therefore counts at the two interfaces that every distribution
//! from Foxy on has: `rmw` (takes, publishes, subscriptions with their QoS) and `tracetools`
//! (starts and ends of rclcpp's callbacks). It needs nothing but libc, writes into shared memory
//! that a [`Ledger`] makes, and passes every call on; without a ledger that is all that it does.
//!
//! How far that proves a delivery is an endpoint's [`Strength`]:
//! - [`Called`](Strength::Called): rclcpp reported start and end of the callback;
//! - [`Taken`](Strength::Taken): rclpy, and C++ that takes serialised messages: takes are exact, and
//!   the end is inferred from the thread's next take or wait. With several threads up to one less
//!   for each thread is seen to end, and a callback that itself spins ends too early;
//! - [`Received`](Strength::Received): the process uses ROS 2 and counts nothing, since it was started
//!   with another environment, as another user, or linked statically ([`Ledger::strength_of`]).
//!
//! # What is exact
//! Of one subscription at rest: messages that it was sent, less those taken, were overwritten;
//! takes are starts are ends. After SIGKILL in a callback there is one start more than ends for each
//! thread in one. Intra-process messages of rclcpp have starts and ends of their own and no take;
//! copies of them that come through the middleware as well are taken and returned, without a call.
//! Callbacks of timers and services count for their process.
//! A call into rmw that is made by another one counts once. A child of `fork` counts for itself
//! from the first endpoint that it creates; what it uses of its parent's is not counted. Where a
//! table is full the rest is counted in `unlisted`, never left out in silence.
//!
//! # Matches, and rest
//! Before a first message goes out its reader has to have matched the writer: while somebody
//! [watches](Ledger::watch_matches), [`Endpoint::matched`] has what the reader's own middleware
//! says. When what an input set off has come to its end, over several nodes, is
//! [`Ledger::quiet`]: proved by counts, or a doubt with its reason.
//!
//! # Large messages
//! The kernel throws away what a receiver's socket has no room for. Where the reader asks for it
//! ([`Ledger::control_flow`]), a node that publishes over Cyclone DDS waits until there is.
//!
//! # Nothing in it is trusted
//! The nodes write this memory, so whatever is read is compared with what can be: no value of it is
//! an index or a bound, and nothing that a node writes makes a call of this crate panic or last
//! beyond its deadline. What makes no sense is [`LedgerError::Damaged`]. A node can lie with figures
//! that make sense; it could lie in its answers as well.
//!
//! # Cost
//! A message that is published, waited for, taken and called takes 101 ns more with a ledger (226 for
//! 125), 75 where there are no tracepoints (194 for 119), and some 300 more while a reader sleeps
//! until each end; 30 of each are for whose the message is. Medians of seven rounds of the stand-in, two cores, 27 November 2026, by
//! `cargo run --release -p bagpipe-ros2ledger --example cost 7`. A look at whether nodes are
//! at rest takes its reader 3 µs for one process with four endpoints, and 31 for 25 of them, by the
//! same program. docs/limits.md has what is not covered.

mod endpoint;
mod error;
mod flow;
mod layout;
mod ledger;
mod library;
mod memory;
mod own;
mod process;
mod quiet;
mod wait;

pub use endpoint::{
    Counts, Durability, Endpoint, EndpointId, History, Kind, Presence, Qos, Reliability,
};
pub use error::LedgerError;
pub use flow::Flow;
pub use ledger::{Ledger, Unlisted};
pub use library::{LIBRARY, uncounted};
pub use process::{Awake, Process, ProcessId, Strength};
pub use quiet::{Busy, Doubt, Mark, Quiet, Why};
pub use wait::{Event, Waited};
