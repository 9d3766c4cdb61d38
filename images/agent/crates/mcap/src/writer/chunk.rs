//! A recording's chunks: one is open, full ones are compressed beside it and appended in their order.

use bagpipe_packing::Compressed;
use crc32fast::Hasher;

use super::McapWriter;
use crate::build::{ChunkHead, message_index};
use crate::summary::Chunk;
use crate::walk::LEAST_MESSAGE;
use crate::{Compression, McapError};

/// A chunk that is full: what follows it in the file, and what the summary will say.
#[derive(Debug)]
pub(super) struct Full {
    times: (u64, u64),
    crc: u32,
    /// MessageIndex records.
    index: Vec<u8>,
    indexes: Vec<(u16, u32)>,
}

impl McapWriter {
    pub(super) fn begin_chunk(&mut self, time: u64) {
        if self.open.is_some() {
            return;
        }
        let position = self.out.len();
        if self.options.compression == Compression::None {
            // What it says is written when the chunk is closed.
            self.out.resize(position + self.head(), 0);
        }
        self.open = Some((position, self.out.len()));
        self.chunks_begun = true;
        self.times = (time, time);
    }

    pub(super) fn append(
        &mut self,
        at: usize,
        declared: &[u8],
        head: &[u8; LEAST_MESSAGE],
        data: &[u8],
    ) {
        let (chunk, base) = match (self.options.compression, self.open) {
            (Compression::None, Some((_, data))) => (&mut self.out, data),
            _ => (&mut self.pending, 0),
        };
        let written = &mut self.channels[at];
        if !written.declared {
            written.declared = true;
            self.summary.channels.push(written.channel.clone());
            if let Some((schema, known)) = written.schema.map(|at| &mut self.schemas[at])
                && !*known
            {
                *known = true;
                self.summary.schemas.push(schema.clone());
            }
            chunk.extend_from_slice(declared);
        }
        if written.index.is_empty() {
            self.touched.push(written.channel.id);
        }
        written.index.extend_from_slice(&head[15..23]);
        written.index.extend_from_slice(&((chunk.len() - base) as u64).to_le_bytes());
        chunk.reserve(head.len() + data.len());
        chunk.extend_from_slice(head);
        chunk.extend_from_slice(data);
    }

    pub(super) fn close_chunk(&mut self) -> Result<(), McapError> {
        let Some((position, data)) = self.open.take() else {
            return Ok(());
        };
        let compression = self.options.compression;
        let mut crc = Hasher::new();
        let plain = compression == Compression::None;
        crc.update(if plain { &self.out[data..] } else { &self.pending });
        let full = self.full_chunk(crc.clone().finalize());
        if plain {
            let length = (self.out.len() - data) as u64;
            let Full { times, crc: found, .. } = full;
            let head = ChunkHead { times, size: length, crc: found, compression, length };
            let mut record = Vec::new();
            head.write(&mut record);
            self.out[position..data].copy_from_slice(&record);
            self.check_up_to(data);
            self.crc.combine(&crc);
            self.checked = self.out.len();
            self.append_index(position, head, full);
            return Ok(());
        }
        self.compressor.push(&mut self.pending, full).map_err(McapError::Compress)?;
        self.collect(false)
    }

    /// Appends the chunks that have been compressed by now, or all.
    pub(super) fn collect(&mut self, all: bool) -> Result<(), McapError> {
        while let Some(chunk) = self.compressor.pop(all).map_err(McapError::Compress)? {
            let Compressed { buffer, used, length, rest } = chunk;
            let position = self.out.len();
            let Full { times, crc, .. } = rest;
            let (compression, size) = (self.options.compression, u64::from(length));
            let head = ChunkHead { times, size, crc, compression, length: used as u64 };
            head.write(&mut self.out);
            self.out.extend_from_slice(&buffer[..used]);
            self.compressor.give_back(buffer);
            self.append_index(position, head, rest);
        }
        Ok(())
    }

    fn append_index(&mut self, position: usize, head: ChunkHead, full: Full) {
        let Full { index, indexes, .. } = full;
        self.later -= index.len();
        self.out.extend_from_slice(&index);
        let (position, index_length) = (self.spilled + position as u64, index.len() as u32);
        self.summary.chunks.push(Chunk { head, position, indexes, index_length });
    }

    /// The message indexes of the open chunk, which is empty then.
    fn full_chunk(&mut self, crc: u32) -> Full {
        self.touched.sort_unstable();
        let mut indexes = Vec::with_capacity(self.touched.len());
        let mut index = Vec::new();
        for id in self.touched.drain(..) {
            let entries = &mut self.channels[usize::from(id) - 1].index;
            indexes.push((id, index.len() as u32));
            message_index(id, entries, &mut index);
            entries.clear();
        }
        Full { times: self.times, crc, index, indexes }
    }
}
