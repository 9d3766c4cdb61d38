//! Writing MCAP into memory, within a byte budget; or, chunk by chunk, into a file.

mod chunk;

use std::collections::HashMap;
use std::io::Write;

use bagpipe_log::Connection;
use bagpipe_packing::Compressor;
use crc32fast::Hasher;

use self::chunk::Full;
use crate::build::{
    ChunkHead, INDEX_ENTRY, INDEX_RECORD, attachment, channel, data_end, header, message_head,
    metadata, schema,
};
use crate::summary::{Grown, Summary};
use crate::walk::LEAST_MESSAGE;
use crate::{
    Attachment, Channel, Compression, MAGIC, McapError, Metadata, Schema, Stamp, connection,
};

/// Who wrote the file.
const LIBRARY: &str = concat!("bagpipe ", env!("CARGO_PKG_VERSION"));

/// How a recording is written.
#[derive(Debug, Clone)]
pub struct WriterOptions {
    /// How chunks are compressed.
    pub compression: Compression,
    /// A chunk is closed once it holds this many bytes; 768 KiB is the default of rosbag2.
    pub chunk_threshold: usize,
    /// What system all channels are of: `ros1`, `ros2`, or nothing in particular.
    pub profile: String,
    /// The finished recording may not be larger than this.
    pub byte_budget: Option<u64>,
}

impl Default for WriterOptions {
    fn default() -> Self {
        Self {
            compression: Compression::None,
            chunk_threshold: 768 * 1024,
            profile: String::new(),
            byte_budget: None,
        }
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
    channel: Channel,
    /// The place of its schema, if it has one.
    schema: Option<usize>,
    declared: bool,
    /// Time and place of each of its messages in the open chunk.
    index: Vec<u8>,
}

/// Writes messages into an MCAP file in memory.
#[derive(Debug)]
pub struct McapWriter {
    options: WriterOptions,
    /// The file so far; an uncompressed chunk is written straight into it.
    out: Vec<u8>,
    /// Bytes of the file that went before `out` into another.
    spilled: u64,
    /// The CRC-32 of the file so far, of which so many bytes lie in `out`.
    crc: Hasher,
    checked: usize,
    /// The open chunk, when it must be compressed first.
    pending: Vec<u8>,
    /// Full chunks that other threads compress.
    compressor: Compressor<Compression, Full>,
    /// Where the open chunk's record (not compressed) and its records begin in `out`.
    open: Option<(usize, usize)>,
    /// Each with whether it is declared.
    schemas: Vec<(Schema, bool)>,
    schema_at: HashMap<(String, String, Vec<u8>), usize>,
    /// By the channels' numbers less one.
    channels: Vec<Written>,
    /// Channels with messages in the open chunk.
    touched: Vec<u16>,
    times: (u64, u64),
    chunks_begun: bool,
    summary: Summary,
    /// Bytes behind the data and in message indexes that everything written so far will take.
    later: usize,
    high_water: u64,
}

impl McapWriter {
    /// An empty recording. An uncompressed one with a budget reserves it: memory that is
    /// reserved and not written to costs nothing, and a file that grows does not move.
    pub fn new(options: WriterOptions) -> Self {
        let mut memory = Vec::new();
        if let (Compression::None, Some(budget)) = (options.compression, options.byte_budget) {
            // Where the system refuses, the file grows as it must.
            let _ = memory.try_reserve_exact(usize::try_from(budget).unwrap_or(0));
        }
        Self::with_buffer(options, memory)
    }

    /// An empty recording in the memory of an earlier one: memory that was written to before
    /// is several times faster than fresh memory, which the system must clear first.
    pub fn with_buffer(options: WriterOptions, memory: Vec<u8>) -> Self {
        let mut out = memory;
        out.clear();
        out.extend_from_slice(MAGIC);
        header(&options.profile, LIBRARY, &mut out);
        let high_water = (out.len() + Summary::EMPTY) as u64;
        Self {
            compressor: Compressor::new(options.compression),
            options,
            out,
            spilled: 0,
            crc: Hasher::new(),
            checked: 0,
            pending: Vec::new(),
            open: None,
            schemas: Vec::new(),
            schema_at: HashMap::new(),
            channels: Vec::new(),
            touched: Vec::new(),
            times: (0, 0),
            chunks_begun: false,
            summary: Summary::counting_from(1),
            later: Summary::EMPTY,
            high_water,
        }
    }

    /// Adds a connection and returns its id in this recording; the id that it has is not kept.
    /// It is written with its first message: a connection without any leaves no trace.
    pub fn add_connection(&mut self, connection: &Connection) -> u32 {
        let (schema, channel) = connection::channel(connection);
        self.add_channel(schema.as_ref(), &channel)
    }

    /// The same with all that a file may say of a channel. Numbers that it comes with are not
    /// kept.
    pub fn add_channel(&mut self, schema: Option<&Schema>, channel: &Channel) -> u32 {
        let schema = schema.map(|schema| self.add_schema(schema));
        self.add_channel_of(schema, channel)
    }

