//! Writing a bag 2.0 into memory, within a byte budget; or, chunk by chunk, into a file.

use std::io::{Seek, SeekFrom, Write};

use bagpipe_packing::{Compressed, Compressor};

use crate::build::{
    FILE_HEADER_LENGTH, INDEX_ENTRY, MESSAGE_OVERHEAD, TIME_IN_HEADER, chunk_header, chunk_info,
    connection_record, file_header, index_record, message_header,
};
use crate::{BagError, ChunkInfo, Compression, Connection, MAGIC};

/// INDEX record and CHUNK_INFO count of one connection in one chunk.
const INDEX_OVERHEAD: usize = 55 + 8;
/// CHUNK and CHUNK_INFO records of one chunk, without what they hold.
const CHUNK_OVERHEAD: usize = 160;

/// How a bag is written.
#[derive(Debug, Clone)]
pub struct WriterOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// A chunk is closed once it holds this many bytes; 768 KiB is rosbag's own default.
    pub chunk_threshold: usize,
    /// The finished bag may not be larger than this.
    pub byte_budget: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self { compression: Compression::None, chunk_threshold: 768 * 1024, byte_budget: None }
    }
}

impl WriterOptions {
    /// The usual ones but for the compression.
    pub fn with_compression(compression: Compression) -> Self {
        Self { compression, ..Self::default() }
    }
}

#[derive(Debug)]
struct Written {
    connection: Connection,
    /// True once the bag holds its CONNECTION record.
    declared: bool,
    /// The data of its INDEX record: time and offset of each message in the open chunk.
    index: Vec<u8>,
}

/// What the tail says of a chunk.
#[derive(Debug)]
struct Closed {
    start: u64,
    end: u64,
    counts: Vec<(u32, u32)>,
}

/// A chunk that is full: what follows it in the file, and what the tail will say.
#[derive(Debug)]
struct Full {
    index: Vec<u8>,
    closed: Closed,
}

/// Writes messages into a bag in memory.
#[derive(Debug)]
pub struct BagWriter {
    options: WriterOptions,
    /// The bag so far; an uncompressed chunk is written straight into it.
    out: Vec<u8>,
    /// Bytes of the bag that went before `out` into a file.
    spilled: u64,
    /// The open chunk, when it must be compressed first.
    pending: Vec<u8>,
    /// Full chunks that other threads compress.
    compressor: Compressor<Compression, Full>,
    /// Where the open chunk's CHUNK record (not compressed) and its data begin in `out`.
    open: Option<(usize, usize)>,
    connections: Vec<Written>,
    /// Connections with messages in the open chunk.
    touched: Vec<u32>,
    times: (u64, u64),
    /// Each with its position in the file.
    chunks: Vec<(u64, Closed)>,
    /// Bytes that the index of everything written so far will take.
    index_bytes: usize,
    messages: u64,
    high_water: u64,
}

impl BagWriter {
    /// An empty bag. An uncompressed one with a budget reserves it: memory that is reserved and
    /// not written to costs nothing, and a bag that grows does not move.
    pub fn new(options: WriterOptions) -> Self {
        let mut memory = Vec::new();
        if let (Compression::None, Some(budget)) = (options.compression, options.byte_budget) {
            // Where the system refuses, the bag grows as it must.
            let _ = memory.try_reserve_exact(usize::try_from(budget).unwrap_or(0));
        }
        Self::with_buffer(options, memory)
    }

    /// An empty bag in the memory of an earlier one: memory that was written to before is
    /// several times faster than fresh memory, which the system must clear first.
    pub fn with_buffer(options: WriterOptions, memory: Vec<u8>) -> Self {
        let mut out = memory;
        out.clear();
        out.extend_from_slice(MAGIC);
        out.resize(MAGIC.len() + FILE_HEADER_LENGTH, 0);
        let high_water = out.len() as u64;
        Self {
            compressor: Compressor::new(options.compression),
            options,
            out,
            spilled: 0,
            pending: Vec::new(),
            open: None,
            connections: Vec::new(),
            touched: Vec::new(),
            times: (u64::MAX, 0),
            chunks: Vec::new(),
            index_bytes: 0,
            messages: 0,
            high_water,
        }
    }

    /// Adds a connection and returns its id in this bag; the id that it has is not kept. It
    /// is written with its first message: a connection without any leaves no trace.
    pub fn add_connection(&mut self, connection: &Connection) -> u32 {
        let id = self.connections.len() as u32;
        let connection = Connection { id, ..connection.clone() };
        self.connections.push(Written { connection, declared: false, index: Vec::new() });
        id
    }

    /// Leaves ids out, so that the next connection gets `next` at the least.
    pub(crate) fn skip_ids(&mut self, next: u32) {
        while self.connections.len() < next as usize {
            self.add_connection(&Connection::default());
        }
    }

