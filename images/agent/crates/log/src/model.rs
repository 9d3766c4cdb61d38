//! What a recording is made of, as its readers and writers see it.

/// A channel: one publisher of one topic, as it was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connection {
    /// The number that the recording's messages refer to.
    pub id: u32,
    /// The topic's resolved name.
    pub topic: String,
    /// The message type, such as `sensor_msgs/Imu`.
    pub datatype: String,
    /// The type's MD5 sum, 32 hexadecimal digits.
    pub md5sum: String,
    /// The type's full definition.
    pub definition: String,
    /// The publishing node's name, where the recorder kept it.
    pub caller_id: Option<String>,
    /// True when the publisher latched its last message.
    pub latching: bool,
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
    /// the file lacks.
    pub bytes: u64,
    /// Messages that are lost, where the records behind the damage still say how many there
    /// were; `None` when nobody can know.
    pub messages: Option<u64>,
    /// What was expected there.
    pub description: String,
}
