//! `reindex`: saves what is whole of a recording that was cut off or damaged.

use std::path::PathBuf;

use bagpipe_formats::Kind;
use bagpipe_log::Loss;
use clap::Args;

use crate::verbs::bagfile::{Memory, Output, failed, file, kind, loss, unreadable};

#[derive(Debug, Args)]
#[command(
    after_help = "For a recording whose recorder died (name.bag.active), a file that was cut\n\
    off, or one that `check` complains about. Every whole message before the damage is kept,\n\
    and none of a chunk whose checksum is wrong; what is lost is in the output, and the exit\n\
    status is 0. A bag's whole chunks are copied as they are. MCAP gets chunks, message\n\
    indexes and a summary, which a job needs, and its messages are ordered by time; so does\n\
    what a folder of rosbag2 holds, whose new file is MCAP. The old file is not changed.\n\n\
    Example: bagpipe-agent reindex drive.bag.active --output drive.bag"
)]
pub struct Options {
    /// A bag of format 2.0 with a damaged index or none, or one of format 1.2; or MCAP, a file of
    /// SQLite of rosbag2, or a folder of rosbag2.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the recording with its new index and says what was lost.
pub fn reindex(options: &Options) -> Result<(), String> {
    match kind(&options.file)? {
        Kind::Bag => bag(options),
        _ => recordings(options),
    }
}

fn bag(options: &Options) -> Result<(), String> {
    let (old, settings) = (file(&options.file)?, options.output.of_bag()?);
    let made = bagpipe_rosbag::reindex_limited(old, settings, options.memory.limits())
        .map_err(|error| unreadable(&options.file, &error))?;
    options.output.write(&made.bytes)?;
    println!(
        "{}: {} messages, {} chunks as they were",
        options.output.output.display(),
        made.messages,
        made.whole_chunks
    );
    report(options, made.loss.as_ref());
    Ok(())
}

fn recordings(options: &Options) -> Result<(), String> {
    let settings = options.output.of_mcap()?;
    let old = options.memory.scanned(&options.file)?;
    let bytes = old.rewritten(settings).map_err(|error| failed(&options.file, &error))?;
    options.output.write(&bytes)?;
    println!("{}: {} messages", options.output.output.display(), old.message_count());
    report(options, old.loss());
    Ok(())
}

fn report(options: &Options, lost: Option<&Loss>) {
    if let Some(lost) = lost {
        println!("{}: {}", options.file.display(), loss(lost));
    }
}
