//! `MemoryMcap`: MCAP in memory, with messages of any encoding, as Python sees it.

use std::sync::Arc;

use bagpipe_log::Place;
use bagpipe_mcap::{Limits, Mcap, McapError};
use pyo3::buffer::PyBuffer;
use pyo3::prelude::*;
use pyo3::types::PySequence;

use crate::error::bag_error;
use crate::model::{Connection, Damage};
use crate::view::{Part, sequence};

fn raised(error: &McapError) -> PyErr {
    bag_error(None, &error.to_string())
}

/// An MCAP file in memory, whose messages stay as they are.
#[pyclass(frozen, module = "bagpipe_bag")]
pub struct MemoryMcap {
    mcap: Arc<Mcap>,
}

#[pymethods]
impl MemoryMcap {
    /// Opens a copy of `data`.
    #[new]
    #[pyo3(signature = (data, *, decompressed_bytes=None))]
    fn new(
        py: Python<'_>,
        data: &Bound<'_, PyAny>,
        decompressed_bytes: Option<u64>,
    ) -> PyResult<Self> {
        let bytes = PyBuffer::<u8>::get(data)?.to_vec(py)?;
        let limits = decompressed_bytes
            .map_or_else(Limits::default, |bytes| Limits { decompressed_bytes: bytes });
        let opened = py.detach(|| Mcap::open_limited(bytes, limits));
        Ok(Self { mcap: Arc::new(opened.map_err(|error| raised(&error))?) })
    }

    /// Iterates over (connection, time in ns, raw) in the order of time and place in the file.
    #[pyo3(signature = (topics=None, start=None, end=None))]
    fn messages(
        &self,
        py: Python<'_>,
        topics: Option<Vec<String>>,
        start: Option<u64>,
        end: Option<u64>,
    ) -> PyResult<McapMessages> {
        let found = py.detach(|| {
            let wanted = |each: &bagpipe_log::Connection| {
                topics.as_ref().is_none_or(|topics| topics.contains(&each.topic))
            };
            let timeline = self.mcap.timeline(wanted)?;
            let mut inside = timeline.between(start.unwrap_or(0), end.unwrap_or(u64::MAX));
            // Without an end also what was logged at the last nanosecond there is.
            inside.end = if end.is_none() { timeline.len() } else { inside.end };
            let (_, mut places) = timeline.into_parts();
            places.truncate(inside.end);
            places.drain(..inside.start);
            Ok(places.into_iter())
        });
        let places = found.map_err(|error| raised(&error))?;
        let mut connections = Vec::with_capacity(self.mcap.connections().len());
        for each in self.mcap.connections() {
            connections.push((each.id, Py::new(py, Connection::from(each))?));
        }
        connections.sort_unstable_by_key(|(id, _)| *id);
        Ok(McapMessages { mcap: Arc::clone(&self.mcap), places, connections, view: None })
    }

    /// The channels as connections, in the order in which the file declares them.
    #[getter]
    fn connections(&self) -> Vec<Connection> {
        self.mcap.connections().iter().map(Connection::from).collect()
    }

    /// The topics' names, sorted.
    #[getter]
    fn topics(&self) -> Vec<String> {
        let connections = self.mcap.connections();
        let mut topics: Vec<String> = connections.iter().map(|each| each.topic.clone()).collect();
        topics.sort_unstable();
        topics.dedup();
        topics
    }

    /// What was lost to damage, or None.
    #[getter]
    fn damage(&self) -> Option<Damage> {
        self.mcap.loss().map(Damage::from)
    }
}

/// Iterates over messages in the order of time, as (connection, time in ns, raw).
#[pyclass(module = "bagpipe_bag")]
pub struct McapMessages {
    mcap: Arc<Mcap>,
    places: std::vec::IntoIter<Place>,
    /// By id, in order.
    connections: Vec<(u32, Py<Connection>)>,
    /// Of the chunk that the last message was in, by its number.
    view: Option<(u32, Py<PySequence>)>,
}

impl McapMessages {
    fn chunk<'py>(&mut self, py: Python<'py>, chunk: u32) -> PyResult<&Bound<'py, PySequence>> {
        let view = match self.view.take() {
            Some((at, view)) if at == chunk => view,
            _ => sequence(py, Part::Mcap(Arc::clone(&self.mcap), chunk))?,
        };
        Ok(self.view.insert((chunk, view)).1.bind(py))
    }

    fn connection(&self, py: Python<'_>, id: u32) -> PyResult<Py<Connection>> {
        match self.connections.binary_search_by_key(&id, |(id, _)| *id) {
            Ok(at) => Ok(self.connections[at].1.clone_ref(py)),
            Err(_) => Err(bag_error(None, &format!("nothing declares channel {id}"))),
        }
    }
}

type Item<'py> = (Py<Connection>, u64, Bound<'py, PySequence>);

#[pymethods]
impl McapMessages {
    fn __iter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    fn __next__<'py>(&mut self, py: Python<'py>) -> PyResult<Option<Item<'py>>> {
        let Some(Place { time, chunk, start, end, connection }) = self.places.next() else {
            return Ok(None);
        };
        // A frame's first four bytes are the message's length.
        let raw = self.chunk(py, chunk)?.get_slice(start as usize + 4, end as usize)?;
        Ok(Some((self.connection(py, connection)?, time, raw)))
    }

    /// How many messages are left.
    fn __length_hint__(&self) -> usize {
        self.places.len()
    }
}