    /// The same with what [`McapWriter::add_schema`] returned of its type, so that this is looked
    /// at once for many channels.
    pub fn add_channel_of(&mut self, schema: Option<usize>, channel: &Channel) -> u32 {
        let id = self.channels.len() as u32 + 1;
        let number = |at: usize| u16::try_from(at + 1).unwrap_or(u16::MAX);
        let channel = Channel {
            id: number(id as usize - 1),
            schema_id: schema.map_or(0, number),
            ..channel.clone()
        };
        self.channels.push(Written { channel, schema, declared: false, index: Vec::new() });
        self.summary.counts.push(0);
        id
    }

    /// The place of that schema, which is added if it is new. It is written with the first message
    /// of a channel of it.
    pub fn add_schema(&mut self, schema: &Schema) -> usize {
        let key = (schema.name.clone(), schema.encoding.clone(), schema.data.clone());
        let next = self.schemas.len();
        let at = *self.schema_at.entry(key).or_insert(next);
        if at == next {
            let id = u16::try_from(at + 1).unwrap_or(u16::MAX);
            self.schemas.push((Schema { id, ..schema.clone() }, false));
        }
        at
    }

    /// Appends a message that was published when it was recorded, without a number of its own.
    ///
    /// # Errors
    /// As [`McapWriter::write_stamped`].
    pub fn write(&mut self, connection: u32, time_ns: u64, data: &[u8]) -> Result<(), McapError> {
        self.write_stamped(connection, time_ns, Stamp { sequence: 0, publish_time: time_ns }, data)
    }

    /// Appends a message. On [`McapError::BudgetExceeded`] nothing was written, and the
    /// recording so far can still be finished.
    ///
    /// # Errors
    /// Of a message that can't be written: [`McapError::BudgetExceeded`],
    /// [`McapError::UnknownConnection`], [`McapError::TooManyChannels`] or
    /// [`McapError::MessageTooLong`]. [`McapError::Compress`] for those before it.
    pub fn write_stamped(
        &mut self,
        connection: u32,
        time_ns: u64,
        stamp: Stamp,
        data: &[u8],
    ) -> Result<(), McapError> {
        let at = (connection as usize).wrapping_sub(1);
        let written = self.channels.get(at).ok_or(McapError::UnknownConnection(connection))?;
        let id = u16::try_from(connection).map_err(|_| McapError::TooManyChannels(connection))?;
        let declared = declaration(written, &self.schemas);
        let mut grown = declared.len() + LEAST_MESSAGE + data.len();
        if grown > u32::MAX as usize {
            return Err(McapError::MessageTooLong(data.len()));
        }
        if self.open.is_some() && self.chunk_length() + grown > u32::MAX as usize {
            self.close_chunk()?;
        }
        let begins = self.open.is_none();
        if begins {
            grown += ChunkHead::len(self.options.compression);
        }
        let later = self.growth(at, begins);
        self.check_budget((grown + later) as u64)?;
        self.later += later;
        self.begin_chunk(time_ns);
        self.append(at, &declared, &message_head(id, time_ns, stamp, data.len()), data);
        self.times = (self.times.0.min(time_ns), self.times.1.max(time_ns));
        self.summary.count(id, time_ns);
        self.high_water = self.high_water.max(self.size());
        if self.chunk_length() >= self.options.chunk_threshold {
            self.close_chunk()?;
        }
        Ok(())
    }

    /// Appends a file, which lies outside of the chunks.
    ///
    /// # Errors
    /// [`McapError::BudgetExceeded`], [`McapError::Compress`].
    pub fn attach(&mut self, file: &Attachment<'_>) -> Result<(), McapError> {
        let mut record = Vec::new();
        attachment(file, &mut record);
        let position = self.append_record(&record, self.summary.growth_by_attachment(file))?;
        self.summary.attached(file, position, record.len() as u64);
        Ok(())
    }

    /// Appends words about the recording.
    ///
    /// # Errors
    /// As [`McapWriter::attach`].
    pub fn describe(&mut self, words: &Metadata) -> Result<(), McapError> {
        let mut record = Vec::new();
        metadata(words, &mut record);
        let position = self.append_record(&record, self.summary.growth_by_metadata(words))?;
        self.summary.described(words, position, record.len() as u64);
        Ok(())
    }

    /// The most bytes that the recording, finished then, would have had at any time; of what is
    /// to be compressed and is not yet, by its bytes before that.
    pub fn high_water(&self) -> u64 {
        self.high_water
    }

    /// Messages written so far.
    pub fn messages(&self) -> u64 {
        self.summary.messages
    }

