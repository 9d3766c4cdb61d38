//! Reading a bag from the front, for want of an index: keeps every whole message.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::bag::chunk_header;
use crate::chunk::{ChunkRecord, ChunkWalk};
use crate::record::{
    Fields, FileRecord, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_INDEX, connection, read_bytes,
};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Compression, Loss};

/// Fills the bag from the records at `first` and after. `damage` is what was wrong with the
/// index, if that is why the bag is scanned.
pub(crate) fn scan<F: ChunkedFile>(
    mut bag: Bag<F>,
    first: u64,
    damage: Option<BagError>,
) -> Result<Bag<F>, BagError> {
    let mut at = first;
    let end = bag.file.len();
    let mut tally = Tally::default();
    if at > end {
        note_damage(&mut bag, end, at - end, "the rest of the file header record");
        tally.unknown = true;
    }
    while at < end {
        match scan_record(&mut bag, at, &mut tally) {
            Ok(next) => at = next,
            Err(error @ (BagError::MemoryLimit { .. } | BagError::Io { .. })) => return Err(error),
            Err(error) => {
                // Without this record's length, nothing says where the next one begins.
                let offset = error.offset().unwrap_or(at);
                note_damage(&mut bag, offset, end - at, &expectation(&error));
                tally.unknown = true;
                break;
            }
        }
    }
    tally.settle(&bag);
    if let (None, Some(error)) = (&bag.loss, damage) {
        // All messages are there; the index that should say so is not.
        let offset = error.offset().unwrap_or(first);
        note_damage(&mut bag, offset, end.abs_diff(offset).max(1), &expectation(&error));
    }
    if let Some(loss) = &mut bag.loss {
        loss.messages = (!tally.unknown).then_some(tally.lost);
    }
    Ok(bag)
}

/// Counts lost messages: the INDEX records behind a damaged chunk say how many it had.
#[derive(Default)]
struct Tally {
    /// Messages that the INDEX records since the last chunk promise.
    promised: u64,
    damaged: bool,
    lost: u64,
    /// True when something was lost that no record counts.
    unknown: bool,
}

impl Tally {
    /// Closes the account of the last chunk.
    fn settle<F: ChunkedFile>(&mut self, bag: &Bag<F>) {
        if self.damaged {
            let kept = bag.chunks.last().map_or(0, ChunkInfo::messages);
            self.unknown |= self.promised == 0;
            self.lost += self.promised.saturating_sub(kept);
        }
        (self.promised, self.damaged) = (0, false);
    }
}

/// Reads one record of the top level and returns where the next begins.
fn scan_record<F: ChunkedFile>(
    bag: &mut Bag<F>,
    at: u64,
    tally: &mut Tally,
) -> Result<u64, BagError> {
    let record = FileRecord::read(&bag.file, at)?;
    let end = record.end();
    match record.op {
        OP_CHUNK => {
            let (compression, size) = chunk_header(&record)?;
            let place = (record.data_position, record.data_length);
            tally.settle(bag);
            tally.damaged = scan_chunk(bag, at, place, (compression, size))?;
        }
        OP_CONNECTION => {
            let data = record.data(&bag.file)?;
            let found =
                connection(&record.header, &data).map_err(|defect| record.in_header(defect))?;
            drop(data);
            bag.add_connection(found);
        }
        OP_INDEX | OP_CHUNK_INFO => {
            if record.end() > bag.file.len() {
                let expected = format!("{} bytes of an index record", record.data_length);
                return Err(BagError::damaged(record.data_position, expected));
            }
            if record.op == OP_INDEX {
                let count = Fields::require_u32(&record.header, "count").unwrap_or(0);
                tally.promised += u64::from(count);
            }
        }
        op => {
            let expected =
                format!("a CHUNK, CONNECTION, INDEX or CHUNK_INFO record, found op {op}");
            return Err(BagError::damaged(record.header_position, expected));
        }
    }
    Ok(end)
}

