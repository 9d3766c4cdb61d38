//! The command line, and the help that teaches it.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Parser, Subcommand};

use crate::engine::maps::MapName;
use crate::serve::options::ServeOptions;
use crate::verbs::bagfile::Memory;
use crate::verbs::check;
use crate::verbs::convert;
use crate::verbs::graph_options::seconds;
use crate::verbs::merge;
use crate::verbs::play::PlayOptions;
use crate::verbs::record::RecordOptions;
use crate::verbs::reindex;
use crate::verbs::slice;

/// Replays recorded data of ROS 1 or 2 into the software under test, beside it in its container.
#[derive(Debug, Parser)]
#[command(
    name = "bagpipe-agent",
    version,
    after_help = "The way of a case:\n  \
        1. An init container runs `install`, which puts this binary onto a shared volume.\n  \
        2. The user's own image runs `serve` from there; `ready --wait` is its postStart hook.\n  \
        3. A Spark worker writes a recording and a case into slots/N/to-agent; the agent\n     \
           starts the user's command, in ROS 1 beside a master and in ROS 2 in a domain of\n     \
           its own, plays, records, proves the delivery and answers through\n     \
           slots/N/from-agent.\n\n\
        The image needs the user's nodes, and nothing of Bagpipe; a rosmaster (package\n\
        python3-rosmaster or ros-noetic-rosmaster) only with stack.ros1.master: image.\n\
        Nodes of ROS 2 are played to by the image's own librcl, or by a DDS of the agent's.\n\
        For cases of the engine `exec` it needs only the user's program, which gets the\n\
        frames on stdin and answers with frames on stdout."
)]
pub struct Cli {
    #[command(subcommand)]
    pub verb: Verb,
}

#[derive(Debug, Subcommand)]
pub enum Verb {
    /// Copy this binary to DIR/bin/bagpipe-agent, atomically and executable for everybody.
    Install {
        /// The shared volume.
        #[arg(value_name = "DIR")]
        directory: PathBuf,
    },
    /// Make the slots' pipes and run the cases that come through them, until SIGTERM.
    Serve(ServeOptions),
    /// Exit 0 when `serve` has made all pipes and listens to them (a container's postStart hook).
    Ready {
        /// The shared volume.
        #[arg(long, value_name = "DIR")]
        shared: PathBuf,
        /// For how long to wait for it at most.
        #[arg(long, value_name = "SECONDS", default_value = "0", value_parser = seconds)]
        wait: Duration,
    },
    /// Show what is in a recording: times, topics, types, counts, and damage.
    Info {
        /// A bag of format 2.0 or 1.2, MCAP, a file of SQLite of rosbag2, or a folder of rosbag2.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        #[command(flatten)]
        memory: Memory,
    },
    /// Play bags into a running ROS 1 graph and prove what each node received.
    #[command(after_help = "Examples:\n  \
        bagpipe-agent play drive.bag --clock\n  \
        bagpipe-agent play front.bag rear.bag --repeat 3 --json\n  \
        bagpipe-agent play drive.bag --immediate --topics /camera/image_raw\n  \
        bagpipe-agent play drive.bag --step /camera/image_raw=/lane/markings,1.5,stamp \\\n    \
          --record '/lane/.*' --output answers.bag\n\n\
        The master must run already. Nothing is sent before every named topic has a\n\
        subscriber; what each of them received is asked of the nodes themselves. The exit\n\
        status is 1 if any of them lost a message in any round. If the master is restarted\n\
        meanwhile, the player registers with it again.")]
    Play(Box<PlayOptions>),
    /// Record topics of a running ROS 1 graph until Ctrl-C, without dropping any message.
    #[command(after_help = "Examples:\n  \
        bagpipe-agent record --output drive.bag '/camera/.*' /tf /tf_static\n  \
        bagpipe-agent record --output all.bag --exclude '.*/compressed' --split-duration 60\n\n\
        Bags are made in memory and written whole, the last one after Ctrl-C or SIGTERM.\n\
        If the master is restarted meanwhile, the recorder registers with it again.")]
    Record(RecordOptions),
    /// Write a part of a recording, by time and topic, as one of its own.
    Slice(slice::Options),
    /// Write several recordings as one.
    Merge(merge::Options),
    /// Save what is whole of a recording without an index, or with a damaged one.
    Reindex(reindex::Options),
    /// Read every record of a recording and say whether it is whole.
    Check(check::Options),
    /// Write a recording in another format, or compressed in another way.
    Convert(convert::Options),
    /// Print the cases of HELLO frames from stdin as JSON, as the agent reads them; for tests.
    #[command(hide = true)]
    Hello,
    /// Write maps of the pipe from stdin again, as the agent's structs have them; for tests.
    #[command(hide = true)]
    Maps { of: MapName },
    /// One slot's process; started by `serve`.
    #[command(hide = true)]
    Slot {
        #[arg(long)]
        slot: u32,
        #[arg(long)]
        port: u16,
        #[command(flatten)]
        serve: ServeOptions,
    },
}
