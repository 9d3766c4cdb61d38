//! A ROS 2 graph, reached through the librcl of the user's own image, or else by DDS alone.
//!
//! # By librcl
//! Types, type hashes, middleware, its settings and its security are the image's: nothing of ROS 2
//! is linked here. A small program in C ([`PROGRAM`], built from `player/`) is started in the user's
//! container with the user's environment. It loads `librcl.so` and the type supports that it
//! is asked for, makes one node, publishes serialised messages, and takes as serialised messages
//! what is to be recorded. It needs nothing but libc, and no header of ROS 2: the structures of
//! rcl, which differ between distributions, are blobs to it.
//!
//! # By DDS alone
//! Where no librcl can be loaded (ROS 2 linked statically, musl, programs of DDS with ROS 2's names)
//! [`DDS_PROGRAM`] does the same: a static program with Cyclone DDS in it, on loopback, in the domain
//! of `ROS_DOMAIN_ID`, with `CYCLONEDDS_URI` on top of its own settings. It knows no types: a
//! message is what its bytes are. Nodes' names are those that participants report on
//! `ros_discovery_info` or in their user data; others are `/unnamed_dds_participant_N`. Security,
//! RMWs that are no DDS, and services ([`Player::ask_state`]) are librcl's alone.
//!
//! # How they talk
//! The program's standard input is a socket. By its first byte comes the shared memory, a file
//! without a name; after it, requests and answers as frames: a length of what follows (u32), a
//! sequence number (u32), a verb or a status (u32), and numbers (u32, u64) and texts (u32 and so
//! many bytes; in requests they end with a zero). `player/answer.h` lists verbs and statuses.
//!
//! Messages go by two rings in the shared memory, one to the program and one from it, each with one
//! writer and one reader. A record has a head of 16 bytes (length, endpoint, kind, stamp) and its
//! bytes, stands in one piece, and is aligned to 16; what does not fit before the end of the ring
//! begins at its start, behind padding. The program publishes from where a message stands. Who
//! finds a ring empty or full says so and sleeps; only then the other side wakes it. Nobody spins.
//!
//! # What is kept
//! Messages are published in the order of [`Player::publish`], over all publishers. What was taken
//! is handed over in the order of the takes; while its ring is full nothing is taken, so that
//! messages wait in the middleware's queue: for a reliable subscription of [`History::KeepAll`]
//! nothing is lost then.
//!
//! # Its end
//! The program ends with the [`Player`], on SIGTERM, and within a second of this process's end,
//! whatever its threads wait for. When the program ends first, each call is
//! [`PlayerError::Ended`], with its status and its last lines.
//!
//! # Nothing in the memory is trusted
//! Any process of the same user can write it. Positions are kept by each side for itself; what is
//! read of the other's is compared with what can be, and [`PlayerError::Damaged`] if it can't. A
//! message's bytes are whatever stands there.

mod control;
mod error;
mod failure;
mod graph;
mod layout;
mod memory;
mod options;
mod player;
mod program;
mod qos;
mod receive;
mod ring;
mod security;
mod state;

pub use error::PlayerError;
pub use graph::{GraphNode, GraphPublisher, GraphTypes};
pub use options::PlayerOptions;
pub use player::{Player, PublisherId, SubscriptionId};
pub use qos::{Durability, History, Presence, Qos, Reliability};
pub use receive::Received;
pub use ring::Staged;
pub use state::Asked;

/// The program: an ELF file of some 30 KiB for this processor and any glibc from 2.17 on, to be written
/// where the user's container can execute it.
pub const PROGRAM: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/bagpipe-ros2player"));

/// The program on DDS alone: a static ELF file of 1.7 MB for this processor, for any C library.
pub const DDS_PROGRAM: &[u8] = include_bytes!(concat!(env!("OUT_DIR"), "/bagpipe-ros2player-dds"));
