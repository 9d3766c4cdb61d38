//! The maps inside HELLO, FILE, METRIC, END and ABORT.

use rmpv::Value;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

/// The protocol's number in HELLO.
pub const PROTOCOL: u32 = 1;

/// HELLO from the worker.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct WorkerHello {
    /// 32 hexadecimal digits that no other session has.
    pub session: String,
    /// The protocol's number.
    pub protocol: u32,
    /// Name and version of the program.
    #[serde(default)]
    pub software: String,
    /// What to do; the agent's own matter. Nil where HELLO names none.
    #[serde(default = "nil")]
    pub case: Value,
}

fn nil() -> Value {
    Value::Nil
}

/// HELLO from the agent.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct AgentHello {
    /// The worker's own session id.
    pub session: String,
    /// The protocol's number.
    pub protocol: u32,
    /// Name and version of the program.
    pub software: String,
    /// Size of the pipe to the agent, as the kernel granted it.
    pub pipe_bytes: u64,
}

/// FILE: the DATA frames that follow are this file's bytes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHeader {
    /// The file's name, for messages to people.
    pub name: String,
    /// How many bytes follow.
    pub size: u64,
    /// `(stream offset, source offset, length)`: where bytes lie in the source.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub ranges: Vec<(u64, u64, u64)>,
}

impl FileHeader {
    /// The offset in the source file of a byte of the stream; `None` when it came from
    /// nowhere in the source.
    pub fn source_offset(&self, offset: u64) -> Option<u64> {
        self.ranges.iter().find_map(|(stream, source, length)| {
            // A range's end counts: a cut is found just behind the last byte.
            let inside = offset.checked_sub(*stream).filter(|inside| inside <= length)?;
            source.checked_add(inside)
        })
    }
}

/// METRIC: progress.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metric {
    /// What the agent is doing.
    pub stage: String,
    /// Messages played so far.
    pub sent: u64,
    /// Messages recorded so far.
    pub recorded: u64,
    /// Seconds of the bag that were played.
    pub bag_seconds: f64,
}

/// END: the totals of one direction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct End {
    /// FILE frames.
    pub files: u64,
    /// Bytes of DATA.
    pub bytes: u64,
    /// CRC-32C over the checksums of all frames before.
    pub digest: u32,
}

/// ABORT: why there will be no END.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Abort {
    /// CamelCase.
    pub reason: String,
    /// A sentence for people.
    pub message: String,
    /// How the program in question ended.
    #[serde(default)]
    pub exit_status: Option<i32>,
    /// The signal that ended it.
    #[serde(default)]
    pub signal: Option<i32>,
    /// Its last lines on stderr.
    #[serde(default)]
    pub stderr: Vec<String>,
    /// Its last lines on stdout.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stdout: Vec<String>,
    /// The session that is aborted, so that leftovers can be told from one's own.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub session: String,
}

/// A struct as a MessagePack map with string keys.
pub fn to_map(value: &impl Serialize) -> Result<Vec<u8>, rmp_serde::encode::Error> {
    rmp_serde::to_vec_named(value)
}

/// A MessagePack map as a struct; keys that it does not know are ignored.
pub fn from_map<T: DeserializeOwned>(payload: &[u8]) -> Result<T, rmp_serde::decode::Error> {
    rmp_serde::from_slice(payload)
}
