//! A bag: its connections, its chunks, and the way to its messages.

use std::collections::HashMap;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::file::ReadAhead;
use crate::record::{
    FieldDefect, Fields, FileRecord, OP_CHUNK, OP_CHUNK_INFO, OP_CONNECTION, OP_FILE_HEADER,
    connection, read_bytes, time_at, u32_at, u64_at,
};
use crate::scan::scan;
use crate::unpack::chunk_bytes;
use crate::upgrade::{Old, is_old, read_old};
use crate::{
    BagError, ChunkInfo, ChunkedFile, Compression, Connection, Loss, MAGIC, Messages, Timeline,
    Window,
};

/// How much memory reading a bag may take beside the bag's own bytes.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Uncompressed bytes of all chunks together; `u64::MAX` is no limit. A chunk of its own
    /// is below 4 GiB by the format.
    pub decompressed_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { decompressed_bytes: u64::MAX }
    }
}

/// The index is read in pieces of this many bytes.
const INDEX_WINDOW: usize = 1 << 20;
/// A CHUNK record's header is shorter than this as everybody writes it.
const CHUNK_WINDOW: usize = 128;

/// What the file header record says.
struct Start {
    /// Where the index begins; 0 when there is none.
    index_position: u64,
    /// Where the first record behind the header begins.
    first: u64,
    /// How many chunks the index must know.
    chunks: u32,
}

/// A bag 2.0, or 1.2, over any [`ChunkedFile`].
#[derive(Debug)]
pub struct Bag<F: ChunkedFile> {
    pub(crate) file: F,
    pub(crate) connections: Vec<Connection>,
    pub(crate) by_id: HashMap<u32, usize>,
    pub(crate) chunks: Vec<ChunkInfo>,
    /// Uncompressed chunks that had to be made, each once; those that lie in memory as they
    /// are stay empty.
    pub(crate) made: Vec<OnceLock<Vec<u8>>>,
    /// The bytes of all of them.
    pub(crate) made_bytes: AtomicU64,
    pub(crate) limits: Limits,
    pub(crate) loss: Option<Loss>,
    /// Set for a bag of format 1.2: its chunks are made, and lie nowhere in the file.
    pub(crate) old: Option<Old>,
}

impl<F: ChunkedFile> Bag<F> {
    /// Opens a bag by its index (only its tail and its chunks' headers are read). Without
    /// an index, or with one that is damaged, its records are scanned as by
    /// [`Bag::open_unindexed`]. A bag of format 1.2 is read into memory as what it would be
    /// in 2.0.
    pub fn open(file: F) -> Result<Self, BagError> {
        Self::open_limited(file, Limits::default())
    }

    /// [`Bag::open`] with bounded memory.
    pub fn open_limited(file: F, limits: Limits) -> Result<Self, BagError> {
        let mut bag = Self::empty(file, limits);
        if is_old(&bag.file) {
            return read_old(bag);
        }
        let Start { index_position, first, chunks } = bag.read_file_header()?;
        if index_position == 0 {
            return scan(bag, first, None);
        }
        match bag.read_index(index_position, chunks) {
            Ok(()) => Ok(bag),
            Err(damage) => {
                let Self { file, .. } = bag;
                scan(Self::empty(file, limits), first, Some(damage))
            }
        }
    }

    /// By the index alone: `None` when there is none, and damage is an error.
    pub(crate) fn open_by_index(file: F, limits: Limits) -> Result<Option<Self>, BagError> {
        let mut bag = Self::empty(file, limits);
        let Start { index_position, chunks, .. } = bag.read_file_header()?;
        if index_position == 0 {
            return Ok(None);
        }
        bag.read_index(index_position, chunks)?;
        Ok(Some(bag))
    }

    /// Reads every record from the front and never trusts the index: every whole message
    /// before damage is kept, and [`Bag::loss`] says what was lost.
    pub fn open_unindexed(file: F) -> Result<Self, BagError> {
        Self::open_unindexed_limited(file, Limits::default())
    }

    /// [`Bag::open_unindexed`] with bounded memory.
    pub fn open_unindexed_limited(file: F, limits: Limits) -> Result<Self, BagError> {
        let bag = Self::empty(file, limits);
        if is_old(&bag.file) {
            return read_old(bag);
        }
        let Start { first, .. } = bag.read_file_header()?;
        scan(bag, first, None)
    }

    /// All connections, in the order in which the bag declares them.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// The connection of that id.
    pub fn connection(&self, id: u32) -> Option<&Connection> {
        self.by_id.get(&id).and_then(|at| self.connections.get(*at))
    }

    /// All chunks, in file order.
    pub fn chunks(&self) -> &[ChunkInfo] {
        &self.chunks
    }

