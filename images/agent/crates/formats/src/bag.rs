//! Recordings that hold ROS 1's messages, as a bag.

use bagpipe_log::{Connection, MessageEncoding, Recording, copy};
use bagpipe_rosbag::{BagWriter, WriterOptions};

use crate::FormatError;

/// Behind the last time that a bag can state, whose seconds are 32 bits.
const END_OF_BAG_TIME: u64 = (1 << 32) * 1_000_000_000;

/// The same connections and messages of these topics (none: of all) as a bag's bytes. A
/// connection of another encoding that published nothing is left out.
///
/// # Errors
/// [`FormatError::Refused`]: messages that no bag can hold, of another encoding or at a time that
/// it can't state. [`FormatError::Recording`].
pub fn bag_of(
    recording: &dyn Recording,
    topics: Option<&[String]>,
    options: WriterOptions,
) -> Result<Vec<u8>, FormatError> {
    let asked = |each: &Connection| topics.is_none_or(|topics| is_of(each, topics));
    refuse_others(recording, &asked)?;
    let wanted = |each: &Connection| asked(each) && is_ros1(each);
    let mut writer = BagWriter::new(options);
    copy(recording, &wanted, &mut writer)?;
    Ok(writer.finish()?)
}

fn refuse_others(
    recording: &dyn Recording,
    asked: &dyn Fn(&Connection) -> bool,
) -> Result<(), FormatError> {
    let other = |each: &Connection| asked(each) && !is_ros1(each);
    let found = recording.timeline(&other)?.get(0).map(|each| each.connection);
    if let Some(other) = recording.connections().iter().find(|each| found == Some(each.id)) {
        let (topic, encoding) = (&other.topic, other.message_encoding.name());
        return Err(FormatError::Refused(format!(
            "{topic} has messages in {encoding}, and a bag holds ROS 1's"
        )));
    }
    let messages = recording.timeline(asked)?;
    let last = messages.len().checked_sub(1).and_then(|at| messages.time(at)).unwrap_or(0);
    if last >= END_OF_BAG_TIME {
        return Err(FormatError::Refused(format!(
            "a message was logged at {last} ns, and a bag's time ends in 2106"
        )));
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
