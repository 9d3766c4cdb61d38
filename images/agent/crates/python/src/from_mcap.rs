//! MCAP that holds ROS 1's messages, as a bag.

use bagpipe_log::{Connection, Loss, MessageEncoding, Recording, copy};
use bagpipe_mcap::Mcap;
use bagpipe_rosbag::{BagWriter, Compression, Limits, WriterOptions};

/// Whether bytes begin as MCAP does.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(bagpipe_mcap::MAGIC)
}

/// The same connections and messages as a bag's bytes, and what was lost. It may take as much memory
/// as the chunks may when they are uncompressed; the error is a sentence.
pub fn bag(bytes: Vec<u8>, limits: Limits) -> Result<(Vec<u8>, Option<Loss>), String> {
    let Limits { decompressed_bytes } = limits;
    let mcap = Mcap::open_limited(bytes, bagpipe_mcap::Limits { decompressed_bytes })
        .map_err(|error| error.to_string())?;
    if let Some(other) = mcap.connections().iter().find(|each| !is_ros1(each)) {
        let (topic, encoding) = (&other.topic, other.message_encoding.name());
        return Err(format!("{topic} has messages in {encoding}, and a bag holds ROS 1's"));
    }
    let mut writer = BagWriter::new(WriterOptions::with_compression(Compression::None));
    copy(&mcap as &dyn Recording, &mut writer).map_err(|error| error.to_string())?;
    let bytes = writer.finish().map_err(|error| error.to_string())?;
    Ok((bytes, mcap.loss().cloned()))
}

fn is_ros1(connection: &Connection) -> bool {
    connection.message_encoding == MessageEncoding::Ros1
}
