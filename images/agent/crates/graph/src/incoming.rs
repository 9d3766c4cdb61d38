//! What is received, and who takes it in.

/// Reads the stamp of a serialised message, in nanoseconds; `None` if the message is too short.
pub type ReadStamp = fn(&[u8]) -> Option<u64>;

/// The publisher at the other end of a connection, as it introduced itself.
#[derive(Clone, Debug, Default)]
pub struct Publisher {
    /// The node's name; `None` if it did not say.
    pub node: Option<String>,
    /// Message type, such as `sensor_msgs/JointState`.
    pub datatype: String,
    /// MD5 sum of the message definition, 32 hex digits.
    pub md5sum: String,
    /// What its messages' bytes are, by the name that recordings have for it, such as `cdr`.
    pub message_encoding: &'static str,
    /// Full text of the message definition.
    pub definition: String,
    /// What `definition` is written in, by the name that recordings have for it, such as `ros2msg`.
    pub schema_encoding: &'static str,
    /// Whether late subscribers get its last message.
    pub latching: bool,
    /// Whether they may although `latching` has it otherwise ([`crate::Node::latching_after_all`]).
    pub may_latch: bool,
    /// Its quality of service, as ROS 2's recorder writes it down (YAML).
    pub offered_qos: Option<String>,
    /// How to read the stamps of its messages; `None` if they have none.
    pub read_stamp: Option<ReadStamp>,
}

/// A received message.
pub struct Incoming<'a> {
    /// The topic, as subscribed.
    pub topic: &'a str,
    /// Who sent it.
    pub publisher: &'a Publisher,
    /// The connection, a number that is never used again.
    pub link: u64,
    /// The serialised message, without the length.
    pub data: &'a [u8],
}

/// Takes messages in, one after the other. While it works, publishers wait.
pub trait Sink: Send {
    /// A whole message.
    fn message(&mut self, incoming: Incoming<'_>);
    /// A part of a message, of which more is to come.
    fn part(&mut self) {}
    /// A message longer than accepted was announced; its connection is closed.
    fn too_large(&mut self, topic: &str, length: u64);
    /// What had to stay there as long as the play lasts did not, as a sentence.
    fn broken(&mut self, _why: String) {}
}
