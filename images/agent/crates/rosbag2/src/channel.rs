//! A topic of SQLite as MCAP has it.

use std::collections::BTreeMap;

use bagpipe_mcap::{Channel, Schema};

use crate::sqlite::{Definition, Topic};

/// A channel's metadata in MCAP, as rosbag2 has it.
const QOS: &str = "offered_qos_profiles";
const TYPE_HASH: &str = "topic_type_hash";

/// A topic as MCAP has it, and its type; without a definition where the file has none.
pub(crate) fn connection(topic: &Topic, definition: Option<&Definition>) -> (Schema, Channel) {
    let (encoding, text) = match definition {
        Some((encoding, text)) if encoding != "unknown" => (encoding.clone(), text.clone()),
        _ => (String::new(), String::new()),
    };
    let schema = Schema { id: 0, name: topic.datatype.clone(), encoding, data: text.into_bytes() };
    let mut metadata = BTreeMap::from([(QOS.to_owned(), topic.offered_qos.clone())]);
    if !topic.type_hash.is_empty() {
        metadata.insert(TYPE_HASH.to_owned(), topic.type_hash.clone());
    }
    let channel = Channel {
        topic: topic.name.clone(),
        message_encoding: topic.encoding.clone(),
        metadata,
        ..Channel::default()
    };
    (schema, channel)
}
