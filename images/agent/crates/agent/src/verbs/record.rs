//! `record`: topics of any ROS 1 graph into bags.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use bagpipe_replay::RecordRequest;
use bagpipe_rosbag::{Compression, WriterOptions};
use clap::Args;

use crate::size::bytes;
use crate::verbs::bagfile::write;
use crate::verbs::graph_options::{graph, interrupted, seconds};

/// The options of `record`.
#[derive(Debug, Args)]
pub struct RecordOptions {
    /// Topics, as regular expressions that match whole names; none: every topic.
    #[arg(value_name = "REGEX")]
    topics: Vec<String>,
    /// Where the bag goes; a recording that is split becomes FILE_0.bag, FILE_1.bag and so on.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// The ROS master; without it, ROS_MASTER_URI.
    #[arg(long, value_name = "URI")]
    master: Option<String>,
    /// Leave out topics whose whole names match.
    #[arg(short = 'x', long, value_name = "REGEX")]
    exclude: Option<String>,
    /// Only topics that this node subscribes to.
    #[arg(long, value_name = "NODE")]
    node: Option<String>,
    /// none, lz4 or bz2.
    #[arg(long, value_name = "NAME", default_value = "none", value_parser = compression)]
    compression: Compression,
    /// Begin a new bag once this one holds so many bytes of messages (or KiB, MiB, GiB).
    /// A bag lies in memory until then: without this, at 1 GiB.
    #[arg(long, value_name = "SIZE", value_parser = bytes)]
    split_size: Option<u64>,
    /// Begin a new bag after so many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    split_duration: Option<Duration>,
    /// End after so many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    duration: Option<Duration>,
    /// End after so many messages.
    #[arg(short, long, value_name = "N")]
    limit: Option<u64>,
}

/// What a bag in memory may hold if nobody says.
const SPLIT: u64 = 1 << 30;

/// Records, and reports how much.
pub fn record(options: &RecordOptions) -> Result<(), String> {
    let request = RecordRequest {
        middleware: graph(options.master.as_deref())?,
        topics: options.topics.clone(),
        exclude: options.exclude.clone(),
        node: options.node.clone(),
        record_as: Arc::new(WriterOptions::with_compression(options.compression)),
        split_bytes: options.split_size.unwrap_or(SPLIT).max(1),
        split_after: options.split_duration,
        duration: options.duration,
        limit: options.limit,
    };
    let interrupted = interrupted()?;
    let numbered = options.split_size.is_some() || options.split_duration.is_some();
    let output = options.output.clone();
    let mut number = 0;
    let keep = move |bag: Vec<u8>| {
        let path = if numbered { of_part(&output, number) } else { output.clone() };
        // An unforeseen second part must not take the first one's place.
        let path = if !numbered && number > 0 { of_part(&output, number) } else { path };
        number += 1;
        write(&path, &bag)
    };
    let stop = || interrupted.load(Ordering::Relaxed);
    let recorded = bagpipe_replay::record(&request, Box::new(keep), &stop)
        .map_err(|error| error.to_string())?;
    let (messages, bytes, bags) = (recorded.messages, recorded.bytes, recorded.bags);
    println!("{messages} messages, {bytes} bytes, {bags} bags");
    if recorded.again > 0 {
        let again = recorded.again;
        eprintln!("the master was restarted: {again} subscriptions were made again");
    }
    if recorded.master_lost {
        eprintln!("the master did not answer at the end: topics new since then are missing");
    }
    Ok(())
}

/// `drive.bag` becomes `drive_0.bag`.
pub fn of_part(path: &Path, number: u32) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map_or("bag".into(), |end| end.to_string_lossy());
    path.with_file_name(format!("{stem}_{number}.{extension}"))
}

fn compression(name: &str) -> Result<Compression, String> {
    match name {
        "none" => Ok(Compression::None),
        "lz4" => Ok(Compression::Lz4),
        "bz2" => Ok(Compression::Bz2),
        _ => Err("it can be none, lz4 or bz2".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_numbered_before_the_extension() {
        assert_eq!(of_part(Path::new("/a/drive.bag"), 0), Path::new("/a/drive_0.bag"));
        assert_eq!(of_part(Path::new("drive"), 12), Path::new("drive_12.bag"));
    }
}
