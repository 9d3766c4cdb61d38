//! `reindex`: saves what is whole of a bag that was cut off or damaged.

use std::path::PathBuf;

use clap::Args;

use crate::verbs::bagfile::{Memory, Output, file, loss, unreadable};

#[derive(Debug, Args)]
#[command(
    after_help = "For a recording whose recorder died (name.bag.active), a file that was cut\n\
    off, or one that `check` complains about. Every whole message before the damage is kept;\n\
    whole chunks are copied as they are. The old file is not changed.\n\n\
    Example: bagpipe-agent reindex drive.bag.active --output drive.bag"
)]
pub struct Options {
    /// A bag of format 2.0 with a damaged index or none, or one of format 1.2.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the bag with its new index and says what was lost.
pub fn reindex(options: &Options) -> Result<(), String> {
    let (old, settings) = (file(&options.file)?, options.output.options());
    let made = bagpipe_rosbag::reindex_limited(old, settings, options.memory.limits())
        .map_err(|error| unreadable(&options.file, &error))?;
    options.output.write(&made.bytes)?;
    println!(
        "{}: {} messages, {} chunks as they were",
        options.output.output.display(),
        made.messages,
        made.whole_chunks
    );
    if let Some(lost) = &made.loss {
        println!("{}: {}", options.file.display(), loss(lost));
    }
    Ok(())
}
