//! What a bag is made of, as its readers and writers see it.

use crate::Compression;

/// One publisher of one topic, as it was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Connection {
    /// The number that the bag's messages refer to.
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

/// One message, borrowed from the bag's own memory.
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

/// Where a chunk lies and what it holds.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChunkInfo {
    /// Byte offset of the CHUNK record in the file.
    pub position: u64,
    /// Time of the earliest message, in nanoseconds.
    pub start: u64,
    /// Time of the latest message, in nanoseconds.
    pub end: u64,
    /// Messages for each connection id.
    pub counts: Vec<(u32, u32)>,
    /// How its data is compressed.
    pub compression: Compression,
    /// Byte offset of its (compressed) data in the file.
    pub data_position: u64,
    /// Bytes of its (compressed) data that the file has.
    pub data_length: u32,
    /// Bytes of its data once uncompressed, as the bag declares it.
    pub size: u32,
    /// Bytes of its uncompressed data that are whole records: `size` unless it is damaged.
    pub usable: u32,
    /// True when a scan found it damaged: even where all came out, its bytes are not whole.
    pub damaged: bool,
}

impl ChunkInfo {
    /// How many messages the chunk holds.
    pub fn messages(&self) -> u64 {
        self.counts.iter().map(|(_, count)| u64::from(*count)).sum()
    }
}

/// What a damaged or truncated bag has lost.
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