    /// Writes the summary and returns the file.
    ///
    /// Not for a recording that was spilled: its beginning is elsewhere.
    ///
    /// # Errors
    /// [`McapError::Compress`].
    pub fn finish(mut self) -> Result<Vec<u8>, McapError> {
        self.complete()?;
        Ok(self.out)
    }

    /// Appends the chunks that are whole to `file` and lets go of them: the way without a
    /// recording in memory. Once begun, the same file takes all of them and
    /// [`McapWriter::finish_spilled`].
    ///
    /// # Errors
    /// [`McapError::Unwritten`].
    pub fn spill(&mut self, file: &mut impl Write) -> Result<(), McapError> {
        if self.open.is_some() && self.options.compression == Compression::None {
            return Ok(());
        }
        self.check_up_to(self.out.len());
        let (offset, length) = (self.spilled, self.out.len());
        file.write_all(&self.out).map_err(|source| McapError::Unwritten { offset, source })?;
        self.spilled += length as u64;
        self.out.clear();
        self.checked = 0;
        Ok(())
    }

    /// [`McapWriter::finish`] of a recording that lies in `file`, whose length in bytes is
    /// returned.
    ///
    /// # Errors
    /// [`McapError::Compress`], [`McapError::Unwritten`].
    pub fn finish_spilled(mut self, file: &mut impl Write) -> Result<u64, McapError> {
        self.complete()?;
        self.spill(file)?;
        Ok(self.spilled)
    }

    fn complete(&mut self) -> Result<(), McapError> {
        self.settle()?;
        self.check_up_to(self.out.len());
        data_end(self.crc.clone().finalize(), &mut self.out);
        let position = self.position();
        self.summary.write(position, &mut self.out);
        Ok(())
    }

    /// Where in the file its next byte will lie.
    fn position(&self) -> u64 {
        self.spilled + self.out.len() as u64
    }

    /// Bytes that the file would have if it were finished now (before compression).
    fn size(&self) -> u64 {
        let pending = if self.pending.is_empty() { 0 } else { self.pending.len() + self.head() };
        let waiting = self.compressor.bytes() + (self.compressor.len() * self.head()) as u64;
        self.position() + (pending + self.later) as u64 + waiting
    }

    fn head(&self) -> usize {
        ChunkHead::len(self.options.compression)
    }

    fn check_budget(&mut self, more: u64) -> Result<(), McapError> {
        let Some(budget) = self.options.byte_budget else {
            return Ok(());
        };
        if self.size() + more > budget {
            // Refused only for what is left once all is compressed: the same on every run.
            self.collect(true)?;
        }
        let needed = self.size() + more;
        if needed > budget { Err(McapError::BudgetExceeded { budget, needed }) } else { Ok(()) }
    }

    /// How many bytes a message of that channel adds behind the chunk's records.
    fn growth(&self, at: usize, begins: bool) -> usize {
        let written = &self.channels[at];
        let new = written.schema.map(|at| &self.schemas[at]).filter(|(_, declared)| !declared);
        let length = |write: &dyn Fn(&mut Vec<u8>)| {
            let mut record = Vec::new();
            write(&mut record);
            record.len()
        };
        let touched = written.index.is_empty();
        let grown = Grown {
            channel: (!written.declared).then(|| length(&|out| channel(&written.channel, out))),
            schema: new.map(|(new, _)| length(&|out| schema(new, out))),
            chunk: begins.then_some(self.options.compression),
            touched,
        };
        let index = INDEX_ENTRY + if touched { INDEX_RECORD } else { 0 };
        self.summary.growth(grown, !self.chunks_begun) + index
    }

    fn chunk_length(&self) -> usize {
        match (self.open, self.options.compression) {
            (None, _) => 0,
            (Some((_, data)), Compression::None) => self.out.len() - data,
            (Some(_), _) => self.pending.len(),
        }
    }

    /// Closes the chunk and waits for all that are compressed.
    fn settle(&mut self) -> Result<(), McapError> {
        self.close_chunk()?;
        self.collect(true)
    }

    /// Appends a record outside of chunks, and returns where it begins.
    fn append_record(&mut self, record: &[u8], later: usize) -> Result<u64, McapError> {
        self.check_budget((record.len() + later) as u64)?;
        self.settle()?;
        self.later += later;
        let position = self.position();
        self.out.extend_from_slice(record);
        self.high_water = self.high_water.max(self.size());
        Ok(position)
    }

    /// Takes what lies before `end` in `out` into the checksum, if it is not there yet.
    fn check_up_to(&mut self, end: usize) {
        self.crc.update(&self.out[self.checked..end]);
        self.checked = end;
    }
}

/// The records that a channel's first message brings along.
fn declaration(written: &Written, schemas: &[(Schema, bool)]) -> Vec<u8> {
    let mut records = Vec::new();
    if written.declared {
        return records;
    }
    if let Some((new, false)) = written.schema.map(|at| &schemas[at]) {
        schema(new, &mut records);
    }
    channel(&written.channel, &mut records);
    records
}
