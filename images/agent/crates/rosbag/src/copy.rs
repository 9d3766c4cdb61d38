//! Carrying messages of one bag into another: whole chunks where their bytes may stay as
//! they are, message by message elsewhere.

use std::collections::HashMap;

use bagpipe_packing::lz4;

use crate::build::{INDEX_ENTRY, INDEX_VERSION, index_record, ros_time};
use crate::chunk::{ChunkRecord, ChunkWalk};
use crate::record::{Fields, FileRecord, OP_INDEX, read_bytes, time_at, u32_at};
use crate::unpack::passing_bytes;
use crate::{Bag, BagError, BagWriter, ChunkInfo, ChunkedFile, Compression};

/// Ids below this, and below eight times as many as there are connections, are kept: recorders
/// count from 0. A damaged id must not make room for all ids before it.
const MOST_KEPT: u32 = 1024;

/// Carries chunks of one bag into a writer.
pub(crate) struct Carrier<'b, F: ChunkedFile> {
    bag: &'b Bag<F>,
    pub writer: BagWriter,
    /// The writer's id of each of the bag's connections.
    ids: HashMap<u32, u32>,
    /// Chunks whose bytes were carried as they are.
    pub whole: usize,
}

impl<'b, F: ChunkedFile> Carrier<'b, F> {
    /// Adds all connections under their own ids, so that chunks can stay as they are. Ids
    /// that no recorder gives get new ones, and their chunks are rewritten.
    pub fn new(bag: &'b Bag<F>, mut writer: BagWriter) -> Self {
        let mut connections: Vec<_> = bag.connections.iter().collect();
        connections.sort_by_key(|each| each.id);
        let most = MOST_KEPT.max(connections.len().saturating_mul(8).min(1 << 24) as u32);
        let mut ids = HashMap::new();
        for each in connections {
            if each.id < most {
                writer.skip_ids(each.id);
            }
            ids.insert(each.id, writer.add_connection(each));
        }
        Self { bag, writer, ids, whole: 0 }
    }

    /// Writes one message of the bag.
    pub fn message(&mut self, connection: u32, time: u64, data: &[u8]) -> Result<(), BagError> {
        let id = self.ids.get(&connection).ok_or(BagError::UnknownConnection(connection))?;
        self.writer.write(*id, time, data)
    }

    /// Writes those messages of a chunk that `keep` says of (connection, time).
    pub fn messages(&mut self, at: usize, keep: impl Fn(u32, u64) -> bool) -> Result<(), BagError> {
        let chunk = &self.bag.chunks[at];
        let bytes = passing_bytes(self.bag, at)?;
        let mut walk = ChunkWalk::new(bytes.get(..chunk.usable as usize).unwrap_or(&bytes));
        while let Some(record) =
            walk.next_record().map_err(|bad| chunk.damaged(bad.at as u64, &bad.expected))?
        {
            if let ChunkRecord::Message { connection, time, start, end } = record
                && keep(connection, time)
            {
                self.message(connection, time, &bytes[start as usize + 4..end as usize])?;
            }
        }
        Ok(())
    }

    /// Carries a chunk as it is; false, and nothing done, where that is not possible.
    pub fn whole(&mut self, at: usize) -> Result<bool, BagError> {
        let chunk = &self.bag.chunks[at];
        let known = |(id, _): &(u32, u32)| {
            self.ids.get(id).is_some_and(|here| here == id && self.writer.declares(*id))
        };
        if !self.may_stay(chunk)? || !chunk.counts.iter().all(known) {
            return Ok(false);
        }
        let Some(index) = kept_index(&self.bag.file, chunk) else {
            return Ok(false);
        };
        self.append(at, &index)
    }

