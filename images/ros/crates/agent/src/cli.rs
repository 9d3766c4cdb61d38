//! The command line, and the help that teaches it.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};

use crate::bagfile::Memory;
use crate::play::PlayOptions;
use crate::record::RecordOptions;
use crate::{check, merge, reindex, slice};

/// Replays recorded ROS 1 data into the software under test, beside it in its own container.
#[derive(Debug, Parser)]
#[command(
    name = "bagpipe-agent",
    version,
    after_help = "The way of a case:\n  \
        1. An init container runs `install`, which puts this binary onto a shared volume.\n  \
        2. The user's own image runs `serve` from there; `ready` is its startup probe.\n  \
        3. A Spark worker writes a bag and a case into slots/N/to-agent; the agent starts a\n     \
           rosmaster and the user's command, plays, records, proves the delivery and\n     \
           answers through slots/N/from-agent.\n\n\
        The image needs a rosmaster (package python3-rosmaster or ros-noetic-rosmaster) and\n\
        the user's nodes; nothing of Bagpipe. For cases of the engine `exec` it needs only the\n\
        user's program, which gets the frames on stdin and answers with frames on stdout."
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
    /// Exit 0 when `serve` has made all pipes and listens to them (a startup probe).
    Ready {
        /// The shared volume.
        #[arg(long, value_name = "DIR")]
        shared: PathBuf,
    },
    /// Show what is in a bag: times, topics, types, counts, and damage.
    Info {
        /// A bag of format 2.0 or 1.2.
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
        status is 1 if any of them lost a message in any round. A master that is started\n\
        anew on the way is registered with again.")]
    Play(Box<PlayOptions>),
    /// Record topics of a running ROS 1 graph until Ctrl-C, without dropping any message.
    #[command(after_help = "Examples:\n  \
        bagpipe-agent record --output drive.bag '/camera/.*' /tf /tf_static\n  \
        bagpipe-agent record --output all.bag --exclude '.*/compressed' --split-duration 60\n\n\
        Bags are made in memory and written whole, the last one after Ctrl-C or SIGTERM.\n\
        A master that is started anew on the way is registered with again.")]
    Record(RecordOptions),
    /// Write a part of a bag, by time and topic, as a bag of its own.
    Slice(slice::Options),
    /// Write several bags as one.
    Merge(merge::Options),
    /// Save what is whole of a bag without an index, or with a damaged one.
    Reindex(reindex::Options),
    /// Read every record of a bag and say whether it is whole.
    Check(check::Options),
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

#[derive(Debug, Clone, Args)]
pub struct ServeOptions {
    /// The volume that the agent shares with Spark's container.
    #[arg(long, value_name = "DIR")]
    pub shared: PathBuf,
    /// How many cases may run at once, each with its own rosmaster.
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u32).range(1..=64))]
    pub slots: u32,
    /// The port of slot 0's rosmaster; slot n uses this port + n.
    #[arg(long, value_name = "PORT", default_value_t = 11311)]
    pub master_port: u16,
    /// The most memory that one case's input may take, as received plus uncompressed: bytes,
    /// or a number with KiB, MiB or GiB. The engine `exec` keeps no input.
    #[arg(long, value_name = "SIZE", default_value = "4GiB", value_parser = bytes)]
    pub memory_budget: u64,
    /// Answer GET /metrics there, in Prometheus' text format: what the slots do and have done.
    /// HOST is an address; 0.0.0.0 means every one. Cases run also if it can't be had.
    #[arg(long, value_name = "HOST:PORT")]
    pub metrics: Option<SocketAddr>,
    /// The way without the cache, which `make bench BENCH=cache` measures it beside: a case's
    /// bag and its recording are files in this folder.
    #[arg(long, value_name = "DIR", hide = true)]
    pub on_disk: Option<PathBuf>,
    /// With --on-disk: the page cache forgets a file before it is read.
    #[arg(long, hide = true, requires = "on_disk")]
    pub cold: bool,
}

pub fn bytes(text: &str) -> Result<u64, String> {
    let digits = text.trim_end_matches(|letter: char| letter.is_ascii_alphabetic());
    let factor = match &text[digits.len()..] {
        "" | "B" => 1,
        "KiB" | "Ki" => 1 << 10,
        "MiB" | "Mi" => 1 << 20,
        "GiB" | "Gi" => 1 << 30,
        unit => return Err(format!("unit {unit:?}: write KiB, MiB or GiB, or plain bytes")),
    };
    let number: u64 = digits.trim().parse().map_err(|error| format!("{digits:?}: {error}"))?;
    number.checked_mul(factor).ok_or_else(|| format!("{text} is more than 64 bits can say"))
}

#[cfg(test)]
mod tests {
    #[test]
    fn sizes_have_units() {
        assert_eq!(super::bytes("4GiB"), Ok(4 << 30));
        assert_eq!(super::bytes("17"), Ok(17));
        assert!(super::bytes("4 gigs").is_err_and(|text| text.contains("write KiB")));
        assert!(super::bytes("GiB").is_err());
        assert!(super::bytes("99999999999GiB").is_err());
    }
}