    /// Appends a message. On `BudgetExceeded` nothing was written, and the bag so far can
    /// still be finished.
    pub fn write(&mut self, connection: u32, time_ns: u64, data: &[u8]) -> Result<(), BagError> {
        let at = connection as usize;
        let written = self.connections.get(at).ok_or(BagError::UnknownConnection(connection))?;
        let length = u32::try_from(data.len()).map_err(|_| BagError::MessageTooLong(data.len()))?;
        let mut grown = MESSAGE_OVERHEAD + data.len();
        let mut index = INDEX_ENTRY;
        if !written.declared {
            // Once in the chunk and once in the tail.
            let record = connection_record(&written.connection).len();
            grown += record;
            index += record;
        }
        if written.index.is_empty() {
            index += INDEX_OVERHEAD;
        }
        if self.open.is_none() {
            index += CHUNK_OVERHEAD;
        } else if self.chunk_length() + grown > u32::MAX as usize {
            self.close_chunk()?;
        }
        self.check_budget((grown + index) as u64)?;
        self.index_bytes += index;
        self.begin_chunk();
        self.append_message(at, time_ns, length, data);
        self.high_water = self.high_water.max(self.size());
        if self.chunk_length() >= self.options.chunk_threshold {
            self.close_chunk()?;
        }
        Ok(())
    }

    /// True once a reader that goes from front to back knows the connection here.
    pub(crate) fn declares(&self, connection: u32) -> bool {
        self.connections.get(connection as usize).is_some_and(|written| written.declared)
    }

    /// Appends a chunk of another bag as it is, with its INDEX records. Its connections must
    /// have the same ids here, and be declared here before or by the chunk itself.
    pub(crate) fn append_chunk(
        &mut self,
        chunk: &ChunkInfo,
        data: &[u8],
        index: &[u8],
    ) -> Result<(), BagError> {
        self.close_chunk()?;
        self.collect(true)?;
        let tail = CHUNK_OVERHEAD + chunk.counts.len() * 8;
        self.check_budget((tail + data.len() + index.len()) as u64)?;
        self.index_bytes += tail;
        let position = self.position();
        chunk_header(chunk.compression, chunk.size).record_into(data, &mut self.out);
        self.out.extend_from_slice(index);
        for (id, _) in &chunk.counts {
            if let Some(written) = self.connections.get_mut(*id as usize) {
                written.declared = true;
            }
        }
        self.messages += chunk.messages();
        self.high_water = self.high_water.max(self.size());
        let (start, end, counts) = (chunk.start, chunk.end, chunk.counts.clone());
        self.chunks.push((position, Closed { start, end, counts }));
        Ok(())
    }

    /// The most bytes that the bag, finished then, would have had at any time.
    pub fn high_water(&self) -> u64 {
        self.high_water
    }

    /// Messages written so far.
    pub fn messages(&self) -> u64 {
        self.messages
    }

    /// Writes the index, completes the file header and returns the bag.
    ///
    /// Not for a bag that was spilled: its beginning is elsewhere.
    pub fn finish(mut self) -> Result<Vec<u8>, BagError> {
        let header = self.complete()?;
        self.out[MAGIC.len()..MAGIC.len() + FILE_HEADER_LENGTH].copy_from_slice(&header);
        Ok(self.out)
    }

    /// Appends the chunks that are whole to `file` and lets go of them: the way without a bag
    /// in memory. Once begun, the same file takes all of them and [`BagWriter::finish_spilled`].
    pub fn spill(&mut self, file: &mut impl Write) -> Result<(), BagError> {
        if self.open.is_some() && self.options.compression == Compression::None {
            return Ok(());
        }
        let (offset, length) = (self.spilled, self.out.len());
        file.write_all(&self.out).map_err(|source| BagError::Unwritten { offset, source })?;
        self.spilled += length as u64;
        self.out.clear();
        Ok(())
    }

    /// [`BagWriter::finish`] of a bag that lies in `file`, whose length in bytes is returned.
    pub fn finish_spilled(mut self, file: &mut (impl Write + Seek)) -> Result<u64, BagError> {
        let header = self.complete()?;
        self.spill(file)?;
        let offset = MAGIC.len() as u64;
        file.seek(SeekFrom::Start(offset))
            .and_then(|_| file.write_all(&header))
            .map_err(|source| BagError::Unwritten { offset, source })?;
        Ok(self.spilled)
    }

    /// Writes all but the file header record, which is returned.
    fn complete(&mut self) -> Result<Vec<u8>, BagError> {
        self.close_chunk()?;
        self.collect(true)?;
        let index_position = self.position();
        let mut declared = 0;
        for written in self.connections.iter().filter(|written| written.declared) {
            self.out.extend_from_slice(&connection_record(&written.connection));
            declared += 1;
        }
        for (position, chunk) in &self.chunks {
            chunk_info(*position, (chunk.start, chunk.end), &chunk.counts, &mut self.out);
        }
        Ok(file_header(index_position, declared, self.chunks.len() as u32))
    }

