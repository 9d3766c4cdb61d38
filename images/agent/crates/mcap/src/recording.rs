//! MCAP files as recordings, to who knows no format.

use std::fs::File;

use bagpipe_log::{Recording, RecordingError, RecordingFormat, RecordingWriter, Timeline};

use crate::{Connection, Mcap, McapWriter, WriterOptions};

impl Recording for Mcap {
    fn connections(&self) -> &[Connection] {
        Mcap::connections(self)
    }

    fn timeline(
        &self,
        wanted: &dyn Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, RecordingError> {
        Ok(Mcap::timeline(self, wanted)?)
    }
}

/// With the budget that is asked for in place of its own.
impl RecordingFormat for WriterOptions {
    fn writer(&self, byte_budget: Option<u64>) -> Box<dyn RecordingWriter> {
        Box::new(McapWriter::new(WriterOptions { byte_budget, ..self.clone() }))
    }
}

impl RecordingWriter for McapWriter {
    fn add_connection(&mut self, connection: &Connection) -> u32 {
        McapWriter::add_connection(self, connection)
    }

    fn write(&mut self, connection: u32, time_ns: u64, data: &[u8]) -> Result<(), RecordingError> {
        Ok(McapWriter::write(self, connection, time_ns, data)?)
    }

    fn spill(&mut self, file: &mut File) -> Result<(), RecordingError> {
        Ok(McapWriter::spill(self, file)?)
    }

    fn messages(&self) -> u64 {
        McapWriter::messages(self)
    }

    fn high_water(&self) -> u64 {
        McapWriter::high_water(self)
    }

    fn finish(self: Box<Self>) -> Result<Vec<u8>, RecordingError> {
        Ok(McapWriter::finish(*self)?)
    }

    fn finish_spilled(self: Box<Self>, file: &mut File) -> Result<u64, RecordingError> {
        Ok(McapWriter::finish_spilled(*self, file)?)
    }
}
