//! Channels with their schemas as connections, and the way back.

use std::collections::BTreeMap;

use bagpipe_log::{Connection, MessageEncoding, SchemaEncoding, latched_depths};

use crate::definition::ros1_md5;
use crate::record::{Channel, Schema};

/// Keys of a channel's metadata, as rosbag2 and what makes MCAP of bags write them.
const CALLER_ID: &str = "callerid";
const LATCHING: &str = "latching";
const MD5SUM: &str = "md5sum";
const QOS: &str = "offered_qos_profiles";

impl Channel {
    /// Whether a new subscriber gets its last message: in ROS 1 because it is latched, in ROS 2
    /// because it is transient local.
    pub fn is_latched(&self) -> bool {
        let word = |key: &str| self.metadata.get(key).map(String::as_str);
        matches!(word(LATCHING), Some("1" | "true"))
            || word(QOS).is_some_and(|profiles| !latched_depths(profiles).is_empty())
    }
}

/// The channel as whoever knows no format sees it. A definition that is no text loses what is
/// none; [`crate::Mcap::schemas`] has it.
pub(crate) fn connection(channel: &Channel, schema: Option<&Schema>) -> Connection {
    let word = |key: &str| channel.metadata.get(key);
    let (datatype, encoding, definition) = match schema {
        Some(schema) => (
            schema.name.clone(),
            schema.encoding.as_str(),
            String::from_utf8_lossy(&schema.data).into_owned(),
        ),
        None => Default::default(),
    };
    let schema_encoding = SchemaEncoding::from_name(encoding);
    let md5sum = match (word(MD5SUM), &schema_encoding) {
        (Some(sum), _) => sum.clone(),
        (None, SchemaEncoding::Ros1Msg) => ros1_md5(&datatype, &definition).unwrap_or_default(),
        (None, _) => String::new(),
    };
    let offered_qos = word(QOS).cloned();
    Connection {
        id: u32::from(channel.id),
        topic: channel.topic.clone(),
        datatype,
        md5sum,
        definition,
        caller_id: word(CALLER_ID).cloned(),
        latching: channel.is_latched(),
        message_encoding: MessageEncoding::from_name(&channel.message_encoding),
        schema_encoding,
        offered_qos,
    }
}

/// What is written of a connection, without the numbers; no schema where it has no type.
pub(crate) fn channel(connection: &Connection) -> (Option<Schema>, Channel) {
    let ros1 = connection.message_encoding == MessageEncoding::Ros1;
    let mut metadata = BTreeMap::new();
    let mut say = |key: &str, value: &str| metadata.insert(key.to_owned(), value.to_owned());
    if let Some(caller_id) = &connection.caller_id {
        say(CALLER_ID, caller_id);
    }
    if ros1 && connection.latching {
        say(LATCHING, "1");
    }
    if !connection.md5sum.is_empty() {
        say(MD5SUM, &connection.md5sum);
    }
    if let Some(qos) = &connection.offered_qos {
        say(QOS, qos);
    }
    let schema = Schema {
        id: 0,
        name: connection.datatype.clone(),
        encoding: connection.schema_encoding.name().to_owned(),
        data: connection.definition.clone().into_bytes(),
    };
    let named = !schema.name.is_empty() || !schema.data.is_empty();
    let channel = Channel {
        topic: connection.topic.clone(),
        message_encoding: connection.message_encoding.name().to_owned(),
        metadata,
        ..Channel::default()
    };
    (named.then_some(schema), channel)
}
