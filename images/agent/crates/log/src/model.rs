//! What a recording is made of, as its readers and writers see it.

use std::sync::Arc;

/// What a message's bytes are.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum MessageEncoding {
    /// ROS 1's serialisation.
    #[default]
    Ros1,
    /// The common data representation of DDS, as ROS 2 has it: four bytes of head first.
    Cdr,
    /// Another, by its name.
    Other(String),
}

impl MessageEncoding {
    /// The name that recordings write.
    pub fn name(&self) -> &str {
        match self {
            Self::Ros1 => "ros1",
            Self::Cdr => "cdr",
            Self::Other(name) => name,
        }
    }

    /// The encoding of that name.
    pub fn from_name(name: &str) -> Self {
        match name {
            "ros1" => Self::Ros1,
            "cdr" => Self::Cdr,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// The language of a type's definition.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub enum SchemaEncoding {
    /// ROS 1's message files, each behind a line of `=` and its name.
    #[default]
    Ros1Msg,
    /// ROS 2's message files, likewise.
    Ros2Msg,
    /// ROS 2's interface files, likewise.
    Ros2Idl,
    /// Another, by its name; without a name there is no definition.
    Other(String),
}

impl SchemaEncoding {
    /// The name that recordings write.
    pub fn name(&self) -> &str {
        match self {
            Self::Ros1Msg => "ros1msg",
            Self::Ros2Msg => "ros2msg",
            Self::Ros2Idl => "ros2idl",
            Self::Other(name) => name,
        }
    }

    /// The encoding of that name.
    pub fn from_name(name: &str) -> Self {
        match name {
            "ros1msg" => Self::Ros1Msg,
            "ros2msg" => Self::Ros2Msg,
            "ros2idl" => Self::Ros2Idl,
            other => Self::Other(other.to_owned()),
        }
    }
}

/// A channel: one publisher of one topic, as it was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connection {
    /// The number that the recording's messages refer to.
    pub id: u32,
    /// The topic's resolved name.
    pub topic: String,
    /// The message type, such as `sensor_msgs/Imu`; empty where the recording has none.
    pub datatype: String,
    /// The type's MD5 sum, 32 hexadecimal digits; empty in ROS 2, which has none.
    pub md5sum: String,
    /// The type's full definition, which all connections of the type may share.
    pub definition: Arc<str>,
    /// The publishing node's name, where the recorder kept it.
    pub caller_id: Option<String>,
    /// True when the publisher latched its last message, which in ROS 2 is the durability
    /// transient local.
    pub latching: bool,
    /// What its messages' bytes are.
    pub message_encoding: MessageEncoding,
    /// What `definition` is written in.
    pub schema_encoding: SchemaEncoding,
    /// The publishers' quality of service, as ROS 2's recorder wrote it down (YAML).
    pub offered_qos: Option<String>,
}

/// One message, borrowed from the recording's own memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Message<'a> {
    /// The id of its [`Connection`].
    pub connection: u32,
    /// When it was received by the recorder, in nanoseconds.
    pub time: u64,
    /// The serialised message.
    pub data: &'a [u8],
    /// The same with its length (u32, little-endian) before it: its TCPROS frame.
    pub frame: &'a [u8],
}

/// What a damaged or truncated recording has lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loss {
    /// Byte offset of the first damage in the file.
    pub offset: u64,
    /// Bytes that could not be used: unreadable ones, and ones that a record declares and
    /// the file lacks. None where an end or a summary alone is missing.
    pub bytes: u64,
    /// Messages that are lost, where the records behind the damage still say how many there
    /// were; `None` when nobody can know.
    pub messages: Option<u64>,
    /// What was expected there.
    pub description: String,
}
