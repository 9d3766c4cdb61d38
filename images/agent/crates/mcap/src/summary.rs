//! What stands behind a recording's data: declarations, indexes and counts; and how many bytes
//! it will take, known before it is written.

use crate::build::{ChunkHead, Put, channel, record, schema};
use crate::record::{
    ATTACHMENT_INDEX, Attachment, CHANNEL, CHUNK_INDEX, Channel, FOOTER, HEAD, METADATA_INDEX,
    Metadata, SCHEMA, STATISTICS, SUMMARY_OFFSET, Schema,
};
use crate::{Compression, MAGIC};

/// A DataEnd record.
const DATA_END: usize = HEAD + 4;
/// A SummaryOffset record, one for each kind of record that there is.
const OFFSET: usize = HEAD + 17;
/// A Statistics record of no channel, and what one adds.
const STATISTICS_RECORD: usize = HEAD + 46;
const CHANNEL_COUNT: usize = 10;
/// A Footer record.
const FOOTER_RECORD: usize = HEAD + 20;
/// A ChunkIndex record of no channel, without the compression's name, and what one adds.
const CHUNK_INDEX_RECORD: usize = HEAD + 64;
const INDEX_PLACE: usize = 10;
/// Index records of an attachment and of metadata, without the words in them.
const ATTACHMENT_INDEX_RECORD: usize = HEAD + 48;
const METADATA_INDEX_RECORD: usize = HEAD + 20;

/// A chunk that is in the file.
#[derive(Debug)]
pub(crate) struct Chunk {
    pub head: ChunkHead,
    /// Where its record begins.
    pub position: u64,
    /// Each channel, and where its MessageIndex record begins behind the chunk.
    pub indexes: Vec<(u16, u32)>,
    /// Bytes of these records.
    pub index_length: u32,
}

/// All that the summary says.
#[derive(Debug, Default)]
pub(crate) struct Summary {
    /// Schemas and channels that the data holds.
    pub schemas: Vec<Schema>,
    pub channels: Vec<Channel>,
    /// Messages by the channels' numbers.
    pub counts: Vec<u64>,
    pub chunks: Vec<Chunk>,
    /// AttachmentIndex records.
    attachments: Vec<u8>,
    attachment_count: u32,
    metadata: Vec<u8>,
    metadata_count: u32,
    times: Option<(u64, u64)>,
    pub messages: u64,
}

/// What a message adds to the summary.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Grown {
    /// The length of its channel's record, and of its schema's, if they are new.
    pub channel: Option<usize>,
    pub schema: Option<usize>,
    /// Whether it begins a chunk, and is its channel's first one there.
    pub chunk: Option<Compression>,
    pub touched: bool,
}

impl Summary {
    /// The bytes behind the data of an empty recording.
    pub const EMPTY: usize = DATA_END + STATISTICS_RECORD + OFFSET + FOOTER_RECORD + MAGIC.len();

    /// An empty one, whose channels count from that number.
    pub fn counting_from(first: usize) -> Self {
        Self { counts: vec![0; first], ..Self::default() }
    }

    /// How many bytes more it takes with such a message; `first_chunk` where no chunk was begun
    /// before.
    pub fn growth(&self, grown: Grown, first_chunk: bool) -> usize {
        let group = |first: bool| if first { OFFSET } else { 0 };
        let mut bytes = 0;
        if let Some(schema) = grown.schema {
            bytes += schema + group(self.schemas.is_empty());
        }
        if let Some(channel) = grown.channel {
            bytes += channel + CHANNEL_COUNT + group(self.channels.is_empty());
        }
        if let Some(compression) = grown.chunk {
            bytes += CHUNK_INDEX_RECORD + compression.name().len() + group(first_chunk);
        }
        if grown.touched { bytes + INDEX_PLACE } else { bytes }
    }

    /// The same with such an attachment.
    pub fn growth_by_attachment(&self, attachment: &Attachment<'_>) -> usize {
        let group = if self.attachment_count == 0 { OFFSET } else { 0 };
        ATTACHMENT_INDEX_RECORD + attachment.name.len() + attachment.media_type.len() + group
    }

    /// The same with such metadata.
    pub fn growth_by_metadata(&self, metadata: &Metadata) -> usize {
        let group = if self.metadata_count == 0 { OFFSET } else { 0 };
        METADATA_INDEX_RECORD + metadata.name.len() + group
    }

