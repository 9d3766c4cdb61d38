//! A topic of SQLite as MCAP has it.

use std::collections::BTreeMap;

use bagpipe_log::{Connection, MessageEncoding};
use bagpipe_mcap::{Channel, Schema};

use crate::sqlite::{Definition, Topic};

/// A channel's metadata in MCAP, as rosbag2 has it.
const QOS: &str = "offered_qos_profiles";
const TYPE_HASH: &str = "topic_type_hash";

/// A type as MCAP has it; without a definition where the file has none.
pub(crate) fn schema(datatype: &str, definition: Option<&Definition>) -> Schema {
    let (encoding, text) = match definition {
        Some((encoding, text)) if encoding != "unknown" => (encoding.clone(), text.clone()),
        _ => (String::new(), String::new()),
    };
    Schema { id: 0, name: datatype.to_owned(), encoding, data: text.into_bytes() }
}

/// A topic as MCAP has it.
pub(crate) fn channel(topic: &Topic) -> Channel {
    let mut metadata = BTreeMap::from([(QOS.to_owned(), topic.offered_qos.clone())]);
    if !topic.type_hash.is_empty() {
        metadata.insert(TYPE_HASH.to_owned(), topic.type_hash.clone());
    }
    Channel {
        topic: topic.name.clone(),
        message_encoding: topic.encoding.clone(),
        metadata,
        ..Channel::default()
    }
}

/// A topic as a log has it, whose definition is left out.
pub(crate) fn connection(topic: &Topic, id: u32) -> Connection {
    Connection {
        id,
        topic: topic.name.clone(),
        datatype: topic.datatype.clone(),
        message_encoding: MessageEncoding::from_name(&topic.encoding),
        latching: channel(topic).is_latched(),
        offered_qos: Some(topic.offered_qos.clone()),
        ..Connection::default()
    }
}
