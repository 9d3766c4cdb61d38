//! `merge`: several bags as one.

use std::path::PathBuf;

use clap::Args;

use crate::verbs::bagfile::{Memory, Output, unreadable};

#[derive(Debug, Args)]
#[command(after_help = "Messages are ordered by time; those of the same time keep the order of\n\
    the files on the command line. Connections that are alike (topic, type, definition,\n\
    publisher, latching) become one. A message that two files hold comes twice.\n\n\
    Example: bagpipe-agent merge case-0001.bag case-0002.bag --output drive.bag")]
pub struct Options {
    /// Bags of format 2.0 or 1.2, in order.
    #[arg(value_name = "FILE", required = true, num_args = 1..)]
    files: Vec<PathBuf>,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the merged bag and says how large it is.
pub fn merge(options: &Options) -> Result<(), String> {
    let bags: Vec<_> = options
        .files
        .iter()
        .map(|path| options.memory.open_whole(path))
        .collect::<Result<_, _>>()?;
    let messages: u64 = bags.iter().map(bagpipe_rosbag::Bag::message_count).sum();
    let bytes = bagpipe_rosbag::merge(&bags, options.output.options())
        .map_err(|error| unreadable(&options.output.output, &error))?;
    options.output.write(&bytes)?;
    let (path, files) = (options.output.output.display(), bags.len());
    println!("{path}: {messages} messages of {files} bags");
    Ok(())
}
