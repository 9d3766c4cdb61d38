//! What a bag is made of, as Python sees it.

use std::sync::Arc;

use pyo3::prelude::*;

/// One publisher of one topic, as it was recorded.
#[pyclass(frozen, eq, module = "bagpipe_bag")]
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Connection {
    /// The number that the bag's messages refer to.
    #[pyo3(get)]
    id: u32,
    /// The topic's resolved name.
    #[pyo3(get)]
    topic: String,
    /// The message type, such as `sensor_msgs/Imu`.
    #[pyo3(get)]
    r#type: String,
    /// The type's MD5 sum, 32 hexadecimal digits.
    #[pyo3(get)]
    md5sum: String,
    /// The type's full definition, which a small file's many connections may share.
    definition: Arc<str>,
    /// The publishing node's name, or None.
    #[pyo3(get)]
    callerid: Option<String>,
    /// True when the publisher latched its last message, or its durability is transient local.
    #[pyo3(get)]
    latching: bool,
    /// How many of its last messages a subscriber that joins late gets.
    #[pyo3(get)]
    in_force: u32,
    /// What its messages' bytes are, such as `ros1` or `cdr`.
    #[pyo3(get)]
    encoding: String,
    /// What the definition is written in, such as `ros1msg`, `ros2msg` or `ros2idl`.
    #[pyo3(get)]
    schema_encoding: String,
    /// The publishers' quality of service, as ROS 2's recorder wrote it down (YAML), or None.
    #[pyo3(get)]
    offered_qos: Option<String>,
}

impl Connection {
    /// The topic's resolved name.
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// Whether a recording's connection is the same but for its number.
    pub fn is(&self, known: &bagpipe_log::Connection) -> bool {
        self.topic == known.topic
            && self.r#type == known.datatype
            && self.md5sum == known.md5sum
            && self.definition == known.definition
            && self.callerid == known.caller_id
            && self.latching == known.latching
            && self.encoding == known.message_encoding.name()
            && self.schema_encoding == known.schema_encoding.name()
            && self.offered_qos == known.offered_qos
    }

    /// As a recording declares it.
    pub fn recorded(&self) -> bagpipe_log::Connection {
        bagpipe_log::Connection {
            id: self.id,
            topic: self.topic.clone(),
            datatype: self.r#type.clone(),
            md5sum: self.md5sum.clone(),
            definition: self.definition.clone(),
            caller_id: self.callerid.clone(),
            latching: self.latching,
            message_encoding: bagpipe_log::MessageEncoding::from_name(&self.encoding),
            schema_encoding: bagpipe_log::SchemaEncoding::from_name(&self.schema_encoding),
            offered_qos: self.offered_qos.clone(),
        }
    }
}

#[pymethods]
impl Connection {
    #[getter]
    fn definition(&self) -> &str {
        &self.definition
    }

    fn __repr__(&self) -> String {
        let Self { id, topic, r#type, .. } = self;
        format!("Connection(id={id}, topic={topic:?}, type={type:?})")
    }
}

impl From<&bagpipe_log::Connection> for Connection {
    fn from(each: &bagpipe_log::Connection) -> Self {
        Self {
            id: each.id,
            topic: each.topic.clone(),
            r#type: each.datatype.clone(),
            md5sum: each.md5sum.clone(),
            definition: each.definition.clone(),
            callerid: each.caller_id.clone(),
            latching: each.latching,
            in_force: each.in_force(),
            encoding: each.message_encoding.name().to_owned(),
            schema_encoding: each.schema_encoding.name().to_owned(),
            offered_qos: each.offered_qos.clone(),
        }
    }
}

/// What a damaged or truncated bag has lost.
#[pyclass(frozen, eq, get_all, module = "bagpipe_bag")]
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Byte offset of the first damage in the file.
    offset: u64,
    /// Bytes that could not be used.
    bytes: u64,
    /// Messages that are lost, or None when nobody can know.
    messages: Option<u64>,
    /// What was expected there.
    description: String,
}

#[pymethods]
impl Damage {
    fn __repr__(&self) -> String {
        let Self { offset, bytes, description, .. } = self;
        let messages = self.messages.map_or("None".to_owned(), |count| count.to_string());
        format!(
            "Damage(offset={offset}, bytes={bytes}, messages={messages}, \
             description={description:?})"
        )
    }
}

impl From<&bagpipe_log::Loss> for Damage {
    fn from(loss: &bagpipe_log::Loss) -> Self {
        Self {
            offset: loss.offset,
            bytes: loss.bytes,
            messages: loss.messages,
            description: loss.description.clone(),
        }
    }
}

/// What a look at every record has found.
#[pyclass(frozen, get_all, module = "bagpipe_bag")]
#[derive(Debug, Clone)]
pub struct Checked {
    /// True when nothing is lost and nothing contradicts itself.
    sound: bool,
    /// Whole messages.
    messages: u64,
    /// What is lost, or None.
    damage: Option<Damage>,
    /// Sentences about what contradicts itself.
    problems: Vec<String>,
}

#[pymethods]
impl Checked {
    fn __repr__(&self) -> String {
        let sound = if self.sound { "True" } else { "False" };
        format!("Checked(sound={sound}, messages={})", self.messages)
    }
}

impl From<bagpipe_rosbag::Checked> for Checked {
    fn from(found: bagpipe_rosbag::Checked) -> Self {
        Self {
            sound: found.sound(),
            messages: found.messages,
            damage: found.loss.as_ref().map(Damage::from),
            problems: found.problems,
        }
    }
}
