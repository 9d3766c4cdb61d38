//! The records of a bag 2.0, as bytes.
//!
//! The format leaves a header's fields in any order. rosbag's C++, the original, sorts them by
//! name, and readers that are in use take an order for given: `rosbags` reads every INDEX record
//! by the places of the first one's fields. So every header here is in the original's order.

use std::borrow::Cow;

use crate::record::{
    OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_FILE_HEADER, OP_INDEX, OP_MESSAGE, time_at,
};
use crate::{Compression, Connection};

/// rosbag pads its file header record to this many bytes, so that it can be patched.
pub(crate) const FILE_HEADER_LENGTH: usize = 4096;
/// A MESSAGE record without its data: header length, conn, op, time, data length.
pub(crate) const MESSAGE_OVERHEAD: usize = 4 + (4 + 9) + (4 + 4) + (4 + 13) + 4;
/// One entry of an INDEX record: time, then the message's place in the chunk.
pub(crate) const INDEX_ENTRY: usize = 12;
/// The version of INDEX and CHUNK_INFO records that bags 2.0 have.
pub(crate) const INDEX_VERSION: u32 = 1;

/// One connection's INDEX record for one chunk, its entries by time.
pub(crate) fn index_record(connection: u32, entries: &[u8], out: &mut Vec<u8>) -> u32 {
    let entries = by_time(entries);
    let count = (entries.len() / INDEX_ENTRY) as u32;
    Header::new()
        .field("conn", &connection.to_le_bytes())
        .field("count", &count.to_le_bytes())
        .field("op", &[OP_INDEX])
        .field("ver", &INDEX_VERSION.to_le_bytes())
        .record_into(&entries, out);
    count
}

/// The original sorts a record's entries by time, and its Python reader counts on that: it merges
/// them as they come, and ends at the first one behind the time that is asked for.
fn by_time(entries: &[u8]) -> Cow<'_, [u8]> {
    let (entries, _) = entries.as_chunks::<INDEX_ENTRY>();
    let time = |entry: &[u8; INDEX_ENTRY]| time_at(entry, 0);
    if entries.is_sorted_by_key(time) {
        return Cow::Borrowed(entries.as_flattened());
    }
    let mut sorted = entries.to_vec();
    sorted.sort_by_key(time);
    Cow::Owned(sorted.into_flattened())
}

/// A record's header under construction; its fields must come sorted by name.
pub(crate) struct Header(Vec<u8>);

impl Header {
    fn new() -> Self {
        Self(Vec::with_capacity(96))
    }

    fn field(mut self, name: &str, value: &[u8]) -> Self {
        push_field(&mut self.0, name, value);
        self
    }

    pub fn record_into(&self, data: &[u8], out: &mut Vec<u8>) {
        out.extend_from_slice(&(self.0.len() as u32).to_le_bytes());
        out.extend_from_slice(&self.0);
        out.extend_from_slice(&(data.len() as u32).to_le_bytes());
        out.extend_from_slice(data);
    }
}

fn push_field(out: &mut Vec<u8>, name: &str, value: &[u8]) {
    out.extend_from_slice(&((name.len() + 1 + value.len()) as u32).to_le_bytes());
    out.extend_from_slice(name.as_bytes());
    out.push(b'=');
    out.extend_from_slice(value);
}

pub(crate) fn ros_time(nanoseconds: u64) -> [u8; 8] {
    // Seconds of a bag are 32 bits; a later time is written as the last one.
    let seconds = u32::try_from(nanoseconds / 1_000_000_000).unwrap_or(u32::MAX);
    let mut bytes = [0; 8];
    bytes[..4].copy_from_slice(&seconds.to_le_bytes());
    bytes[4..].copy_from_slice(&((nanoseconds % 1_000_000_000) as u32).to_le_bytes());
    bytes
}

/// Where a MESSAGE record's time stands in it.
pub(crate) const TIME_IN_HEADER: usize = 34;

/// A MESSAGE record up to its data, built on the stack: once for every message.
pub(crate) fn message_header(connection: u32, time: u64, length: u32) -> [u8; MESSAGE_OVERHEAD] {
    const LENGTH: u32 = (MESSAGE_OVERHEAD - 8) as u32;
    let mut bytes = [0; MESSAGE_OVERHEAD];
    bytes[..4].copy_from_slice(&LENGTH.to_le_bytes());
    bytes[4..13].copy_from_slice(b"\x09\0\0\0conn=");
    bytes[13..17].copy_from_slice(&connection.to_le_bytes());
    bytes[17..25].copy_from_slice(&[4, 0, 0, 0, b'o', b'p', b'=', OP_MESSAGE]);
    bytes[25..34].copy_from_slice(b"\x0d\0\0\0time=");
    bytes[TIME_IN_HEADER..42].copy_from_slice(&ros_time(time));
    bytes[42..].copy_from_slice(&length.to_le_bytes());
    bytes
}

pub(crate) fn chunk_header(compression: Compression, size: u32) -> Header {
    Header::new()
        .field("compression", compression.name().as_bytes())
        .field("op", &[OP_CHUNK])
        .field("size", &size.to_le_bytes())
}

pub(crate) fn connection_record(connection: &Connection) -> Vec<u8> {
    let mut data = Vec::new();
    if let Some(caller_id) = &connection.caller_id {
        push_field(&mut data, "callerid", caller_id.as_bytes());
    }
    if connection.latching {
        push_field(&mut data, "latching", b"1");
    }
    push_field(&mut data, "md5sum", connection.md5sum.as_bytes());
    push_field(&mut data, "message_definition", connection.definition.as_bytes());
    push_field(&mut data, "topic", connection.topic.as_bytes());
    push_field(&mut data, "type", connection.datatype.as_bytes());
    let header = Header::new()
        .field("conn", &connection.id.to_le_bytes())
        .field("op", &[OP_CONNECTION])
        .field("topic", connection.topic.as_bytes());
    let mut record = Vec::new();
    header.record_into(&data, &mut record);
    record
}

pub(crate) fn file_header(index_position: u64, connections: u32, chunks: u32) -> Vec<u8> {
    let header = Header::new()
        .field("chunk_count", &chunks.to_le_bytes())
        .field("conn_count", &connections.to_le_bytes())
        .field("index_pos", &index_position.to_le_bytes())
        .field("op", &[OP_FILE_HEADER]);
    let padding = FILE_HEADER_LENGTH - 8 - header.0.len();
    let mut record = Vec::with_capacity(FILE_HEADER_LENGTH);
    header.record_into(&vec![b' '; padding], &mut record);
    record
}

/// The CHUNK_INFO record of the chunk at that position, with its first and last time.
pub(crate) fn chunk_info(
    position: u64,
    (start, end): (u64, u64),
    counts: &[(u32, u32)],
    out: &mut Vec<u8>,
) {
    let data: Vec<u8> = counts
        .iter()
        .flat_map(|(id, count)| [id.to_le_bytes(), count.to_le_bytes()].concat())
        .collect();
    Header::new()
        .field("chunk_pos", &position.to_le_bytes())
        .field("count", &(counts.len() as u32).to_le_bytes())
        .field("end_time", &ros_time(end))
        .field("op", &[OP_CHUNK_INFO])
        .field("start_time", &ros_time(start))
        .field("ver", &INDEX_VERSION.to_le_bytes())
        .record_into(&data, out);
}