/// `place` is where the chunk's data begins in the file and how long it says that it is.
/// True when it is damaged.
fn scan_chunk<F: ChunkedFile>(
    bag: &mut Bag<F>,
    position: u64,
    (data_position, declared): (u64, u32),
    (compression, size): (Compression, u32),
) -> Result<bool, BagError> {
    let available = bag.file.len().saturating_sub(data_position);
    let length = available.min(u64::from(declared)) as u32;
    let mut chunk = ChunkInfo {
        position,
        start: u64::MAX,
        end: 0,
        counts: Vec::new(),
        compression,
        data_position,
        data_length: length,
        size,
        usable: 0,
        damaged: false,
    };
    let missing = u64::from(declared - length);
    let (data, mut wrong) =
        load(&bag.file, &chunk, bag.limits.decompressed_bytes, bag.made_bytes())?;
    if missing > 0 {
        let what = format!("{declared} bytes of a chunk's data, found the file's end");
        wrong = Some(what);
    }
    let (walked, defect) = walk(bag, &mut chunk, &data);
    // Uncompressed data's offsets are the file's own; others can only name the chunk's data.
    let in_file = |inside: u64| match compression {
        Compression::None => data_position + inside,
        _ => data_position,
    };
    let damage = match (wrong, defect) {
        (Some(expected), _) if missing > 0 => Some((bag.file.len(), expected)),
        (Some(expected), _) => Some((data_position, expected)),
        (None, Some((inside, expected))) => Some((in_file(inside), expected)),
        (None, None) => None,
    };
    // What can be read again without this scan's work is not kept.
    let keep = match data {
        Cow::Owned(made) if bag.file.slice(position, 4).is_some() => Some(made),
        _ => None,
    };
    for connection in walked {
        bag.add_connection(connection);
    }
    chunk.damaged = damage.is_some();
    let damaged = chunk.damaged;
    if let Some((offset, expected)) = damage {
        let lost = u64::from(size.saturating_sub(chunk.usable)).max(missing).max(1);
        note_damage(bag, offset, lost, &expected);
    }
    bag.add_chunk(chunk, keep);
    Ok(damaged)
}

/// Bytes, and what was wrong with what they were made of.
type Loaded<'a> = (Cow<'a, [u8]>, Option<String>);

/// A chunk's uncompressed bytes, borrowed where they lie in memory; with what was wrong.
pub(crate) fn load<'a, F: ChunkedFile>(
    file: &'a F,
    chunk: &ChunkInfo,
    limit: u64,
    used: u64,
) -> Result<Loaded<'a>, BagError> {
    let ChunkInfo { data_position, data_length, .. } = *chunk;
    let raw = match file.slice(data_position, data_length as usize) {
        Some(bytes) => Cow::Borrowed(bytes),
        None => read_bytes(file, data_position, data_length, "a chunk's data")?,
    };
    if chunk.compression == Compression::None {
        return Ok((raw, None));
    }
    let (needed, allowed) = (u64::from(chunk.size), limit.saturating_sub(used));
    if needed > allowed {
        return Err(BagError::MemoryLimit { offset: chunk.position, needed, allowed });
    }
    let (bytes, wrong) = chunk.compression.decompress(&raw, chunk.size);
    Ok((Cow::Owned(bytes), wrong))
}

/// Counts a chunk's messages and collects its connections, up to the first defect.
fn walk<F: ChunkedFile>(
    bag: &Bag<F>,
    chunk: &mut ChunkInfo,
    data: &[u8],
) -> (Vec<crate::Connection>, Option<(u64, String)>) {
    let mut counts: BTreeMap<u32, u32> = BTreeMap::new();
    let mut connections: Vec<crate::Connection> = Vec::new();
    let mut walk = ChunkWalk::new(data);
    let defect = loop {
        let before = walk.at;
        match walk.next_record() {
            Ok(None) => break None,
            Err(defect) => break Some((defect.at as u64, defect.expected)),
            Ok(Some(ChunkRecord::Connection(found))) => connections.push(*found),
            Ok(Some(ChunkRecord::Message { connection, time, .. })) => {
                let known = counts.contains_key(&connection)
                    || bag.by_id.contains_key(&connection)
                    || connections.iter().any(|each| each.id == connection);
                if !known {
                    walk.at = before;
                    break Some((before as u64, unknown_connection(connection)));
                }
                *counts.entry(connection).or_default() += 1;
                chunk.start = chunk.start.min(time);
                chunk.end = chunk.end.max(time);
            }
        }
    };
    chunk.usable = walk.at as u32;
    chunk.counts = counts.into_iter().collect();
    if chunk.counts.is_empty() {
        chunk.start = 0;
    }
    (connections, defect)
}

pub(crate) fn unknown_connection(id: u32) -> String {
    format!("a message of a declared connection, found connection {id}")
}

/// Adds to what is known to be lost; the first damage names the place.
fn note_damage<F: ChunkedFile>(bag: &mut Bag<F>, offset: u64, bytes: u64, description: &str) {
    match &mut bag.loss {
        Some(loss) => loss.bytes = loss.bytes.saturating_add(bytes),
        None => {
            let description = description.to_owned();
            bag.loss = Some(Loss { offset, bytes, messages: None, description });
        }
    }
}

fn expectation(error: &BagError) -> String {
    match error {
        BagError::Damaged { expected, .. } => expected.clone(),
        other => other.to_string(),
    }
}
