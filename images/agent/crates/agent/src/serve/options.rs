//! The options of `serve`, which each slot takes over.

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
    /// How long slots may take to end on SIGTERM before they are killed.
    #[arg(long, value_name = "MS", hide = true, default_value_t = 3500)]
    pub patience_ms: u64,
    /// The way without the cache, which `make bench BENCH=cache` measures it beside: a case's
    /// bag and its recording are files in this folder.
    #[arg(long, value_name = "DIR", hide = true)]
    pub on_disk: Option<PathBuf>,
    /// With --on-disk: the page cache forgets a file before it is read.
    #[arg(long, hide = true, requires = "on_disk")]
    pub cold: bool,
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use clap::Parser;

    use super::*;
    use crate::serve::slot::GLANCE;
    use crate::stack::HURRY;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        options: ServeOptions,
    }

    #[test]
    fn a_slot_has_time_to_end_its_stack_and_all_is_over_within_five_seconds() {
        let Line { options } = Line::parse_from(["serve", "--shared", "/shared"]);
        let patience = Duration::from_millis(options.patience_ms);
        assert!(GLANCE + HURRY + Duration::from_secs(1) <= patience);
        assert!(patience + Duration::from_millis(1500) <= Duration::from_secs(5));
    }
}
