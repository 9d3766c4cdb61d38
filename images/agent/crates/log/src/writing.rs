//! Writing a recording.

use std::fmt::Debug;
use std::fs::File;

use crate::{Connection, RecordingError};

/// What recordings are written as: a format, and how it is compressed.
pub trait RecordingFormat: Debug + Send + Sync {
    /// An empty recording, which, once it is finished, is not larger than `byte_budget` bytes.
    fn writer(&self, byte_budget: Option<u64>) -> Box<dyn RecordingWriter>;
}

/// Writes messages into a recording in memory; or, part by part, into a file.
pub trait RecordingWriter: Send {
    /// Declares a connection and returns its id here; the id that it came with has no meaning.
    fn add_connection(&mut self, connection: &Connection) -> u32;

    /// Appends a serialised message of an id of [`RecordingWriter::add_connection`]; its time is
    /// in nanoseconds.
    ///
    /// # Errors
    /// [`RecordingError::OverBudget`]: nothing was written, and the recording so far can still be
    /// finished. Else [`RecordingError::Unwritten`].
    fn write(&mut self, connection: u32, time_ns: u64, data: &[u8]) -> Result<(), RecordingError>;

    /// Appends the parts that are whole to `file` and removes them from memory. Once begun, the
    /// same file takes all of them and [`RecordingWriter::finish_spilled`].
    ///
    /// # Errors
    /// [`RecordingError::Unwritten`]: the file takes no more.
    fn spill(&mut self, file: &mut File) -> Result<(), RecordingError>;

    /// Messages written so far.
    fn messages(&self) -> u64;

    /// The most bytes that the recording, finished then, would have had at any time.
    fn high_water(&self) -> u64;

    /// Completes the recording and returns its bytes. Not for one that was spilled: its
    /// beginning is elsewhere.
    ///
    /// # Errors
    /// As [`RecordingWriter::write`].
    fn finish(self: Box<Self>) -> Result<Vec<u8>, RecordingError>;

    /// Completes a recording that lies in `file`, and returns its length in bytes.
    ///
    /// # Errors
    /// As [`RecordingWriter::write`].
    fn finish_spilled(self: Box<Self>, file: &mut File) -> Result<u64, RecordingError>;
}
