//! Bags as recordings, to who knows no format.

use std::fs::File;

use bagpipe_log::{Recording, RecordingError, RecordingFormat, RecordingWriter, Timeline};

use crate::{Bag, BagError, BagWriter, ChunkedFile, Connection, Window, WriterOptions, timeline};

impl<F: ChunkedFile> Recording for Bag<F> {
    fn connections(&self) -> &[Connection] {
        Bag::connections(self)
    }

    fn timeline(
        &self,
        wanted: &dyn Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, RecordingError> {
        Ok(timeline::ordered(self, Window::default(), wanted)?)
    }
}

/// With the budget that is asked for in place of its own.
impl RecordingFormat for WriterOptions {
    fn writer(&self, byte_budget: Option<u64>) -> Box<dyn RecordingWriter> {
        Box::new(BagWriter::new(WriterOptions { byte_budget, ..self.clone() }))
    }
}

impl RecordingWriter for BagWriter {
    fn add_connection(&mut self, connection: &Connection) -> u32 {
        BagWriter::add_connection(self, connection)
    }

    fn write(&mut self, connection: u32, time_ns: u64, data: &[u8]) -> Result<(), RecordingError> {
        Ok(BagWriter::write(self, connection, time_ns, data)?)
    }

    fn spill(&mut self, file: &mut File) -> Result<(), RecordingError> {
        Ok(BagWriter::spill(self, file)?)
    }

    fn messages(&self) -> u64 {
        BagWriter::messages(self)
    }

    fn high_water(&self) -> u64 {
        BagWriter::high_water(self)
    }

    fn finish(self: Box<Self>) -> Result<Vec<u8>, RecordingError> {
        Ok(BagWriter::finish(*self)?)
    }

    fn finish_spilled(self: Box<Self>, file: &mut File) -> Result<u64, RecordingError> {
        Ok(BagWriter::finish_spilled(*self, file)?)
    }
}

impl From<BagError> for RecordingError {
    fn from(error: BagError) -> Self {
        match error {
            BagError::BudgetExceeded { .. } => Self::OverBudget(error.into()),
            BagError::Io { .. }
            | BagError::NotABag { .. }
            | BagError::Encrypted { .. }
            | BagError::Damaged { .. }
            | BagError::MemoryLimit { .. } => Self::Unreadable(error.into()),
            BagError::Unwritten { .. }
            | BagError::UnknownConnection(_)
            | BagError::MessageTooLong(_)
            | BagError::Compress(_) => Self::Unwritten(error.into()),
        }
    }
}
