//! Writing a bag in memory from Python.

use std::collections::HashMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use bagpipe_rosbag::{BagWriter, Compression, Connection, Limits, WriterOptions};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::bag::MemoryBag;
use crate::error;
use crate::memory::{Memory, Opened};

/// How a bag is written, from what Python gives.
pub fn options(compression: &str, byte_budget: Option<u64>) -> PyResult<WriterOptions> {
    let compression = Compression::from_name(compression.as_bytes()).ok_or_else(|| {
        error::bag_error(
            None,
            &format!("the compression is {compression:?}; it can be none, lz4 or bz2"),
        )
    })?;
    Ok(WriterOptions { compression, byte_budget, ..WriterOptions::default() })
}

struct Writing {
    writer: BagWriter,
    /// Connections by topic, with their ids in the bag.
    connections: HashMap<String, Vec<(Connection, u32)>>,
}

/// The fields of a message's connection, borrowed from Python.
struct ConnectionFields<'a> {
    topic: &'a str,
    r#type: &'a str,
    md5sum: &'a str,
    definition: &'a str,
    callerid: Option<&'a str>,
    latching: bool,
}

impl ConnectionFields<'_> {
    fn is(&self, known: &Connection) -> bool {
        self.r#type == known.datatype
            && self.md5sum == known.md5sum
            && *self.definition == *known.definition
            && self.callerid == known.caller_id.as_deref()
            && self.latching == known.latching
    }

    fn connection(&self) -> Connection {
        Connection {
            topic: self.topic.to_owned(),
            datatype: self.r#type.to_owned(),
            md5sum: self.md5sum.to_owned(),
            definition: self.definition.into(),
            caller_id: self.callerid.map(str::to_owned),
            latching: self.latching,
            ..Connection::default()
        }
    }
}

impl Writing {
    /// The id of the connection, which is new with its first message.
    fn id(&mut self, fields: &ConnectionFields<'_>) -> u32 {
        let of_topic = self.connections.get(fields.topic);
        if let Some((_, id)) = of_topic.and_then(|all| all.iter().find(|(each, _)| fields.is(each)))
        {
            return *id;
        }
        let connection = fields.connection();
        let id = self.writer.add_connection(&connection);
        self.connections.entry(fields.topic.to_owned()).or_default().push((connection, id));
        id
    }
}

/// Writes messages into a bag in memory, within a byte budget.
#[pyclass(frozen, module = "bagpipe_bag")]
pub struct MemoryBagWriter {
    /// None once the bag is finished. Whoever holds the lock never waits for Python's.
    writing: Mutex<Option<Writing>>,
}

impl MemoryBagWriter {
    /// An empty bag.
    pub fn new(options: WriterOptions) -> Self {
        let writing = Writing { writer: BagWriter::new(options), connections: HashMap::new() };
        Self { writing: Mutex::new(Some(writing)) }
    }

    fn lock(&self) -> MutexGuard<'_, Option<Writing>> {
        self.writing.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn put(
        &self,
        py: Python<'_>,
        fields: &ConnectionFields<'_>,
        time: u64,
        data: &[u8],
    ) -> PyResult<()> {
        let outcome = py.detach(|| {
            let mut held = self.lock();
            let writing = held.as_mut()?;
            let id = writing.id(fields);
            Some(writing.writer.write(id, time, data))
        });
        outcome.ok_or_else(finished)?.map_err(|error| error::raised(None, &error))
    }
}

fn finished() -> PyErr {
    error::bag_error(None, "the bag is finished; take a new writer to write another")
}

#[pymethods]
impl MemoryBagWriter {
    /// Appends a serialised message; see the stub for the arguments.
    #[pyo3(signature = (
        topic, time_ns, raw, *, r#type, md5sum, definition, callerid=None, latching=false
    ))]
    #[expect(clippy::too_many_arguments, reason = "Python gives them by name")]
    fn write(
        &self,
        py: Python<'_>,
        topic: &str,
        time_ns: u64,
        raw: &Bound<'_, PyAny>,
        r#type: &str,
        md5sum: &str,
        definition: &str,
        callerid: Option<&str>,
        latching: bool,
    ) -> PyResult<()> {
        let fields = ConnectionFields { topic, r#type, md5sum, definition, callerid, latching };
        match raw.cast::<PyBytes>() {
            Ok(bytes) => self.put(py, &fields, time_ns, bytes.as_bytes()),
            // Another thread may change any other buffer while it is read.
            Err(_) => self.put(py, &fields, time_ns, &PyBuffer::<u8>::get(raw)?.to_vec(py)?),
        }
    }

    /// Messages written so far.
    #[getter]
    fn message_count(&self) -> PyResult<u64> {
        Ok(self.lock().as_ref().ok_or_else(finished)?.writer.messages())
    }

    /// The most bytes that the bag, finished then, would have had at any time.
    #[getter]
    fn high_water(&self) -> PyResult<u64> {
        Ok(self.lock().as_ref().ok_or_else(finished)?.writer.high_water())
    }

    /// Writes the index and gives the bag; nothing can be written after that.
    fn finish(&self, py: Python<'_>) -> PyResult<MemoryBag> {
        let opened = py.detach(|| {
            let writing = self.lock().take().ok_or_else(finished)?;
            let bytes = writing.writer.finish().map_err(|error| error::raised(None, &error))?;
            Opened::open(Memory::Rust(bytes), None, Limits::default(), None)
        })?;
        Ok(MemoryBag { opened })
    }
}
