//! Recordings of every format, as `bagpipe bag` works on files of this machine.

use std::path::{Path, PathBuf};

use bagpipe_formats::{
    Converted, Described, FormatError, Kind, Packing, Recordings, Target, bag_into, converted,
    described, kind_of,
};
use bagpipe_log::{Connection, Window};
use bagpipe_rosbag::{Bag, DiskChunkedFile, Limits};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::error::bag_error;
use crate::model::{Checked, Damage};

/// What was written, how many messages are in it, and what was lost.
type Written<'py> = (Bound<'py, PyBytes>, u64, Option<Damage>);

fn raised(path: &Path, error: &FormatError) -> PyErr {
    let advice = if error.over_memory() { "; --memory-budget allows more" } else { "" };
    bag_error(Some(&path.display().to_string()), &format!("{error}{advice}"))
}

fn packing(name: &str) -> PyResult<Packing> {
    Packing::from_name(name).ok_or_else(|| {
        bag_error(None, &format!("the compression is {name:?}; it can be none, lz4, bz2 or zstd"))
    })
}

fn bag(path: &Path, memory: u64) -> Result<Bag<DiskChunkedFile>, FormatError> {
    let limits = Limits { decompressed_bytes: memory };
    Ok(Bag::open_limited(DiskChunkedFile::open(path)?, limits)?)
}

/// Damage is an error, because a part of a part would look whole.
fn whole(path: &Path, memory: u64) -> Result<Recordings, FormatError> {
    let recordings = Recordings::open(path, memory)?;
    match recordings.loss() {
        None => Ok(recordings),
        Some(loss) => Err(FormatError::Refused(format!(
            "byte {}: expected {}; it is damaged: `bagpipe bag reindex` saves what is whole",
            loss.offset, loss.description
        ))),
    }
}

/// `bag`, `mcap`, `database` or `folder`, by a file's first bytes or as a folder is there.
#[pyfunction]
pub fn recording_kind(path: PathBuf) -> PyResult<&'static str> {
    Ok(match kind_of(&path)? {
        Kind::Bag => "bag",
        Kind::Mcap => "mcap",
        Kind::Database => "database",
        Kind::Folder => "folder",
    })
}

/// What is in a recording that is no bag, as a dictionary.
#[pyfunction]
pub fn describe_recording<'py>(
    py: Python<'py>,
    path: PathBuf,
    memory: u64,
) -> PyResult<Bound<'py, PyDict>> {
    let found = py.detach(|| {
        let recordings = Recordings::open(&path, memory)?;
        Ok((described(&recordings), recordings.loss().map(Damage::from)))
    });
    let (found, damage) = found.map_err(|error| raised(&path, &error))?;
    let Described { files, bytes, times, messages, chunks, topics, .. } = found;
    let dict = PyDict::new(py);
    dict.set_item("files", files)?;
    dict.set_item("bytes", bytes)?;
    dict.set_item("times", times)?;
    dict.set_item("messages", messages)?;
    dict.set_item("chunks", chunks.values().sum::<usize>())?;
    dict.set_item("compressions", chunks.keys().copied().collect::<Vec<_>>())?;
    let row =
        |each: bagpipe_formats::Topic| (each.topic, each.datatype, each.encoding, each.messages);
    dict.set_item("topics", topics.into_iter().map(row).collect::<Vec<_>>())?;
    dict.set_item("damage", damage)?;
    Ok(dict)
}

/// Whether a recording that is no bag is what it says that it is.
#[pyfunction]
pub fn check_recording(py: Python<'_>, path: PathBuf, memory: u64) -> PyResult<Checked> {
    let found = py.detach(|| Recordings::check(&path, memory));
    found.map(Checked::from).map_err(|error| raised(&path, &error))
}

/// The messages of topics (None: of all) with `start` <= t < `end`, in ns, as MCAP; what was
/// latched then before them.
#[pyfunction]
#[pyo3(signature = (path, start, end, topics, *, compression, memory))]
pub fn slice_recording<'py>(
    py: Python<'py>,
    path: PathBuf,
    start: u64,
    end: u64,
    topics: Option<Vec<String>>,
    compression: &str,
    memory: u64,
) -> PyResult<Written<'py>> {
    let packing = packing(compression)?;
    let made = py.detach(|| {
        let wanted =
            |each: &Connection| topics.as_ref().is_none_or(|topics| topics.contains(&each.topic));
        whole(&path, memory)?.slice(Window { start, end }, wanted, packing.of_mcap()?)
    });
    let made = made.map_err(|error| raised(&path, &error))?;
    Ok((PyBytes::new(py, &made.bytes), made.messages + made.latched, None))
}

/// Recordings that are no bags, as one of MCAP.
#[pyfunction]
#[pyo3(signature = (paths, *, compression, memory))]
pub fn merge_recordings<'py>(
    py: Python<'py>,
    paths: Vec<PathBuf>,
    compression: &str,
    memory: u64,
) -> PyResult<Written<'py>> {
    let packing = packing(compression)?;
    let mut all = Vec::with_capacity(paths.len());
    for path in &paths {
        let read = py.detach(|| whole(path, memory));
        all.push(read.map_err(|error| raised(path, &error))?);
    }
    let made = py.detach(|| Recordings::merge(&all, packing.of_mcap()?));
    let bytes = made.map_err(|error| bag_error(None, &error.to_string()))?;
    let messages = all.iter().map(Recordings::message_count).sum();
    Ok((PyBytes::new(py, &bytes), messages, None))
}

/// What is whole of a recording of any format, with an index: a bag as a bag, all else as MCAP.
#[pyfunction]
#[pyo3(signature = (path, *, compression, memory))]
pub fn mend_recording<'py>(
    py: Python<'py>,
    path: PathBuf,
    compression: &str,
    memory: u64,
) -> PyResult<Written<'py>> {
    let packing = packing(compression)?;
    let made = py.detach(|| {
        if kind_of(&path)? == Kind::Bag {
            let limits = Limits { decompressed_bytes: memory };
            let file = DiskChunkedFile::open(&path)?;
            let made = bagpipe_rosbag::reindex_limited(file, packing.of_bag()?, limits)?;
            return Ok((made.bytes, made.messages, made.loss));
        }
        let old = Recordings::scanned(&path, memory)?;
        let bytes = old.rewritten(packing.of_mcap()?)?;
        Ok((bytes, old.message_count(), old.loss().cloned()))
    });
    let (bytes, messages, loss) = made.map_err(|error| raised(&path, &error))?;
    Ok((PyBytes::new(py, &bytes), messages, loss.as_ref().map(Damage::from)))
}

/// A recording of any format as one of another: `target` is a name that ends in .bag or .mcap.
#[pyfunction]
#[pyo3(signature = (path, target, *, compression, memory))]
pub fn convert_recording<'py>(
    py: Python<'py>,
    path: PathBuf,
    target: &str,
    compression: &str,
    memory: u64,
) -> PyResult<Written<'py>> {
    let packing = packing(compression)?;
    let made = py.detach(|| {
        let target = Target::of_name(target)?;
        if kind_of(&path)? != Kind::Bag {
            return converted(&whole(&path, memory)?, target, packing);
        }
        let bag = bag(&path, memory)?;
        match bag.loss() {
            None => bag_into(&bag, target, packing),
            Some(loss) => Err(FormatError::Refused(format!(
                "byte {}: expected {}; it is damaged: `bagpipe bag reindex` saves what is whole",
                loss.offset, loss.description
            ))),
        }
    });
    let Converted { bytes, messages } = made.map_err(|error| raised(&path, &error))?;
    Ok((PyBytes::new(py, &bytes), messages, None))
}
