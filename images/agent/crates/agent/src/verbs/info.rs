//! What is in a bag, as a table.

use std::collections::BTreeMap;
use std::path::Path;

use bagpipe_rosbag::{Bag, ChunkedFile};

use crate::verbs::bagfile::{Memory, file};

/// Prints the bag's times, sizes and topics.
pub fn info(path: &Path, memory: Memory) -> Result<(), String> {
    let bag = memory.open(path, file(path)?)?;
    print!("{}", describe(path, &bag));
    Ok(())
}

fn describe(path: &Path, bag: &Bag<impl ChunkedFile>) -> String {
    let mut lines = vec![
        format!("path       {}", path.display()),
        format!("format     {}", bag.format()),
        format!("size       {} bytes in {} chunks", bag.file().len(), bag.chunks().len()),
    ];
    if let Some((start, end)) = bag.time_range() {
        let seconds = |time: u64| format!("{}.{:09}", time / NANO, time % NANO);
        lines.push(format!("time       {} to {}", seconds(start), seconds(end)));
        lines.push(format!("duration   {} s", seconds(end - start)));
    }
    let mut chunks: BTreeMap<&str, usize> = BTreeMap::new();
    for chunk in bag.chunks() {
        *chunks.entry(chunk.compression.name()).or_default() += 1;
    }
    let names: Vec<String> =
        chunks.iter().map(|(name, count)| format!("{name} ({count} chunks)")).collect();
    lines.push(format!("compressed {}", names.join(", ")));
    lines.push(format!("messages   {}", bag.message_count()));
    if let Some(loss) = bag.loss() {
        lines.push(crate::verbs::bagfile::loss(loss).replacen("damaged ", "damaged    ", 1));
    }
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
    let width = rows.keys().map(|(topic, _)| topic.len()).max().unwrap_or(0).max(5);
    let head = format!("{:<width$}  {:>10}  TYPE", "TOPIC", "MESSAGES");
    let row = |((topic, datatype), count)| format!("{topic:<width$}  {count:>10}  {datatype}");
    std::iter::once(head).chain(rows.into_iter().map(row)).collect()
}
