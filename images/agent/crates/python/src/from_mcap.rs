//! MCAP that holds ROS 1's messages, as a bag.

use bagpipe_formats::bag_of;
use bagpipe_log::Loss;
use bagpipe_mcap::Mcap;
use bagpipe_rosbag::{Compression, Limits, WriterOptions};

pub use bagpipe_mcap::is_mcap;

/// The same connections and messages of these topics (none: of all) as a bag's bytes, and what was
/// lost. A connection of another encoding that published nothing is left out. It may take as much
/// memory as the chunks may when they are uncompressed; the error is a sentence.
pub fn bag(
    bytes: Vec<u8>,
    limits: Limits,
    topics: Option<&[String]>,
) -> Result<(Vec<u8>, Option<Loss>), String> {
    let Limits { decompressed_bytes } = limits;
    let mcap = Mcap::open_limited(bytes, bagpipe_mcap::Limits { decompressed_bytes })
        .map_err(|error| error.to_string())?;
    let options = WriterOptions::with_compression(Compression::None);
    let bytes = bag_of(&mcap, topics, options).map_err(|error| error.to_string())?;
    Ok((bytes, mcap.loss().cloned()))
}