    /// Where in the bag its next byte will lie.
    fn position(&self) -> u64 {
        self.spilled + self.out.len() as u64
    }

    /// Bytes that the bag would have if it were finished now (before compression).
    fn size(&self) -> u64 {
        let made = self.pending.len() + self.index_bytes;
        self.position() + made as u64 + self.compressor.bytes()
    }

    fn check_budget(&mut self, more: u64) -> Result<(), BagError> {
        let Some(budget) = self.options.byte_budget else {
            return Ok(());
        };
        if self.size() + more > budget {
            // Refused only for what is left once all is compressed: the same on every run.
            self.collect(true)?;
        }
        let needed = self.size() + more;
        if needed > budget { Err(BagError::BudgetExceeded { budget, needed }) } else { Ok(()) }
    }

    fn chunk_length(&self) -> usize {
        match (self.open, self.options.compression) {
            (None, _) => 0,
            (Some((_, data)), Compression::None) => self.out.len() - data,
            (Some(_), _) => self.pending.len(),
        }
    }

    fn begin_chunk(&mut self) {
        if self.open.is_some() {
            return;
        }
        let position = self.out.len();
        if self.options.compression == Compression::None {
            // Its two sizes are written when the chunk is closed.
            chunk_header(Compression::None, 0).record_into(&[], &mut self.out);
        }
        self.open = Some((position, self.out.len()));
        self.times = (u64::MAX, 0);
    }

    fn append_message(&mut self, at: usize, time: u64, length: u32, data: &[u8]) {
        let (chunk, base) = match (self.options.compression, self.open) {
            (Compression::None, Some((_, data))) => (&mut self.out, data),
            _ => (&mut self.pending, 0),
        };
        let written = &mut self.connections[at];
        if !written.declared {
            chunk.extend_from_slice(&connection_record(&written.connection));
            written.declared = true;
        }
        if written.index.is_empty() {
            self.touched.push(at as u32);
        }
        let header = message_header(at as u32, time, length);
        written.index.extend_from_slice(&header[TIME_IN_HEADER..TIME_IN_HEADER + 8]);
        written.index.extend_from_slice(&((chunk.len() - base) as u32).to_le_bytes());
        chunk.reserve(header.len() + data.len());
        chunk.extend_from_slice(&header);
        chunk.extend_from_slice(data);
        self.times = (self.times.0.min(time), self.times.1.max(time));
        self.messages += 1;
    }

    fn close_chunk(&mut self) -> Result<(), BagError> {
        let Some((position, data)) = self.open.take() else {
            return Ok(());
        };
        let compression = self.options.compression;
        let full = self.index_of_chunk();
        if compression == Compression::None {
            let length = (self.out.len() - data) as u32;
            let mut record = Vec::new();
            chunk_header(compression, length).record_into(&[], &mut record);
            // The record ends in its data's length, which is the chunk's as well.
            self.out[position..data].copy_from_slice(&record);
            self.out[data - 4..data].copy_from_slice(&length.to_le_bytes());
            self.append_index(position, full);
            return Ok(());
        }
        self.compressor.push(&mut self.pending, full).map_err(BagError::Compress)?;
        self.collect(false)
    }

    /// Appends the chunks that have been compressed by now, or all.
    fn collect(&mut self, all: bool) -> Result<(), BagError> {
        while let Some(chunk) = self.compressor.pop(all).map_err(BagError::Compress)? {
            let Compressed { buffer, used, length, rest } = chunk;
            let position = self.out.len();
            let header = chunk_header(self.options.compression, length);
            header.record_into(&buffer[..used], &mut self.out);
            self.compressor.give_back(buffer);
            self.append_index(position, rest);
        }
        Ok(())
    }

    fn append_index(&mut self, position: usize, full: Full) {
        let record = (INDEX_OVERHEAD - 8) * full.closed.counts.len();
        let entries: u64 = full.closed.counts.iter().map(|(_, count)| u64::from(*count)).sum();
        self.index_bytes = self.index_bytes.saturating_sub(entries as usize * INDEX_ENTRY + record);
        self.out.extend_from_slice(&full.index);
        self.chunks.push((self.spilled + position as u64, full.closed));
    }

    /// The INDEX records of the open chunk, which is empty then.
    fn index_of_chunk(&mut self) -> Full {
        self.touched.sort_unstable();
        let mut counts = Vec::with_capacity(self.touched.len());
        let mut records = Vec::new();
        for id in self.touched.drain(..) {
            let index = &mut self.connections[id as usize].index;
            counts.push((id, index_record(id, index, &mut records)));
            index.clear();
        }
        let (start, end) = self.times;
        Full { index: records, closed: Closed { start, end, counts } }
    }
}