    /// The same without the file's own INDEX records: they are made from the chunk's messages.
    pub fn whole_with_new_index(&mut self, at: usize) -> Result<bool, BagError> {
        let chunk = &self.bag.chunks[at];
        if !self.may_stay(chunk)? {
            return Ok(false);
        }
        let bytes = passing_bytes(self.bag, at)?;
        let mut walk = ChunkWalk::new(&bytes);
        let mut entries: HashMap<u32, Vec<u8>> = HashMap::new();
        let mut declared: Vec<u32> = Vec::new();
        let mut offset = 0u32;
        while let Some(record) =
            walk.next_record().map_err(|bad| chunk.damaged(bad.at as u64, &bad.expected))?
        {
            match record {
                ChunkRecord::Connection(found) => declared.push(found.id),
                ChunkRecord::Message { connection, time, .. } => {
                    let of = entries.entry(connection).or_default();
                    of.extend_from_slice(&ros_time(time));
                    of.extend_from_slice(&offset.to_le_bytes());
                }
            }
            offset = walk.at as u32;
        }
        let known = |id: &u32| {
            let declared = declared.contains(id) || self.writer.declares(*id);
            declared && self.ids.get(id) == Some(id)
        };
        if !entries.keys().all(known) {
            return Ok(false);
        }
        let mut index = Vec::new();
        for (id, _) in &chunk.counts {
            if let Some(entries) = entries.get(id) {
                index_record(*id, entries, &mut index);
            }
        }
        self.append(at, &index)
    }

    /// Whether a chunk's bytes are there, whole, and such as all readers take.
    fn may_stay(&self, chunk: &ChunkInfo) -> Result<bool, BagError> {
        if chunk.damaged || self.bag.old.is_some() {
            return Ok(false);
        }
        if chunk.compression != Compression::Lz4 {
            return Ok(true);
        }
        let length = chunk.data_length.min(lz4::ROS_HEAD as u32);
        let head = read_bytes(&self.bag.file, chunk.data_position, length, "a chunk's data")?;
        Ok(lz4::is_ros(&head))
    }

    fn append(&mut self, at: usize, index: &[u8]) -> Result<bool, BagError> {
        let chunk = &self.bag.chunks[at];
        let data =
            read_bytes(&self.bag.file, chunk.data_position, chunk.data_length, "a chunk's data")?;
        self.writer.append_chunk(chunk, &data, index)?;
        self.whole += 1;
        Ok(true)
    }
}

/// The INDEX records behind a chunk, rewritten: a source's own may have its fields, or its
/// entries, in another order than the rest of the bag. `None` when they are not as many as the
/// bag's tail says, or point out of the chunk.
fn kept_index(file: &impl ChunkedFile, chunk: &ChunkInfo) -> Option<Vec<u8>> {
    let mut at = chunk.data_position + u64::from(chunk.data_length);
    let mut counts = Vec::new();
    let mut records = Vec::new();
    while counts.len() < chunk.counts.len() {
        let record = FileRecord::read(file, at).ok().filter(|record| record.op == OP_INDEX)?;
        let field = |name| Fields::require_u32(&record.header, name).ok();
        let (id, count) = (field("conn")?, field("count")?);
        let entries = record.data(file).ok()?;
        if field("ver")? != INDEX_VERSION
            || entries.len() != count as usize * INDEX_ENTRY
            || !entries.chunks_exact(INDEX_ENTRY).all(|entry| lies_in(chunk, entry))
        {
            return None;
        }
        index_record(id, &entries, &mut records);
        counts.push((id, count));
        at = record.end();
    }
    let mut promised = chunk.counts.clone();
    promised.sort_unstable();
    counts.sort_unstable();
    (counts == promised).then_some(records)
}

/// Whether a message may lie where an INDEX record's entry says.
fn lies_in(chunk: &ChunkInfo, entry: &[u8]) -> bool {
    let time = time_at(entry, 0).is_some_and(|time| (chunk.start..=chunk.end).contains(&time));
    time && u32_at(entry, 8).is_some_and(|offset| offset < chunk.size)
}

impl ChunkInfo {
    /// The error for damage at a byte of the uncompressed chunk.
    pub(crate) fn damaged(&self, at: u64, expected: &str) -> BagError {
        match self.compression {
            Compression::None => BagError::damaged(self.data_position + at, expected),
            _ => BagError::damaged(
                self.data_position,
                format!("{expected}, at byte {at} of the uncompressed chunk"),
            ),
        }
    }
}
