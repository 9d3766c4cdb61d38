//! Writing MCAP in memory from Python.

use std::collections::HashMap;
use std::sync::{Mutex, PoisonError};

use bagpipe_mcap::{McapWriter, WriterOptions};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::error::bag_error;
use crate::model::Connection;

struct Writing {
    writer: McapWriter,
    /// Connections by topic, with their ids in the file.
    connections: HashMap<String, Vec<(bagpipe_log::Connection, u32)>>,
}

impl Writing {
    /// The id of the connection, which is new with its first message.
    fn id(&mut self, connection: &Connection) -> u32 {
        let known = self.connections.get(connection.topic());
        if let Some((_, id)) = known.and_then(|all| all.iter().find(|one| connection.is(&one.0))) {
            return *id;
        }
        let recorded = connection.recorded();
        let id = self.writer.add_connection(&recorded);
        self.connections.entry(recorded.topic.clone()).or_default().push((recorded, id));
        id
    }
}

/// Writes messages of recorded connections into MCAP in memory, within a byte budget.
#[pyclass(frozen, module = "bagpipe_bag")]
pub struct MemoryMcapWriter {
    /// None once the file is finished. Whoever holds the lock never waits for Python's.
    writing: Mutex<Option<Writing>>,
}

impl MemoryMcapWriter {
    /// Calls with what is being written, without Python's lock.
    fn with<T: Send>(
        &self,
        py: Python<'_>,
        call: impl FnOnce(&mut Option<Writing>) -> Option<T> + Send,
    ) -> PyResult<T> {
        let called =
            py.detach(|| call(&mut self.writing.lock().unwrap_or_else(PoisonError::into_inner)));
        called.ok_or_else(|| bag_error(None, "the file is finished; take a new writer"))
    }
}

#[pymethods]
impl MemoryMcapWriter {
    /// An empty file; the finished one has at most `byte_budget` bytes.
    #[new]
    #[pyo3(signature = (*, byte_budget=None))]
    fn new(byte_budget: Option<u64>) -> Self {
        let writer = McapWriter::new(WriterOptions { byte_budget, ..WriterOptions::default() });
        let connections = HashMap::new();
        Self { writing: Mutex::new(Some(Writing { writer, connections })) }
    }

    /// Appends a serialised message; connections that differ in their ids alone are one channel.
    fn write(
        &self,
        py: Python<'_>,
        connection: &Bound<'_, Connection>,
        time_ns: u64,
        raw: &Bound<'_, PyBytes>,
    ) -> PyResult<()> {
        let (connection, data) = (connection.get(), raw.as_bytes());
        let written = self.with(py, |held| {
            let writing = held.as_mut()?;
            let id = writing.id(connection);
            Some(writing.writer.write(id, time_ns, data))
        })?;
        written.map_err(|error| bag_error(None, &error.to_string()))
    }

    /// Writes the summary and gives the file's bytes; nothing can be written after that.
    fn finish<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let finished = self.with(py, |held| Some(held.take()?.writer.finish()))?;
        let bytes = finished.map_err(|error| bag_error(None, &error.to_string()))?;
        Ok(PyBytes::new(py, &bytes))
    }
}
