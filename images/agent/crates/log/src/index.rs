//! What planning needs to know of a recording: who published what, and which bytes hold which
//! times. Each format has a reader of it, over bytes that the caller has fetched.

/// Why a recording is not planned, in words that a job's status uses.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Reason {
    /// It holds no message.
    Empty,
    /// Its bytes do not say what the format demands.
    Unreadable,
    /// Bytes are missing at its end.
    Cut,
    /// Its recorder was stopped before it wrote the index.
    NotIndexed,
}

impl Reason {
    /// The reason in CamelCase.
    pub fn name(self) -> &'static str {
        match self {
            Self::Empty => "BagEmpty",
            Self::Unreadable => "BagUnreadable",
            Self::Cut => "BagCut",
            Self::NotIndexed => "BagNotIndexed",
        }
    }
}

/// A recording can't be planned; the sentence names the byte offset.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("{sentence}")]
pub struct Refusal {
    /// The kind of it.
    pub reason: Reason,
    /// What stands where.
    pub sentence: String,
}

/// One recorded publisher of a topic, and where its record lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Publisher {
    /// Its id in this recording.
    pub id: u32,
    /// As it was recorded, perhaps without the leading slash.
    pub topic: String,
    /// Such as `sensor_msgs/Imu`.
    pub datatype: String,
    /// The node's name; empty where it is not known.
    pub caller_id: String,
    /// What its messages' bytes are, such as `ros1`.
    pub encoding: String,
    /// How many of its last messages a subscriber that joins late gets.
    pub in_force: u32,
    /// The publishers' quality of service, as ROS 2's recorder wrote it down; empty without one.
    pub offered_qos: String,
    /// Byte offset of the record that declares it.
    pub offset: u64,
    /// Bytes of the whole record.
    pub length: u64,
}

/// Where a chunk and the index records behind it lie, and what they hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Span {
    /// Byte offset of the chunk's record in the file.
    pub offset: u64,
    /// Where its index records end.
    pub end: u64,
    /// Where they begin; `None` where the chunk's own record must be asked.
    pub index: Option<u64>,
    /// How it is compressed; `None` where the chunk's own record must be asked.
    pub compression: Option<String>,
    /// Time of the earliest message, in nanoseconds.
    pub start_time: u64,
    /// Time of the latest message, in nanoseconds.
    pub end_time: u64,
    /// Messages for each connection id, each id once.
    pub counts: Vec<(u32, u32)>,
}

/// A recording's publishers as it lists them, and its chunks in the file's order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Index {
    /// Where in the file the records lie that a reader of chunks needs before them, as (byte
    /// offset, bytes), in their order. Where the first is at 0 the file's own head is among them.
    pub declarations: Vec<(u64, u64)>,
    /// All of them.
    pub connections: Vec<Publisher>,
    /// All of them.
    pub chunks: Vec<Span>,
    /// False for a file of MCAP whose statistics don't count the messages of each channel: nothing
    /// but the chunk indexes says which chunks a topic is in.
    pub counted: bool,
}
