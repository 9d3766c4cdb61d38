//! MCAP that holds ROS 1's messages, as a bag.

use bagpipe_log::{Connection, Loss, MessageEncoding, Recording, RecordingError, copy};
use bagpipe_mcap::Mcap;
use bagpipe_rosbag::{BagWriter, Compression, Limits, WriterOptions};

/// Behind the last time that a bag can state, whose seconds are 32 bits.
const END_OF_BAG_TIME: u64 = (1 << 32) * 1_000_000_000;

/// Whether bytes begin as MCAP does.
pub fn is_mcap(bytes: &[u8]) -> bool {
    bytes.starts_with(bagpipe_mcap::MAGIC)
}

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
    let asked = |each: &Connection| topics.is_none_or(|topics| is_of(each, topics));
    refuse_others(&mcap, &asked)?;
    let wanted = |each: &Connection| asked(each) && is_ros1(each);
    let mut writer = BagWriter::new(WriterOptions::with_compression(Compression::None));
    copy(&mcap as &dyn Recording, &wanted, &mut writer).map_err(|error| error.to_string())?;
    let bytes = writer.finish().map_err(|error| error.to_string())?;
    Ok((bytes, mcap.loss().cloned()))
}

/// Refuses messages that no bag can hold: of another encoding, or at a time that it can't state.
fn refuse_others(mcap: &Mcap, asked: &dyn Fn(&Connection) -> bool) -> Result<(), String> {
    let unreadable = |error: RecordingError| error.to_string();
    let recording: &dyn Recording = mcap;
    let other = |each: &Connection| asked(each) && !is_ros1(each);
    let found = recording.timeline(&other).map_err(unreadable)?.get(0).map(|each| each.connection);
    if let Some(other) = mcap.connections().iter().find(|each| found == Some(each.id)) {
        let (topic, encoding) = (&other.topic, other.message_encoding.name());
        return Err(format!("{topic} has messages in {encoding}, and a bag holds ROS 1's"));
    }
    let messages = recording.timeline(asked).map_err(unreadable)?;
    let last = messages.len().checked_sub(1).and_then(|at| messages.time(at)).unwrap_or(0);
    if last >= END_OF_BAG_TIME {
        return Err(format!("a message was logged at {last} ns, and a bag's time ends in 2106"));
    }
    Ok(())
}

/// By their names in the ROS graph, which begin with a slash.
fn is_of(connection: &Connection, topics: &[String]) -> bool {
    let bare = |topic: &str| topic.strip_prefix('/').unwrap_or(topic).to_owned();
    topics.iter().any(|topic| bare(topic) == bare(&connection.topic))
}

fn is_ros1(connection: &Connection) -> bool {
    connection.message_encoding == MessageEncoding::Ros1
}
