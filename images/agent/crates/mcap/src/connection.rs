//! Channels with their schemas as connections, and the way back.

use std::collections::BTreeMap;
use std::sync::Arc;

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

/// A type as whoever knows no format sees it. It is made once for all of its channels, of which a
/// small file may have many.
#[derive(Debug, Clone)]
pub(crate) struct Type {
    datatype: String,
    definition: Arc<str>,
    schema_encoding: SchemaEncoding,
    /// Of the definition, where that is one of ROS 1.
    md5sum: String,
}

impl Type {
    /// That of a schema; without one it has no name. A definition that is no text loses what is
    /// none; [`crate::Mcap::schemas`] has it.
    pub fn of(schema: Option<&Schema>) -> Self {
        let (datatype, encoding, data) = match schema {
            Some(schema) => (schema.name.clone(), schema.encoding.as_str(), &*schema.data),
            None => Default::default(),
        };
        let definition = String::from_utf8_lossy(data);
        let schema_encoding = SchemaEncoding::from_name(encoding);
        let md5sum = match schema_encoding {
            SchemaEncoding::Ros1Msg => ros1_md5(&datatype, &definition).unwrap_or_default(),
            _ => String::new(),
        };
        Self { datatype, definition: definition.into(), schema_encoding, md5sum }
    }
}

/// The channel as whoever knows no format sees it.
pub(crate) fn connection(channel: &Channel, of: &Type) -> Connection {
    let word = |key: &str| channel.metadata.get(key);
    let Type { datatype, definition, schema_encoding, md5sum } = of.clone();
    let md5sum = word(MD5SUM).cloned().unwrap_or(md5sum);
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
        data: connection.definition.as_bytes().to_vec(),
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
