//! `check`: whether a recording is whole and says the truth about itself.

use std::path::PathBuf;

use bagpipe_formats::{Kind, Recordings};
use clap::Args;

use crate::verbs::bagfile::{Memory, failed, file, kind, loss, unreadable};

#[derive(Debug, Args)]
#[command(
    after_help = "Reads every record, uncompresses every chunk, and compares them with the\n\
    index; of MCAP, with the times of its message indexes, too. Exit status 0\n\
    says that nothing is lost and nothing contradicts itself.\n\n\
    Example: bagpipe-agent check drive.bag"
)]
pub struct Options {
    /// A bag of format 2.0 or 1.2, MCAP, a file of SQLite of rosbag2, or a folder of rosbag2.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    memory: Memory,
}

/// Prints what was found; anything wrong is the error.
pub fn check(options: &Options) -> Result<(), String> {
    let path = options.file.display();
    let found = match kind(&options.file)? {
        Kind::Bag => bagpipe_rosbag::check_limited(&file(&options.file)?, options.memory.limits())
            .map_err(|error| unreadable(&options.file, &error))?,
        _ => Recordings::check(&options.file, options.memory.memory_budget)
            .map_err(|error| failed(&options.file, &error))?,
    };
    println!("{path}: {} whole messages", found.messages);
    if found.sound() {
        return Ok(());
    }
    let wrong: Vec<String> = found.loss.iter().map(loss).chain(found.problems).collect();
    Err(format!("{path}: {}", wrong.join("\n  ")))
}
