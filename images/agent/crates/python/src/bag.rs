//! `MemoryBag`: a bag in memory, as Python sees it.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use bagpipe_rosbag::{Bag, ChunkInfo, Limits, Window};
use pyo3::buffer::PyBuffer;
use pyo3::exceptions::PyOSError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyMemoryView};

use crate::error;
use crate::memory::{Memory, Opened};
use crate::messages::Messages;
use crate::model::{Checked, Connection, Damage};
use crate::view::{Part, view};
use crate::writer::{MemoryBagWriter, options};

/// A ROS 1 bag (format 2.0) in memory.
#[pyclass(frozen, module = "bagpipe_bag")]
pub struct MemoryBag {
    /// Shared with every view of its memory.
    pub opened: Arc<Opened>,
}

fn limits(decompressed_bytes: Option<u64>) -> Limits {
    decompressed_bytes.map_or_else(Limits::default, |bytes| Limits { decompressed_bytes: bytes })
}

/// Reads a file whole; an error is Python's own for it, with the file's name.
fn read(path: &Path) -> PyResult<Vec<u8>> {
    std::fs::read(path).map_err(|error| match error.raw_os_error() {
        Some(number) => PyOSError::new_err((number, error.to_string(), path.to_path_buf())),
        None => PyOSError::new_err(format!("{}: {error}", path.display())),
    })
}

impl MemoryBag {
    fn window(&self, start: Option<u64>, end: Option<u64>) -> PyResult<Window> {
        let window = Window { start: start.unwrap_or(0), end: end.unwrap_or(u64::MAX) };
        if window.start > window.end {
            let (start, end) = (window.start, window.end);
            return Err(self.opened.error(&format!("start {start} lies behind end {end}")));
        }
        Ok(window)
    }

    /// Refuses topics that the bag does not have: a slip of the pen must not look like silence.
    fn known(&self, topics: Option<&[String]>) -> PyResult<()> {
        let connections = self.opened.bag.connections();
        let known = |topic: &&String| connections.iter().any(|each| each.topic == **topic);
        match topics.unwrap_or_default().iter().find(|topic| !known(topic)) {
            None => Ok(()),
            Some(topic) => {
                let has = self.topics().join(", ");
                Err(self.opened.error(&format!("the bag has no topic {topic}; it has: {has}")))
            }
        }
    }

    /// Refuses a damaged bag: a part of a part would look whole.
    fn whole(&self) -> PyResult<()> {
        match self.opened.loss() {
            None => Ok(()),
            Some(loss) => Err(self.opened.error(&format!(
                "byte {}: expected {}; the bag is damaged: `bagpipe-agent reindex` saves what is \
                 whole",
                loss.offset, loss.description
            ))),
        }
    }
}

#[pymethods]
impl MemoryBag {
    /// Opens the bag that lies in `data`: `bytes` are not copied, any other buffer is.
    #[new]
    #[pyo3(signature = (data, *, decompressed_bytes=None, mcap_topics=None))]
    fn new(
        py: Python<'_>,
        data: &Bound<'_, PyAny>,
        decompressed_bytes: Option<u64>,
        mcap_topics: Option<Vec<String>>,
    ) -> PyResult<Self> {
        let memory = match data.cast::<PyBytes>() {
            Ok(bytes) => Memory::Python(PyBackedBytes::from(bytes.clone())),
            Err(_) => Memory::Rust(PyBuffer::<u8>::get(data)?.to_vec(py)?),
        };
        let limits = limits(decompressed_bytes);
        let opened = py.detach(|| Opened::open(memory, None, limits, mcap_topics.as_deref()))?;
        Ok(Self { opened })
    }

    /// Reads a file into memory and opens it.
    #[staticmethod]
    #[pyo3(signature = (path, *, decompressed_bytes=None))]
    fn open(py: Python<'_>, path: PathBuf, decompressed_bytes: Option<u64>) -> PyResult<Self> {
        let opened = py.detach(|| {
            let memory = Memory::Rust(read(&path)?);
            Opened::open(memory, Some(path.display().to_string()), limits(decompressed_bytes), None)
        })?;
        Ok(Self { opened })
    }

    /// A new bag to write into.
    #[staticmethod]
    #[pyo3(signature = (*, compression="none", byte_budget=None))]
    fn writer(compression: &str, byte_budget: Option<u64>) -> PyResult<MemoryBagWriter> {
        Ok(MemoryBagWriter::new(options(compression, byte_budget)?))
    }

