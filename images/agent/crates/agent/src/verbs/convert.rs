//! `convert`: a recording as one of another format, or compressed in another way.

use std::path::PathBuf;

use bagpipe_formats::{Kind, Target, bag_into, converted};
use clap::Args;

use crate::verbs::bagfile::{Memory, Output, failed, kind};

#[derive(Debug, Args)]
#[command(
    after_help = "The name of the new recording says what it is: .bag or .mcap. Messages stay\n\
    as they are, so that a bag takes those of ROS 1 alone, and MCAP takes all. MCAP of MCAP\n\
    keeps numbers, publish times, attachments and metadata, which a bag has no place for.\n\n\
    Examples:\n  \
    bagpipe-agent convert drive.bag --output drive.mcap --compression zstd\n  \
    bagpipe-agent convert drive.mcap --output drive.bag"
)]
pub struct Options {
    /// A bag of format 2.0 or 1.2, MCAP, a file of SQLite of rosbag2, or a folder of rosbag2.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    output: Output,
    #[command(flatten)]
    memory: Memory,
}

/// Writes the recording in its new format and says how large it is.
pub fn convert(options: &Options) -> Result<(), String> {
    let new = &options.output.output;
    let target = Target::of_name(&new.to_string_lossy()).map_err(|error| failed(new, &error))?;
    let packing = options.output.packing();
    let made = match kind(&options.file)? {
        Kind::Bag => bag_into(&options.memory.open_whole(&options.file)?, target, packing),
        _ => converted(&options.memory.whole_recordings(&options.file)?, target, packing),
    };
    let made = made.map_err(|error| failed(&options.file, &error))?;
    options.output.write(&made.bytes)?;
    println!("{}: {} messages, {} bytes", new.display(), made.messages, made.bytes.len());
    Ok(())
}
