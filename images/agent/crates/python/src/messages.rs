//! Iterating over a bag's messages at native speed.

use std::sync::Arc;

use bagpipe_rosbag::{Place, Window};
use pyo3::prelude::*;
use pyo3::types::PySequence;

use crate::memory::Opened;
use crate::model::Connection;
use crate::view::{self, Part};

/// Chunks whose views are kept: messages of neighbouring chunks alternate where recorders wrote
/// them out of order.
const KEPT: usize = 16;

/// Iterates over messages in the bag's order, as (connection, time in ns, raw).
#[pyclass(module = "bagpipe_bag")]
pub struct Messages {
    opened: Arc<Opened>,
    places: std::vec::IntoIter<Place>,
    /// By id, in order.
    connections: Vec<(u32, Py<Connection>)>,
    /// Views of chunks, each at its number modulo their count.
    views: [Option<(u32, Py<PySequence>)>; KEPT],
}

impl Messages {
    /// The messages of a window, of topics or of all. Everything that takes long is done here,
    /// without Python's lock: uncompressing, walking the records, ordering.
    pub fn new(
        py: Python<'_>,
        opened: &Arc<Opened>,
        window: Window,
        topics: Option<&[String]>,
    ) -> PyResult<Self> {
        let bag = &opened.bag;
        let ordered = py.detach(|| {
            let wanted = |topic: &String| topics.is_none_or(|topics| topics.contains(topic));
            let timeline = bag.timeline_near(window, |each| wanted(&each.topic))?;
            let inside = timeline.between(window.start, window.end);
            let mut places = timeline.into_places();
            places.truncate(inside.end);
            places.drain(..inside.start);
            Ok(places.into_iter())
        });
        let places = ordered.map_err(|error| opened.raised(&error))?;
        let mut connections = Vec::with_capacity(bag.connections().len());
        for each in bag.connections() {
            connections.push((each.id, Py::new(py, Connection::from(each))?));
        }
        connections.sort_unstable_by_key(|(id, _)| *id);
        let opened = Arc::clone(opened);
        Ok(Self { opened, places, connections, views: [const { None }; KEPT] })
    }

    fn chunk<'py>(&mut self, py: Python<'py>, chunk: u32) -> PyResult<&Bound<'py, PySequence>> {
        let kept = &mut self.views[chunk as usize % KEPT];
        let view = match kept.take() {
            Some((at, view)) if at == chunk => view,
            _ => view::sequence(py, Part::Chunk(Arc::clone(&self.opened), chunk as usize))?,
        };
        Ok(kept.insert((chunk, view)).1.bind(py))
    }

    fn connection(&self, py: Python<'_>, id: u32) -> PyResult<Py<Connection>> {
        match self.connections.binary_search_by_key(&id, |(id, _)| *id) {
            Ok(at) => Ok(self.connections[at].1.clone_ref(py)),
            Err(_) => Err(self.opened.raised(&bagpipe_rosbag::BagError::UnknownConnection(id))),
        }
    }
}

type Item<'py> = (Py<Connection>, u64, Bound<'py, PySequence>);

#[pymethods]
impl Messages {
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