    /// All messages of all bags as one bag, by time.
    #[staticmethod]
    #[pyo3(signature = (bags, *, compression="none", byte_budget=None))]
    fn merge(
        py: Python<'_>,
        bags: Vec<Py<Self>>,
        compression: &str,
        byte_budget: Option<u64>,
    ) -> PyResult<Self> {
        let options = options(compression, byte_budget)?;
        bags.iter().try_for_each(|each| each.get().whole())?;
        let opened = py.detach(|| {
            let all: Vec<&Bag<Memory>> = bags.iter().map(|each| &each.get().opened.bag).collect();
            let bytes = bagpipe_rosbag::merge(&all, options)
                .map_err(|error| error::raised(None, &error))?;
            Opened::open(Memory::Rust(bytes), None, Limits::default(), None)
        })?;
        Ok(Self { opened })
    }

    /// The messages of a window and of topics as a bag, latched ones in force before them.
    #[pyo3(signature = (start=None, end=None, topics=None, *, compression="none", byte_budget=None))]
    fn slice(
        &self,
        py: Python<'_>,
        start: Option<u64>,
        end: Option<u64>,
        topics: Option<Vec<String>>,
        compression: &str,
        byte_budget: Option<u64>,
    ) -> PyResult<Self> {
        let (window, options) = (self.window(start, end)?, options(compression, byte_budget)?);
        self.whole()?;
        self.known(topics.as_deref())?;
        let wanted = |topic: &String| topics.as_ref().is_none_or(|topics| topics.contains(topic));
        let opened = py.detach(|| {
            let Opened { bag, limits, .. } = &*self.opened;
            let made = bagpipe_rosbag::slice(bag, window, |each| wanted(&each.topic), options)
                .map_err(|error| self.opened.raised(&error))?;
            Opened::open(Memory::Rust(made.bytes), None, *limits, None)
        })?;
        Ok(Self { opened })
    }

    /// Iterates over (connection, time in ns, raw) in the order of time, chunk, offset.
    #[pyo3(signature = (topics=None, start=None, end=None))]
    fn messages(
        &self,
        py: Python<'_>,
        topics: Option<Vec<String>>,
        start: Option<u64>,
        end: Option<u64>,
    ) -> PyResult<Messages> {
        self.known(topics.as_deref())?;
        Messages::new(py, &self.opened, self.window(start, end)?, topics.as_deref())
    }

    /// Reads every record and compares what it finds with the index.
    fn check(&self, py: Python<'_>) -> PyResult<Checked> {
        let found = py.detach(|| bagpipe_rosbag::check(self.opened.bag.file()));
        found.map(Checked::from).map_err(|error| self.opened.raised(&error))
    }

    /// The connections in the order in which the bag declares them.
    #[getter]
    fn connections(&self) -> Vec<Connection> {
        self.opened.bag.connections().iter().map(Connection::from).collect()
    }

    /// The topics' names, sorted.
    #[getter]
    fn topics(&self) -> Vec<String> {
        let connections = self.opened.bag.connections();
        let mut topics: Vec<String> = connections.iter().map(|each| each.topic.clone()).collect();
        topics.sort_unstable();
        topics.dedup();
        topics
    }

    /// The time of the first message in ns, or None.
    #[getter]
    fn start(&self) -> Option<u64> {
        self.opened.bag.time_range().map(|(start, _)| start)
    }

    /// The time of the last message in ns, or None.
    #[getter]
    fn end(&self) -> Option<u64> {
        self.opened.bag.time_range().map(|(_, end)| end)
    }

    /// Whole messages.
    #[getter]
    fn message_count(&self) -> u64 {
        self.opened.bag.message_count()
    }

    /// Chunks.
    #[getter]
    fn chunk_count(&self) -> usize {
        self.opened.bag.chunks().len()
    }

    /// The names of the compressions of its chunks, sorted.
    #[getter]
    fn compressions(&self) -> Vec<&'static str> {
        let name = |each: &ChunkInfo| each.compression.name();
        let mut names: Vec<_> = self.opened.bag.chunks().iter().map(name).collect();
        names.sort_unstable();
        names.dedup();
        names
    }

    /// What was lost to damage, or None.
    #[getter]
    fn damage(&self) -> Option<Damage> {
        self.opened.loss().map(Damage::from)
    }

    /// The bag's file as it lies in memory, not copied.
    fn view<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyMemoryView>> {
        view(py, Part::File(Arc::clone(&self.opened)))
    }

    /// The bag's file as bytes: a copy, but for a bag that was opened from bytes.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        match self.opened.bag.file() {
            Memory::Python(bytes) => Ok(bytes.clone_ref(py).into_pyobject(py)?.cast_into()?),
            Memory::Rust(bytes) => Ok(PyBytes::new(py, bytes)),
        }
    }

    fn __repr__(&self) -> String {
        let (messages, chunks) = (self.message_count(), self.chunk_count());
        let name = self.opened.name.as_deref().unwrap_or("in memory");
        format!("<MemoryBag {name}: {messages} messages in {chunks} chunks>")
    }
}
