//! One frame: a 20-byte header and a payload.

/// Every frame begins with these bytes.
pub const MAGIC: [u8; 4] = *b"BPIP";
/// The format's version.
pub const VERSION: u8 = 1;
/// Bytes of a header.
pub const HEADER_BYTES: usize = 20;
/// The most bytes that a payload has.
pub const MAX_PAYLOAD: usize = 1 << 20;

/// What a frame is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u8)]
pub enum FrameType {
    /// Opens a session.
    Hello = 1,
    /// Announces a file's bytes.
    File = 2,
    /// A piece of the file.
    Data = 3,
    /// What came of the case.
    Result = 4,
    /// Progress.
    Metric = 5,
    /// Totals and digest: nothing is missing.
    End = 6,
    /// Why there will be no END.
    Abort = 7,
    /// A simulator's next moment.
    Step = 8,
    /// What the stack said to it.
    Answer = 9,
}

impl FrameType {
    /// The type of that number.
    pub fn from_number(number: u8) -> Option<Self> {
        use FrameType::{Abort, Answer, Data, End, File, Hello, Metric, Result, Step};
        [Hello, File, Data, Result, Metric, End, Abort, Step, Answer]
            .into_iter()
            .find(|each| *each as u8 == number)
    }

    /// Its name in the reference page.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hello => "HELLO",
            Self::File => "FILE",
            Self::Data => "DATA",
            Self::Result => "RESULT",
            Self::Metric => "METRIC",
            Self::End => "END",
            Self::Abort => "ABORT",
            Self::Step => "STEP",
            Self::Answer => "ANSWER",
        }
    }
}

/// A frame whose payload is borrowed from its decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame<'a> {
    /// What it is for.
    pub kind: FrameType,
    /// Always 0 today.
    pub flags: u16,
    /// Its number in its direction, from 0.
    pub sequence: u32,
    /// Its bytes.
    pub payload: &'a [u8],
}

impl Frame<'_> {
    /// A copy that stays.
    pub fn to_owned(self) -> OwnedFrame {
        let Frame { kind, sequence, payload, .. } = self;
        OwnedFrame { kind, sequence, payload: payload.to_vec() }
    }
}

/// A frame that owns its payload.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnedFrame {
    /// What it is for.
    pub kind: FrameType,
    /// Its number in its direction, from 0.
    pub sequence: u32,
    /// Its bytes.
    pub payload: Vec<u8>,
}

/// Bytes that are no frame: where, which field, and what was expected.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("the frame at byte {offset} of the stream {}: expected {expected}", self.verb())]
pub struct FrameError {
    /// Byte offset of the frame in its stream.
    pub offset: u64,
    /// The field that is wrong; `truncated` when the stream ends inside the frame.
    pub field: &'static str,
    /// What was expected, and what was found.
    pub expected: String,
}

impl FrameError {
    fn verb(&self) -> String {
        match self.field {
            "truncated" => "is cut off".to_owned(),
            field => format!("has a wrong {field}"),
        }
    }
}
