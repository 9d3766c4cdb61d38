//! `metadata.yaml`: which files make a recording, in which order, and how they are stored.

use std::collections::BTreeSet;

use crate::Rosbag2Error;
use crate::yaml::{Node, document};

/// A `metadata.yaml` may be as long; rosbag2 writes about a kilobyte for each topic.
pub const MOST_METADATA_BYTES: u64 = 4 << 20;
/// Foxy writes 4, Rolling 9.
const VERSIONS: std::ops::RangeInclusive<u64> = 4..=9;

/// What the files are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Storage {
    /// MCAP.
    Mcap,
    /// SQLite.
    Sqlite3,
}

/// What was compressed after it was stored, or before; always by Zstandard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Compressed {
    /// Each file as a whole: it must be uncompressed before a byte of it is known.
    File,
    /// Each message alone.
    Message,
}

/// What the recorder counted of one topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicCount {
    /// Its name.
    pub topic: String,
    /// Its type.
    pub datatype: String,
    /// What its messages' bytes are, such as `cdr`.
    pub encoding: String,
    /// The publishers' quality of service, as the recorder wrote it into one string.
    pub offered_qos: String,
    /// Messages, in all files.
    pub messages: u64,
}

/// What `metadata.yaml` says.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Metadata {
    /// Of the text's form, 4 to 9.
    pub version: u64,
    /// What the files are.
    pub storage: Storage,
    /// The files in the recording's order, below the folder, with `/` between names.
    pub files: Vec<String>,
    /// What was compressed, if anything.
    pub compressed: Option<Compressed>,
    /// Messages, in all files.
    pub messages: u64,
    /// All topics.
    pub topics: Vec<TopicCount>,
}

/// Reads the text of a `metadata.yaml`.
///
/// # Errors
/// [`Rosbag2Error::Metadata`], also for a text above [`MOST_METADATA_BYTES`], for a storage or a
/// compression that is not known, and for a path that leads out of the folder.
pub fn metadata(text: &[u8]) -> Result<Metadata, Rosbag2Error> {
    if text.len() as u64 > MOST_METADATA_BYTES {
        let expected = format!("at most {MOST_METADATA_BYTES} bytes, found {}", text.len());
        return Err(Rosbag2Error::metadata(0, expected));
    }
    let text = std::str::from_utf8(text)
        .map_err(|error| Rosbag2Error::metadata(0, format!("UTF-8 ({error})")))?;
    let root = document(text)?;
    let about = needed(&root, "rosbag2_bagfile_information")?;
    let version = number(needed(about, "version")?)?;
    if !VERSIONS.contains(&version) {
        let line = needed(about, "version")?.line;
        return Err(Rosbag2Error::metadata(line, format!("a version of 4 to 9, found {version}")));
    }
    Ok(Metadata {
        version,
        storage: storage(needed(about, "storage_identifier")?)?,
        files: files(needed(about, "relative_file_paths")?)?,
        compressed: compressed(about)?,
        messages: about.get("message_count").map_or(Ok(0), number)?,
        topics: topics(about)?,
    })
}

fn needed<'n>(node: &'n Node, key: &str) -> Result<&'n Node, Rosbag2Error> {
    node.get(key).ok_or_else(|| Rosbag2Error::metadata(node.line, format!("the key {key}")))
}

fn text(node: &Node) -> Result<&str, Rosbag2Error> {
    node.text().ok_or_else(|| Rosbag2Error::metadata(node.line, "one word or text"))
}

fn number(node: &Node) -> Result<u64, Rosbag2Error> {
    let found = text(node)?;
    let wrong = || format!("a number of at least 0, found {found:?}");
    found.parse().map_err(|_| Rosbag2Error::metadata(node.line, wrong()))
}

fn storage(node: &Node) -> Result<Storage, Rosbag2Error> {
    match text(node)? {
        "mcap" => Ok(Storage::Mcap),
        "sqlite3" => Ok(Storage::Sqlite3),
        other => {
            let expected = format!("the storage mcap or sqlite3, found {other:?}");
            Err(Rosbag2Error::metadata(node.line, expected))
        }
    }
}

fn files(node: &Node) -> Result<Vec<String>, Rosbag2Error> {
    let paths = node.list().unwrap_or_default();
    let mut seen = BTreeSet::new();
    for path in paths {
        let found = text(path)?;
        if !is_below(found) {
            let expected = format!("the path of a file below the folder, found {found:?}");
            return Err(Rosbag2Error::metadata(path.line, expected));
        }
        if !seen.insert(found) {
            let expected = format!("each file once, found {found} again");
            return Err(Rosbag2Error::metadata(path.line, expected));
        }
    }
    if paths.is_empty() {
        return Err(Rosbag2Error::metadata(node.line, "one file or more in relative_file_paths"));
    }
    paths.iter().map(|path| text(path).map(str::to_owned)).collect()
}

/// Whether a path stays in the folder whatever is there, on storage as on a disk.
fn is_below(path: &str) -> bool {
    let plain = |name: &str| !matches!(name, "" | "." | "..");
    let letters = |letter: char| !letter.is_control() && !matches!(letter, '\\' | '?' | '#' | '*');
    path.split('/').all(plain) && path.chars().all(letters)
}

fn compressed(about: &Node) -> Result<Option<Compressed>, Rosbag2Error> {
    let word = |key: &str| about.get(key).map_or(Ok(""), text).map(str::to_ascii_lowercase);
    let line = about.get("compression_mode").map_or(about.line, |node| node.line);
    let mode = match word("compression_mode")?.as_str() {
        "" | "none" => return Ok(None),
        "file" => Compressed::File,
        "message" => Compressed::Message,
        other => {
            let expected = format!("the compression_mode file or message, found {other:?}");
            return Err(Rosbag2Error::metadata(line, expected));
        }
    };
    match word("compression_format")?.as_str() {
        "zstd" => Ok(Some(mode)),
        other => {
            let expected = format!("the compression_format zstd, found {other:?}");
            Err(Rosbag2Error::metadata(line, expected))
        }
    }
}

fn topics(about: &Node) -> Result<Vec<TopicCount>, Rosbag2Error> {
    let Some(node) = about.get("topics_with_message_count") else { return Ok(Vec::new()) };
    let listed = node.list().unwrap_or_default();
    listed.iter().map(topic).collect()
}

fn topic(node: &Node) -> Result<TopicCount, Rosbag2Error> {
    let of = needed(node, "topic_metadata")?;
    let word = |key: &str| of.get(key).map_or(Ok(""), text).map(str::to_owned);
    // One string until version 8, and the lists and maps themselves from 9 on.
    let offered_qos = match of.get("offered_qos_profiles") {
        Some(profiles) if profiles.text().is_none() => {
            let mut written = String::new();
            profiles.write(0, &mut written);
            written
        }
        _ => word("offered_qos_profiles")?,
    };
    Ok(TopicCount {
        topic: text(needed(of, "name")?)?.to_owned(),
        datatype: word("type")?,
        encoding: word("serialization_format")?,
        offered_qos,
        messages: node.get("message_count").map_or(Ok(0), number)?,
    })
}
