//! What bytes of a recording say to a planner, which reads ranges of it from storage by itself.

use bagpipe_log::{Index, Publisher, Refusal, Span};
use bagpipe_mcap::tail as mcap;
use bagpipe_rosbag::tail::{self, Head};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};

pyo3::create_exception!(
    bagpipe_bag,
    TailError,
    PyValueError,
    "A bag can't be planned: its arguments are a reason in CamelCase and a sentence."
);

fn raised(refusal: Refusal) -> PyErr {
    TailError::new_err((refusal.reason.name(), refusal.sentence))
}

/// (index_pos, conn_count, chunk_count)
type HeadFields = (u64, u32, u32);
/// (id, topic, type, caller id, encoding, in force, offered QoS, offset, length)
pub type PublisherFields = (u32, String, String, String, String, u32, String, u64, u64);
/// (offset, end, start time, end time, counts, index, compression)
type SpanFields<'py> = (u64, u64, u64, u64, Bound<'py, PyDict>, Option<u64>, Option<String>);
/// (declarations, connections, chunks, counted)
type IndexFields<'py> = (Vec<(u64, u64)>, Vec<PublisherFields>, Vec<SpanFields<'py>>, bool);

#[pyfunction]
pub fn parse_head(data: PyBackedBytes, size: u64) -> PyResult<HeadFields> {
    let Head { index_position, connections, chunks } =
        tail::parse_head(&data, size).map_err(raised)?;
    Ok((index_position, connections, chunks))
}

#[pyfunction]
pub fn bag_index<'py>(
    py: Python<'py>,
    data: PyBackedBytes,
    head: HeadFields,
) -> PyResult<IndexFields<'py>> {
    let (index_position, connections, chunks) = head;
    let head = Head { index_position, connections, chunks };
    fields(py, py.detach(|| tail::parse_tail(&data, &head)).map_err(raised)?)
}

fn fields(py: Python<'_>, found: Index) -> PyResult<IndexFields<'_>> {
    let connections = found.connections.into_iter().map(|publisher| {
        let Publisher { id, topic, datatype, caller_id, encoding, .. } = publisher;
        let Publisher { in_force, offered_qos, offset, length, .. } = publisher;
        (id, topic, datatype, caller_id, encoding, in_force, offered_qos, offset, length)
    });
    let chunks = found.chunks.into_iter().map(|span| {
        let Span { offset, end, index, compression, start_time, end_time, counts } = span;
        Ok((offset, end, start_time, end_time, dict(py, counts)?, index, compression))
    });
    let chunks = chunks.collect::<PyResult<_>>()?;
    Ok((found.declarations, connections.collect(), chunks, found.counted))
}

#[pyfunction]
pub fn mcap_head(data: PyBackedBytes) -> PyResult<u64> {
    mcap::parse_head(&data).map_err(raised)
}

#[pyfunction]
pub fn mcap_footer(data: PyBackedBytes, size: u64) -> PyResult<(u64, u64)> {
    mcap::parse_footer(&data, size).map_err(raised)
}

#[pyfunction]
pub fn mcap_index(
    py: Python<'_>,
    data: PyBackedBytes,
    base: u64,
    head_end: u64,
    footer: PyBackedBytes,
) -> PyResult<IndexFields<'_>> {
    let found = py.detach(|| mcap::parse_summary(&data, base, head_end, &footer));
    fields(py, found.map_err(raised)?)
}

#[pyfunction]
pub fn mcap_index_times(
    py: Python<'_>,
    data: PyBackedBytes,
    base: u64,
) -> PyResult<Bound<'_, PyDict>> {
    dict(py, py.detach(|| mcap::index_times(&data, base)).map_err(raised)?)
}

#[pyfunction]
pub fn chunk_compression(data: PyBackedBytes, base: u64) -> PyResult<String> {
    tail::chunk_compression(&data, base).map_err(raised)
}

#[pyfunction]
pub fn chunk_length(data: PyBackedBytes, base: u64) -> PyResult<Option<u64>> {
    tail::chunk_length(&data, base).map_err(raised)
}

#[pyfunction]
pub fn index_times(py: Python<'_>, data: PyBackedBytes, base: u64) -> PyResult<Bound<'_, PyDict>> {
    let times = py.detach(|| tail::index_times(&data, base)).map_err(raised)?;
    dict(py, times)
}

#[pyfunction]
pub fn split_record(
    py: Python<'_>,
    data: PyBackedBytes,
    at: usize,
    base: u64,
) -> PyResult<(Bound<'_, PyDict>, usize, usize)> {
    let (fields, begin, end) = tail::split_record(&data, at, base).map_err(raised)?;
    Ok((named(py, fields)?, begin, end))
}

#[pyfunction]
pub fn connection_fields(
    py: Python<'_>,
    record: PyBackedBytes,
    offset: u64,
) -> PyResult<Bound<'_, PyDict>> {
    named(py, tail::connection_fields(&record, offset).map_err(raised)?)
}

/// The last of a name counts, as in the crate.
fn named<'py>(py: Python<'py>, fields: Vec<(&[u8], &[u8])>) -> PyResult<Bound<'py, PyDict>> {
    let text = |(name, value)| (String::from_utf8_lossy(name), PyBytes::new(py, value));
    dict(py, fields.into_iter().map(text))
}

fn dict<'py, K, V>(
    py: Python<'py>,
    pairs: impl IntoIterator<Item = (K, V)>,
) -> PyResult<Bound<'py, PyDict>>
where
    K: IntoPyObject<'py>,
    V: IntoPyObject<'py>,
{
    let dict = PyDict::new(py);
    for (key, value) in pairs {
        dict.set_item(key, value)?;
    }
    Ok(dict)
}
