//! Folders of rosbag2, as a planner and a worker read them from storage.

use std::collections::HashMap;
use std::fs::File;
use std::path::PathBuf;

use bagpipe_log::{Connection, Late, Window};
use bagpipe_mcap::{Latched, Limits, Mcap, WriterOptions};
use bagpipe_rosbag2::{
    Compressed, Database, Rosbag2Error, Selection, Storage, mcap_of_database, metadata, rows,
    uncompress, unpacked,
};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyBytes, PyDict};

use crate::error::bag_error;
use crate::tail::{PublisherFields, TailError};

/// (version, storage, files, what is compressed, messages, topics)
type MetadataFields = (u64, &'static str, Vec<String>, &'static str, u64, Vec<TopicFields>);
/// (topic, type, encoding, messages)
type TopicFields = (String, String, String, u64);
/// (start time, end time, counts, the time of each message)
type StretchFields<'py> = (u64, u64, Bound<'py, PyDict>, Bound<'py, PyBytes>);

fn refused(error: &Rosbag2Error) -> PyErr {
    TailError::new_err(("BagUnreadable", error.to_string()))
}

#[pyfunction]
pub fn rosbag2_metadata(text: PyBackedBytes) -> PyResult<MetadataFields> {
    let found = metadata(&text).map_err(|error| refused(&error))?;
    let storage = match found.storage {
        Storage::Mcap => "mcap",
        Storage::Sqlite3 => "sqlite3",
    };
    let compressed = match found.compressed {
        None => "none",
        Some(Compressed::File) => "file",
        Some(Compressed::Message) => "message",
    };
    let topics = found.topics.into_iter();
    let topics = topics.map(|each| (each.topic, each.datatype, each.encoding, each.messages));
    Ok((found.version, storage, found.files, compressed, found.messages, topics.collect()))
}

/// What a file of SQLite holds, and when it was recorded; the time of each message where there are
/// at most `most_times`, in the machine's own order of bytes.
#[pyfunction]
pub fn database_rows<'py>(
    py: Python<'py>,
    path: PathBuf,
    text: PyBackedBytes,
    most_times: u64,
) -> PyResult<(Vec<PublisherFields>, Vec<StretchFields<'py>>)> {
    let found = py.detach(|| rows(&Database::open(&path)?, &metadata(&text)?.topics, most_times));
    let found = found.map_err(|error| refused(&error))?;
    let publisher = |each: Connection| {
        let encoding = each.message_encoding.name().to_owned();
        let in_force = each.in_force();
        let qos = each.offered_qos.unwrap_or_default();
        (each.id, each.topic, each.datatype, String::new(), encoding, in_force, qos, 0, 0)
    };
    let stretch = |each: bagpipe_rosbag2::Stretch| {
        let counts = PyDict::new(py);
        for (connection, count) in each.counts {
            counts.set_item(connection, count)?;
        }
        let times: Vec<u8> = each.each.iter().flat_map(|time| time.to_ne_bytes()).collect();
        Ok((each.times.0, each.times.1, counts, PyBytes::new(py, &times)))
    };
    let stretches = found.stretches.into_iter().map(stretch).collect::<PyResult<_>>()?;
    Ok((found.connections.into_iter().map(publisher).collect(), stretches))
}

/// Uncompresses a file into one that is not there yet; returns its length.
#[pyfunction]
pub fn uncompress_file(py: Python<'_>, from: PathBuf, to: PathBuf, most: u64) -> PyResult<u64> {
    let done = py.detach(|| uncompress(File::open(&from)?, &mut File::create_new(&to)?, most));
    done.map_err(|error| refused(&error))
}

/// A file of a folder: the bytes of MCAP, or where a file of SQLite or MCAP is.
#[derive(FromPyObject)]
pub enum Source {
    Bytes(PyBackedBytes),
    File(PathBuf),
}

/// One stream of MCAP of files that follow each other: the messages of topics (none: of all) with
/// `start` <= t < `end`, in ns, and what is latched and in force before, at its own time. `late` has
/// of a topic whether it latches and how many late subscribers get, where the recording does not
/// decide that.
#[pyfunction]
#[pyo3(signature = (files, text, start, end, topics, *, late, memory))]
#[allow(clippy::too_many_arguments)] // as Python names them
pub fn joined_mcap<'py>(
    py: Python<'py>,
    files: Vec<Source>,
    text: PyBackedBytes,
    start: u64,
    end: u64,
    topics: Vec<String>,
    late: HashMap<String, (Option<bool>, Option<u32>)>,
    memory: u64,
) -> PyResult<Bound<'py, PyBytes>> {
    let window = Window { start, end };
    let bytes = py.detach(|| {
        let about = metadata(&text)?;
        let bare = |topic: &str| topic.strip_prefix('/').unwrap_or(topic).to_owned();
        let named: Vec<String> = topics.iter().map(|topic| bare(topic)).collect();
        let wanted = |topic: &str| named.is_empty() || named.contains(&bare(topic));
        let late: HashMap<String, Late> = late
            .into_iter()
            .map(|(topic, (latching, depth))| (bare(&topic), Late { latching, depth }))
            .collect();
        let late = |topic: &str| late.get(&bare(topic)).copied().unwrap_or_default();
        let compressed = about.compressed == Some(Compressed::Message);
        let selection =
            Selection { window, topics: &wanted, about: &about.topics, compressed, late: &late };
        let mut opened = Vec::with_capacity(files.len());
        for file in files {
            opened.push(mcap_of(file, about.storage, &selection, memory)?);
        }
        let of = |each: &Connection| wanted(&each.topic);
        let profile = "ros2".to_owned();
        let options = WriterOptions { profile, ..WriterOptions::default() };
        let in_force = |each: &Connection| late(&each.topic).in_force(each.in_force());
        let latched = Latched { as_recorded: true, in_force: &in_force };
        let made = bagpipe_mcap::slice(&opened, window, latched, of, options)?;
        Ok::<_, Rosbag2Error>(made.bytes)
    });
    let bytes = bytes.map_err(|error| bag_error(None, &error.to_string()))?;
    Ok(PyBytes::new(py, &bytes))
}

fn mcap_of(
    file: Source,
    storage: Storage,
    selection: &Selection<'_>,
    memory: u64,
) -> Result<Mcap, Rosbag2Error> {
    let limits = Limits { decompressed_bytes: memory };
    let bytes = match (file, storage) {
        (Source::Bytes(bytes), _) => bytes.to_vec(),
        (Source::File(path), Storage::Mcap) => std::fs::read(path)?,
        (Source::File(path), Storage::Sqlite3) => {
            let bytes = mcap_of_database(&Database::open(&path)?, selection, memory)?;
            return Ok(Mcap::open_limited(bytes, limits)?);
        }
    };
    let opened = Mcap::open_limited(bytes, limits)?;
    if let Some(loss) = opened.loss() {
        let (offset, expected) = (loss.offset, loss.description.clone());
        return Err(bagpipe_mcap::McapError::Damaged { offset, expected }.into());
    }
    if selection.compressed {
        return Ok(Mcap::open_limited(unpacked(&opened, memory)?, limits)?);
    }
    Ok(opened)
}
