//! What is in a recording, as a table.

use std::collections::BTreeMap;
use std::path::Path;

use bagpipe_formats::{Kind, Recordings, described};
use bagpipe_log::Loss;
use bagpipe_rosbag::{Bag, ChunkedFile};
use bagpipe_rosbag2::{Compressed, Storage};

use crate::verbs::bagfile::{Memory, file, kind, loss};

/// Prints the recording's times, sizes and topics.
pub fn info(path: &Path, memory: Memory) -> Result<(), String> {
    let text = match kind(path)? {
        Kind::Bag => describe(path, &memory.open(path, file(path)?)?),
        _ => of_recordings(path, &memory.recordings(path)?),
    };
    print!("{text}");
    Ok(())
}

fn of_recordings(path: &Path, recordings: &Recordings) -> String {
    let found = described(recordings);
    let chunks: usize = found.chunks.values().sum();
    let mut lines = vec![
        format!("path       {}", path.display()),
        format!("format     {}", format_of(recordings)),
        format!("size       {} bytes in {chunks} chunks", found.bytes),
    ];
    lines.extend(times(found.times));
    let names: Vec<String> =
        found.chunks.iter().map(|(name, count)| format!("{name} ({count} chunks)")).collect();
    lines.push(format!("compressed {}", names.join(", ")));
    lines.push(format!("messages   {}", found.messages));
    let (attachments, metadata) = found.surroundings;
    lines.push(format!("beside     {attachments} attachments, {metadata} metadata records"));
    lines.extend(recordings.loss().map(damaged));
    lines.push(String::new());
    let topics = found.topics.iter();
    lines.extend(table(topics.map(|each| {
        (&*each.topic, each.messages, format!("{}  {}", each.datatype, each.encoding))
    })));
    lines.join("\n") + "\n"
}

/// What it is; all but a file of MCAP was made MCAP to be read, whose size it states.
fn format_of(recordings: &Recordings) -> String {
    let Some(metadata) = &recordings.metadata else { return "MCAP".to_owned() };
    let storage = match metadata.storage {
        Storage::Mcap => "MCAP",
        Storage::Sqlite3 => "SQLite",
    };
    let compressed = match metadata.compressed {
        Some(Compressed::File) => ", compressed as a whole",
        Some(Compressed::Message) => ", messages compressed",
        None => "",
    };
    let (version, files) = (metadata.version, metadata.files.len());
    format!("rosbag2 (version {version}), {files} files of {storage}{compressed}")
}

fn times(times: Option<(u64, u64)>) -> Vec<String> {
    let Some((start, end)) = times else { return Vec::new() };
    let seconds = |time: u64| format!("{}.{:09}", time / NANO, time % NANO);
    vec![
        format!("time       {} to {}", seconds(start), seconds(end)),
        format!("duration   {} s", seconds(end - start)),
    ]
}

fn damaged(lost: &Loss) -> String {
    loss(lost).replacen("damaged ", "damaged    ", 1)
}

fn describe(path: &Path, bag: &Bag<impl ChunkedFile>) -> String {
    let mut lines = vec![
        format!("path       {}", path.display()),
        format!("format     {}", bag.format()),
        format!("size       {} bytes in {} chunks", bag.file().len(), bag.chunks().len()),
    ];
    lines.extend(times(bag.time_range()));
    let mut chunks: BTreeMap<&str, usize> = BTreeMap::new();
    for chunk in bag.chunks() {
        *chunks.entry(chunk.compression.name()).or_default() += 1;
    }
    let names: Vec<String> =
        chunks.iter().map(|(name, count)| format!("{name} ({count} chunks)")).collect();
    lines.push(format!("compressed {}", names.join(", ")));
    lines.push(format!("messages   {}", bag.message_count()));
    lines.extend(bag.loss().map(damaged));
    lines.push(String::new());
    lines.extend(topics(bag));
    lines.join("\n") + "\n"
}

const NANO: u64 = 1_000_000_000;

fn topics(bag: &Bag<impl ChunkedFile>) -> Vec<String> {
    let mut counts: BTreeMap<u32, u64> = BTreeMap::new();
    for (connection, count) in bag.chunks().iter().flat_map(|chunk| &chunk.counts) {
        *counts.entry(*connection).or_default() += u64::from(*count);
    }
    let mut rows: BTreeMap<(&str, &str), u64> = BTreeMap::new();
    for connection in bag.connections() {
        let count = counts.get(&connection.id).copied().unwrap_or(0);
        *rows.entry((&connection.topic, &connection.datatype)).or_default() += count;
    }
    table(rows.into_iter().map(|((topic, datatype), count)| (topic, count, datatype.to_owned())))
}

/// Topics, their messages, and their types.
fn table<'a>(rows: impl Iterator<Item = (&'a str, u64, String)>) -> Vec<String> {
    let rows: Vec<_> = rows.collect();
    let width = rows.iter().map(|(topic, ..)| topic.len()).max().unwrap_or(0).max(5);
    let head = format!("{:<width$}  {:>10}  TYPE", "TOPIC", "MESSAGES");
    let row = |(topic, count, datatype)| format!("{topic:<width$}  {count:>10}  {datatype}");
    std::iter::once(head).chain(rows.into_iter().map(row)).collect()
}