    /// The format of the file: `2.0`, or `1.2`, whose chunks are made when it is opened.
    pub fn format(&self) -> &'static str {
        if self.old.is_some() { "1.2" } else { "2.0" }
    }

    /// What was lost to damage; `None` when the bag is whole as far as it has been read.
    /// (Damage inside a chunk of an indexed bag is an error of [`Bag::timeline`].)
    pub fn loss(&self) -> Option<&Loss> {
        self.loss.as_ref()
    }

    /// How many messages the bag holds, damaged ones left out.
    pub fn message_count(&self) -> u64 {
        self.chunks.iter().map(ChunkInfo::messages).sum()
    }

    /// The times of the first and the last message, in nanoseconds.
    pub fn time_range(&self) -> Option<(u64, u64)> {
        let filled = || self.chunks.iter().filter(|chunk| chunk.messages() > 0);
        let start = filled().map(|chunk| chunk.start).min()?;
        let end = filled().map(|chunk| chunk.end).max()?;
        Some((start, end))
    }

    /// The file below.
    pub fn file(&self) -> &F {
        &self.file
    }

    /// Gives the file back.
    pub fn into_file(self) -> F {
        self.file
    }

    /// All messages of the connections that `filter` keeps, in one total and stable order:
    /// by time, then chunk, then offset. Chunks without such a connection are not touched.
    /// Damage that [`Bag::loss`] does not already report is an error.
    pub fn timeline(&self, filter: impl Fn(&Connection) -> bool) -> Result<Timeline<'_>, BagError> {
        Timeline::build(self, Window::default(), filter)
    }

    /// The same without touching chunks that lie outside the window as a whole, by the times
    /// that the index states. Messages of the others are all there: [`Timeline::between`] cuts
    /// exactly.
    pub fn timeline_near(
        &self,
        window: Window,
        filter: impl Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, BagError> {
        Timeline::build(self, window, filter)
    }

    /// A chunk's uncompressed data, by its place in [`Bag::chunks`]: the file's own bytes where
    /// they lie in memory uncompressed, else made once and kept for as long as the bag. `None`
    /// when there is no such chunk.
    pub fn chunk_data(&self, at: usize) -> Option<Result<&[u8], BagError>> {
        (at < self.chunks.len()).then(|| chunk_bytes(self, at))
    }

    /// The same messages in the same order, one pass through the bag: for whoever needs each
    /// once and neither their number nor their places. An error of a chunk comes when its
    /// turn comes.
    pub fn messages(&self, filter: impl Fn(&Connection) -> bool) -> Messages<'_, F> {
        Messages::new(self, filter)
    }

    fn empty(file: F, limits: Limits) -> Self {
        Self {
            file,
            connections: Vec::new(),
            by_id: HashMap::new(),
            chunks: Vec::new(),
            made: Vec::new(),
            made_bytes: AtomicU64::new(0),
            limits,
            loss: None,
            old: None,
        }
    }

    /// Adds a connection unless its id is already known: bags repeat them.
    pub(crate) fn add_connection(&mut self, connection: Connection) {
        if !self.by_id.contains_key(&connection.id) {
            self.by_id.insert(connection.id, self.connections.len());
            self.connections.push(connection);
        }
    }

    pub(crate) fn add_chunk(&mut self, chunk: ChunkInfo, data: Option<Vec<u8>>) {
        self.chunks.push(chunk);
        let made = data.as_ref().map_or(0, Vec::len) as u64;
        self.made_bytes.fetch_add(made, Ordering::Relaxed);
        self.made.push(data.map(OnceLock::from).unwrap_or_default());
    }

    /// Uncompressed bytes that the bag holds beside the file's own.
    pub(crate) fn made_bytes(&self) -> u64 {
        self.made_bytes.load(Ordering::Relaxed)
    }

    fn read_file_header(&self) -> Result<Start, BagError> {
        let length = self.file.len().min(MAGIC.len() as u64) as u32;
        let line = read_bytes(&self.file, 0, length, "the first line")?;
        if *line != MAGIC[..] {
            let found = format!("{:?}", String::from_utf8_lossy(&line));
            return Err(BagError::NotABag { found });
        }
        let record = FileRecord::read(&self.file, MAGIC.len() as u64)?;
        if record.op != OP_FILE_HEADER {
            let expected = format!("the file header record (op 3), found op {}", record.op);
            return Err(BagError::damaged(record.header_position, expected));
        }
        let fields = &record.header;
        let encryptor =
            Fields::find(fields, "encryptor").map_err(|defect| record.in_header(defect))?;
        if let Some(encryptor) = encryptor.filter(|name| !name.is_empty()) {
            let encryptor = String::from_utf8_lossy(encryptor).into_owned();
            return Err(BagError::Encrypted { encryptor });
        }
        let fail = |defect| record.in_header(defect);
        let index_position = Fields::require_u64(fields, "index_pos").map_err(fail)?;
        let chunks = Fields::require_u32(fields, "chunk_count").map_err(fail)?;
        Ok(Start { index_position, first: record.end(), chunks })
    }

    /// Reads the CONNECTION and CHUNK_INFO records of the tail.
    fn read_index(&mut self, position: u64, chunks: u32) -> Result<(), BagError> {
        let mut at = position;
        if at > self.file.len() {
            let expected = format!("the index here, found the file's end at {}", self.file.len());
            return Err(BagError::damaged(at, expected));
        }
        let (mut connections, mut infos) = (Vec::new(), Vec::new());
        let (tail, heads) =
            (ReadAhead::new(&self.file, INDEX_WINDOW), ReadAhead::new(&self.file, CHUNK_WINDOW));
        while at < self.file.len() {
            let record = FileRecord::read(&tail, at)?;
            let data = record.data(&tail)?;
            match record.op {
                OP_CONNECTION => {
                    let found = connection(&record.header, &data)
                        .map_err(|defect| record.in_header(defect))?;
                    connections.push(found);
                }
                OP_CHUNK_INFO => infos.push(read_chunk_info(&heads, &record, &data)?),
                op => {
                    let expected = format!("a CONNECTION (7) or CHUNK_INFO (6), found op {op}");
                    return Err(BagError::damaged(record.header_position, expected));
                }
            }
            at = record.end();
        }
        for found in connections {
            self.add_connection(found);
        }
        infos.sort_by_key(|chunk| chunk.position);
        for chunk in infos {
            // By these numbers chunks are passed over: a wrong one would hide messages.
            if let Some((id, _)) = chunk.counts.iter().find(|(id, _)| !self.by_id.contains_key(id))
            {
                let at = chunk.position;
                let expected =
                    format!("declared connections in the chunk at byte {at}, found {id}");
                return Err(BagError::damaged(position, expected));
            }
            self.add_chunk(chunk, None);
        }
        // A tail that was cut between two records looks whole but for the count.
        if self.chunks.len() as u64 != u64::from(chunks) {
            let expected = format!("{chunks} CHUNK_INFO records, found {}", self.chunks.len());
            return Err(BagError::damaged(self.file.len(), expected));
        }
        Ok(())
    }
}

