//! Records as bytes.

use std::collections::BTreeMap;

use crate::record::{
    ATTACHMENT, Attachment, CHANNEL, CHUNK, Channel, DATA_END, HEAD, HEADER, MESSAGE,
    MESSAGE_FIELDS, MESSAGE_INDEX, METADATA, Metadata, SCHEMA, Schema,
};
use crate::walk::LEAST_MESSAGE;
use crate::{Compression, Stamp};

/// A message's entry in a message index: time, and place in the chunk.
pub(crate) const INDEX_ENTRY: usize = 16;
/// A MessageIndex record without entries.
pub(crate) const INDEX_RECORD: usize = HEAD + 2 + 4;

/// Appends a record whose fields `write` appends.
pub(crate) fn record(out: &mut Vec<u8>, op: u8, write: impl FnOnce(&mut Vec<u8>)) {
    out.push(op);
    let at = out.len();
    out.extend_from_slice(&[0; 8]);
    write(out);
    let length = (out.len() - at - 8) as u64;
    out[at..at + 8].copy_from_slice(&length.to_le_bytes());
}

/// Fields as a record has them.
pub(crate) trait Put {
    fn u16(&mut self, value: u16);
    fn u32(&mut self, value: u32);
    fn u64(&mut self, value: u64);
    fn bytes(&mut self, value: &[u8]);
    fn map(&mut self, map: &BTreeMap<String, String>);
}

impl Put for Vec<u8> {
    fn u16(&mut self, value: u16) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u32(&mut self, value: u32) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.extend_from_slice(&value.to_le_bytes());
    }

    fn bytes(&mut self, value: &[u8]) {
        self.u32(value.len() as u32);
        self.extend_from_slice(value);
    }

    fn map(&mut self, map: &BTreeMap<String, String>) {
        let length: usize = map.iter().map(|(key, value)| 8 + key.len() + value.len()).sum();
        self.u32(length as u32);
        for (key, value) in map {
            self.bytes(key.as_bytes());
            self.bytes(value.as_bytes());
        }
    }
}

pub(crate) fn header(profile: &str, library: &str, out: &mut Vec<u8>) {
    record(out, HEADER, |out| {
        out.bytes(profile.as_bytes());
        out.bytes(library.as_bytes());
    });
}

pub(crate) fn schema(schema: &Schema, out: &mut Vec<u8>) {
    record(out, SCHEMA, |out| {
        out.u16(schema.id);
        out.bytes(schema.name.as_bytes());
        out.bytes(schema.encoding.as_bytes());
        out.bytes(&schema.data);
    });
}

pub(crate) fn channel(channel: &Channel, out: &mut Vec<u8>) {
    record(out, CHANNEL, |out| {
        out.u16(channel.id);
        out.u16(channel.schema_id);
        out.bytes(channel.topic.as_bytes());
        out.bytes(channel.message_encoding.as_bytes());
        out.map(&channel.metadata);
    });
}

/// A Message record up to its data, built on the stack: once for every message.
pub(crate) fn message_head(
    channel: u16,
    time: u64,
    stamp: Stamp,
    length: usize,
) -> [u8; LEAST_MESSAGE] {
    let mut bytes = [0; LEAST_MESSAGE];
    bytes[0] = MESSAGE;
    bytes[1..9].copy_from_slice(&((MESSAGE_FIELDS + length) as u64).to_le_bytes());
    bytes[9..11].copy_from_slice(&channel.to_le_bytes());
    bytes[11..15].copy_from_slice(&stamp.sequence.to_le_bytes());
    bytes[15..23].copy_from_slice(&time.to_le_bytes());
    bytes[23..].copy_from_slice(&stamp.publish_time.to_le_bytes());
    bytes
}

/// What a Chunk record says of its records.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ChunkHead {
    pub times: (u64, u64),
    pub size: u64,
    pub crc: u32,
    pub compression: Compression,
    /// How many bytes the (compressed) records take.
    pub length: u64,
}

impl ChunkHead {
    /// How many bytes it takes.
    pub fn len(compression: Compression) -> usize {
        HEAD + 8 + 8 + 8 + 4 + 4 + compression.name().len() + 8
    }

    /// The record without its last field's bytes.
    pub fn write(&self, out: &mut Vec<u8>) {
        let Self { times, size, crc, compression, length } = *self;
        let content = (Self::len(compression) - HEAD) as u64 + length;
        out.push(CHUNK);
        out.u64(content);
        out.u64(times.0);
        out.u64(times.1);
        out.u64(size);
        out.u32(crc);
        out.bytes(compression.name().as_bytes());
        out.u64(length);
    }
}

pub(crate) fn message_index(channel: u16, entries: &[u8], out: &mut Vec<u8>) {
    record(out, MESSAGE_INDEX, |out| {
        out.u16(channel);
        out.bytes(entries);
    });
}

pub(crate) fn attachment(attachment: &Attachment<'_>, out: &mut Vec<u8>) {
    record(out, ATTACHMENT, |out| {
        let start = out.len();
        out.u64(attachment.log_time);
        out.u64(attachment.create_time);
        out.bytes(attachment.name.as_bytes());
        out.bytes(attachment.media_type.as_bytes());
        out.u64(attachment.data.len() as u64);
        out.extend_from_slice(attachment.data);
        let crc = crc32fast::hash(&out[start..]);
        out.u32(crc);
    });
}

pub(crate) fn metadata(metadata: &Metadata, out: &mut Vec<u8>) {
    record(out, METADATA, |out| {
        out.bytes(metadata.name.as_bytes());
        out.map(&metadata.entries);
    });
}

pub(crate) fn data_end(crc: u32, out: &mut Vec<u8>) {
    record(out, DATA_END, |out| out.u32(crc));
}
