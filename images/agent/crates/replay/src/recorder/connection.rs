//! Who sent a message, as the recording has it.

use bagpipe_graph::Incoming;
use bagpipe_log::{Connection, MessageEncoding, SchemaEncoding};

/// As its publisher has introduced itself.
pub(crate) fn connection_of(incoming: &Incoming<'_>) -> Connection {
    let publisher = incoming.publisher;
    Connection {
        id: 0,
        topic: incoming.topic.to_owned(),
        datatype: publisher.datatype.clone(),
        md5sum: publisher.md5sum.clone(),
        definition: publisher.definition.as_str().into(),
        caller_id: publisher.node.clone(),
        latching: publisher.latching,
        message_encoding: MessageEncoding::from_name(publisher.message_encoding),
        schema_encoding: SchemaEncoding::from_name(publisher.schema_encoding),
        offered_qos: publisher.offered_qos.clone(),
    }
}