/// A CHUNK_INFO record, and the CHUNK record's header that it points to.
fn read_chunk_info(
    file: &impl ChunkedFile,
    record: &FileRecord<'_>,
    data: &[u8],
) -> Result<ChunkInfo, BagError> {
    let fail = |defect: FieldDefect| record.in_header(defect.into());
    let (mut position, mut start, mut end) = (None, None, None);
    let mut fields = Fields::new(&record.header);
    while let Some((name, value)) = fields.next_field().map_err(fail)? {
        match (name, value.len()) {
            (b"chunk_pos", 8) => position = u64_at(value, 0),
            (b"start_time", 8) => start = time_at(value, 0),
            (b"end_time", 8) => end = time_at(value, 0),
            _ => {}
        }
    }
    let (Some(position), Some(start), Some(end)) = (position, start, end) else {
        let expected = "fields chunk_pos, start_time and end_time of 8 bytes each";
        return Err(BagError::damaged(record.header_position, expected));
    };
    let counts = data.chunks_exact(8).filter_map(|pair| Some((u32_at(pair, 0)?, u32_at(pair, 4)?)));
    let chunk = FileRecord::read(file, position)?;
    let (compression, size) = chunk_header(&chunk)?;
    if chunk.end() > file.len() {
        let expected = format!("{} bytes of a chunk's data", chunk.data_length);
        return Err(BagError::damaged(chunk.data_position, expected));
    }
    Ok(ChunkInfo {
        position,
        start,
        end,
        counts: counts.collect(),
        compression,
        data_position: chunk.data_position,
        data_length: chunk.data_length,
        size,
        usable: size,
        damaged: false,
    })
}

/// The compression and the uncompressed size that a CHUNK record declares.
pub(crate) fn chunk_header(record: &FileRecord<'_>) -> Result<(Compression, u32), BagError> {
    let fail = |defect| record.in_header(defect);
    if record.op != OP_CHUNK {
        let expected = format!("a CHUNK record (5), found op {}", record.op);
        return Err(BagError::damaged(record.header_position, expected));
    }
    let name = Fields::require(&record.header, "compression").map_err(fail)?;
    let compression = Compression::from_name(name).ok_or_else(|| {
        let found = String::from_utf8_lossy(name);
        let expected = format!("the compression none, bz2 or lz4, found {found:?}");
        BagError::damaged(record.header_position, expected)
    })?;
    let size = Fields::require_u32(&record.header, "size").map_err(fail)?;
    if compression == Compression::None && size != record.data_length {
        let expected = format!("a size of {} bytes, found {size}", record.data_length);
        return Err(BagError::damaged(record.header_position, expected));
    }
    Ok((compression, size))
}
