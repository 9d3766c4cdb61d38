//! What `serve` is told, and each slot after it.

use std::net::SocketAddr;
use std::path::PathBuf;

use clap::Args;

use crate::size::bytes;

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