    /// Notes an attachment's record.
    pub fn attached(&mut self, attachment: &Attachment<'_>, position: u64, length: u64) {
        self.attachment_count += 1;
        record(&mut self.attachments, ATTACHMENT_INDEX, |out| {
            out.u64(position);
            out.u64(length);
            out.u64(attachment.log_time);
            out.u64(attachment.create_time);
            out.u64(attachment.data.len() as u64);
            out.bytes(attachment.name.as_bytes());
            out.bytes(attachment.media_type.as_bytes());
        });
    }

    /// Notes a metadata record.
    pub fn described(&mut self, metadata: &Metadata, position: u64, length: u64) {
        self.metadata_count += 1;
        record(&mut self.metadata, METADATA_INDEX, |out| {
            out.u64(position);
            out.u64(length);
            out.bytes(metadata.name.as_bytes());
        });
    }

    /// Notes a message.
    #[inline]
    pub fn count(&mut self, channel: u16, time: u64) {
        self.messages += 1;
        let (first, last) = self.times.unwrap_or((time, time));
        self.times = Some((first.min(time), last.max(time)));
        self.counts[usize::from(channel)] += 1;
    }

    /// Writes all of it, the footer and the file's last bytes; the next byte of `out` is the
    /// file's byte `position`.
    pub fn write(&self, position: u64, out: &mut Vec<u8>) {
        let start = out.len();
        let place = |out: &Vec<u8>| position + (out.len() - start) as u64;
        let mut offsets = Vec::new();
        for op in [SCHEMA, CHANNEL, STATISTICS, CHUNK_INDEX, ATTACHMENT_INDEX, METADATA_INDEX] {
            let begins = place(out);
            self.group(op, out);
            let length = place(out) - begins;
            if length > 0 {
                record(&mut offsets, SUMMARY_OFFSET, |out| {
                    out.push(op);
                    out.u64(begins);
                    out.u64(length);
                });
            }
        }
        let offsets_at = place(out);
        out.extend_from_slice(&offsets);
        record(out, FOOTER, |out| {
            out.u64(position);
            out.u64(offsets_at);
            out.u32(0);
        });
        let crc_at = out.len() - 4;
        let crc = crc32fast::hash(&out[start..crc_at]);
        out[crc_at..].copy_from_slice(&crc.to_le_bytes());
        out.extend_from_slice(MAGIC);
    }

    /// All records of one kind.
    fn group(&self, op: u8, out: &mut Vec<u8>) {
        match op {
            SCHEMA => self.schemas.iter().for_each(|each| schema(each, out)),
            CHANNEL => self.channels.iter().for_each(|each| channel(each, out)),
            STATISTICS => self.statistics(out),
            CHUNK_INDEX => self.chunks.iter().for_each(|each| chunk_index(each, out)),
            ATTACHMENT_INDEX => out.extend_from_slice(&self.attachments),
            _ => out.extend_from_slice(&self.metadata),
        }
    }

    fn statistics(&self, out: &mut Vec<u8>) {
        let times = self.times.unwrap_or_default();
        record(out, STATISTICS, |out| {
            out.u64(self.messages);
            out.u16(self.schemas.len() as u16);
            out.u32(self.channels.len() as u32);
            out.u32(self.attachment_count);
            out.u32(self.metadata_count);
            out.u32(self.chunks.len() as u32);
            out.u64(times.0);
            out.u64(times.1);
            out.u32((self.channels.len() * CHANNEL_COUNT) as u32);
            for channel in &self.channels {
                out.u16(channel.id);
                out.u64(self.counts[usize::from(channel.id)]);
            }
        });
    }
}

fn chunk_index(chunk: &Chunk, out: &mut Vec<u8>) {
    let Chunk { head, position, indexes, index_length } = chunk;
    let length = ChunkHead::len(head.compression) as u64 + head.length;
    record(out, CHUNK_INDEX, |out| {
        out.u64(head.times.0);
        out.u64(head.times.1);
        out.u64(*position);
        out.u64(length);
        out.u32((indexes.len() * INDEX_PLACE) as u32);
        for (channel, behind) in indexes {
            out.u16(*channel);
            out.u64(position + length + u64::from(*behind));
        }
        out.u64(u64::from(*index_length));
        out.bytes(head.compression.name().as_bytes());
        out.u64(head.length);
        out.u64(head.size);
    });
}
