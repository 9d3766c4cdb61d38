//! A folder's files, each as MCAP in memory.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::Path;

use bagpipe_mcap::{Limits, Mcap, McapError, McapWriter, Stamp, WriterOptions};
use rusqlite::types::ValueRef;

use crate::channel::{channel, schema};
use crate::in_force::rows_in_force;
use crate::rows::{time, unknown};
use crate::sqlite::{Topic, integer};
use crate::{
    Compressed, Database, MOST_METADATA_BYTES, Metadata, Rosbag2Error, Selection, Storage,
    compressed, metadata, uncompress, unpacked,
};

/// The name of the file that makes a folder a recording.
pub const METADATA: &str = "metadata.yaml";

/// A folder that was read.
#[derive(Debug)]
pub struct Folder {
    /// What `metadata.yaml` says.
    pub metadata: Metadata,
    /// Its files, in their order.
    pub files: Vec<Mcap>,
}

/// How files are read.
#[derive(Debug, Clone, Copy)]
pub struct Reading {
    /// How many bytes of memory may be taken for all files together, and again for what each of
    /// them holds compressed.
    pub memory: u64,
    /// Whether every chunk of MCAP is uncompressed at once, so that all damage is known.
    pub scanned: bool,
}

impl Reading {
    /// Opens MCAP.
    ///
    /// # Errors
    /// As [`Mcap::open_limited`].
    pub fn open(self, bytes: Vec<u8>) -> Result<Mcap, McapError> {
        let limits = Limits { decompressed_bytes: self.memory };
        let open = if self.scanned { Mcap::open_scanned } else { Mcap::open_limited };
        open(bytes, limits)
    }
}

impl Folder {
    /// Reads all files of the folder into memory.
    ///
    /// # Errors
    /// [`Rosbag2Error::File`] with the file's name; of `metadata.yaml` those of [`metadata`].
    pub fn open(folder: &Path, how: Reading) -> Result<Self, Rosbag2Error> {
        let about = folder.join(METADATA);
        let named = |error: std::io::Error| Rosbag2Error::System(error).of(METADATA);
        let mut text = Vec::new();
        let file = File::open(&about).map_err(named)?;
        file.take(MOST_METADATA_BYTES + 1).read_to_end(&mut text).map_err(named)?;
        let metadata = metadata(&text)?;
        let (mut files, mut left) = (Vec::new(), how.memory);
        for name in &metadata.files {
            let how = Reading { memory: left, ..how };
            let file = read(&folder.join(name), &metadata, how).map_err(|error| error.of(name))?;
            left = left.saturating_sub(file.file_size());
            files.push(file);
        }
        Ok(Self { metadata, files })
    }
}

/// One file of a folder, whole.
fn read(path: &Path, about: &Metadata, how: Reading) -> Result<Mcap, Rosbag2Error> {
    let memory = how.memory;
    let whole = about.compressed == Some(Compressed::File);
    let messages = about.compressed == Some(Compressed::Message);
    let bytes = match about.storage {
        Storage::Mcap => {
            let bytes = if whole { inflated(path, memory)? } else { plain(path, memory)? };
            if !messages {
                return Ok(how.open(bytes)?);
            }
            unpacked(&how.open(bytes)?, memory)?
        }
        Storage::Sqlite3 => {
            let database = if whole {
                let bytes = inflated(path, memory)?;
                Database::in_memory(&bytes[..], bytes.len())?
            } else {
                Database::open(path)?
            };
            let selection = Selection {
                about: &about.topics,
                compressed: messages,
                ..Selection::all(&|_| true)
            };
            mcap_of_database(&database, &selection, memory)?
        }
    };
    Ok(how.open(bytes)?)
}

fn plain(path: &Path, memory: u64) -> Result<Vec<u8>, Rosbag2Error> {
    let size = std::fs::metadata(path)?.len();
    if size > memory {
        let what = format!("the file of {size} bytes");
        return Err(Rosbag2Error::MemoryLimit { what, allowed: memory });
    }
    Ok(std::fs::read(path)?)
}

fn inflated(path: &Path, memory: u64) -> Result<Vec<u8>, Rosbag2Error> {
    let mut bytes = Vec::new();
    uncompress(File::open(path)?, &mut bytes, memory)?;
    Ok(bytes)
}

/// Messages of a file of SQLite as MCAP, in the order of the table, in at most `memory` bytes.
///
/// # Errors
/// [`Rosbag2Error::Sqlite`], [`Rosbag2Error::Database`], [`Rosbag2Error::Mcap`] also where it takes
/// more memory.
pub fn mcap_of_database(
    database: &Database,
    selection: &Selection<'_>,
    memory: u64,
) -> Result<Vec<u8>, Rosbag2Error> {
    let profile = "ros2".to_owned();
    let options = WriterOptions { profile, byte_budget: Some(memory), ..WriterOptions::default() };
    // In a buffer of our own, because a budget is reserved otherwise.
    let mut writer = McapWriter::with_buffer(options, Vec::new());
    let topics = database.topics(selection.about)?;
    let known = channels(database, &topics, selection, &mut writer)?;
    let in_force = rows_in_force(database, &topics, selection)?;
    let window = selection.window;
    let mut found =
        database.prepare("SELECT topic_id, timestamp, data FROM messages NOT INDEXED")?;
    let (mut rows, mut left) = (found.query([])?, database.left("messages"));
    let (mut count, mut uncompressed) = (0, Vec::new());
    while let Some(row) = rows.next()? {
        count += 1;
        left.take(row)?;
        let topic = integer(row, 0, "messages")?;
        let time = time(integer(row, 1, "messages")?, count)?;
        let of = known.get(&topic).ok_or_else(|| unknown(topic, count))?;
        let Some(id) = of else { continue };
        if !window.contains(time) && !in_force.contains(&count) {
            continue;
        }
        let data = match row.get_ref(2)? {
            ValueRef::Blob(data) => data,
            other => {
                let (table, found) = (format!("messages, row {count}"), other.data_type());
                let expected = format!("a message's bytes, found {found:?}");
                return Err(Rosbag2Error::Database { table, expected });
            }
        };
        let data = if selection.compressed {
            let what = || format!("messages, row {count}");
            compressed::message(data, memory, &mut uncompressed, what)?;
            &uncompressed
        } else {
            data
        };
        writer.write_stamped(*id, time, Stamp { sequence: 0, publish_time: time }, data)?;
    }
    Ok(writer.finish()?)
}

/// All topics of a file by their numbers; of those that are wanted the channel.
fn channels(
    database: &Database,
    topics: &[Topic],
    selection: &Selection<'_>,
    writer: &mut McapWriter,
) -> Result<BTreeMap<i64, Option<u32>>, Rosbag2Error> {
    let definitions = database.definitions()?;
    let mut types: HashMap<&str, usize> = HashMap::new();
    let found = topics.iter().map(|topic| {
        let wanted = (selection.topics)(&topic.name).then(|| {
            let of = types.entry(&topic.datatype).or_insert_with(|| {
                writer.add_schema(&schema(&topic.datatype, definitions.get(&topic.datatype)))
            });
            writer.add_channel_of(Some(*of), &channel(topic))
        });
        (topic.id, wanted)
    });
    Ok(found.collect())
}
