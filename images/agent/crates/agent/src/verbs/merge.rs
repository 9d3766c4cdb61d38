//! `merge`: several recordings as one.

use std::path::PathBuf;

use bagpipe_formats::{Kind, Recordings};
use clap::Args;

use crate::verbs::bagfile::{Memory, Output, failed, kind, unreadable};

#[derive(Debug, Args)]
#[command(after_help = "Messages are ordered by time; those of the same time keep the order of\n\
    the files on the command line. Connections that are alike (topic, type, definition,\n\
    publisher, latching) become one. A message that two files hold comes twice. MCAP keeps the\n\
    attachments and metadata of all files. Bags become a bag, and all else becomes MCAP.\n\n\
    Example: bagpipe-agent merge case-0001.bag case-0002.bag --output drive.bag")]
pub struct Options {
    /// Bags of format 2.0 or 1.2, in order; or MCAP, files of SQLite of rosbag2, and folders
    /// of rosbag2.
    #[arg(value_name = "FILE", required = true, num_args = 1..)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the merged recording and says how large it is.
pub fn merge(options: &Options) -> Result<(), String> {
    let kinds = options.files.iter().map(|path| kind(path)).collect::<Result<Vec<_>, _>>()?;
    let (messages, bytes) = match kinds.iter().filter(|kind| **kind == Kind::Bag).count() {
        0 => recordings(options)?,
        bags if bags == kinds.len() => self::bags(options)?,
        _ => {
            return Err(
                "bags and other recordings can't be merged: `bagpipe-agent convert` makes \
                        them alike first"
                    .to_owned(),
            );
        }
    };
    options.output.write(&bytes)?;
    let (path, files) = (options.output.output.display(), options.files.len());
    let what = if kinds.contains(&Kind::Bag) { "bags" } else { "recordings" };
    println!("{path}: {messages} messages of {files} {what}");
    Ok(())
}

fn bags(options: &Options) -> Result<(u64, Vec<u8>), String> {
    let settings = options.output.of_bag()?;
    let open = |path: &PathBuf| options.memory.open_whole(path);
    let bags = options.files.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let messages = bags.iter().map(bagpipe_rosbag::Bag::message_count).sum();
    let bytes = bagpipe_rosbag::merge(&bags, settings)
        .map_err(|error| unreadable(&options.output.output, &error))?;
    Ok((messages, bytes))
}

fn recordings(options: &Options) -> Result<(u64, Vec<u8>), String> {
    let settings = options.output.of_mcap()?;
    let open = |path: &PathBuf| options.memory.whole_recordings(path);
    let all = options.files.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let messages = all.iter().map(Recordings::message_count).sum();
    let bytes = Recordings::merge(&all, settings)
        .map_err(|error| failed(&options.output.output, &error))?;
    Ok((messages, bytes))
}
