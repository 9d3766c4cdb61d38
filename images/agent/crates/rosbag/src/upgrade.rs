//! Bags of format 1.2, read as what they would be in 2.0: there are no chunks, and a topic
//! stands where 2.0 has a connection.

use std::collections::{BTreeMap, HashMap};

use crate::build::message_header;
use crate::record::{Fields, FileRecord, OP_INDEX, OP_MESSAGE, read_bytes};
use crate::{Bag, BagError, ChunkInfo, ChunkedFile, Compression, Connection, Limits, Loss};

/// The line that every bag 1.2 begins with.
const OLD_MAGIC: &[u8; 13] = b"#ROSBAG V1.2\n";
const OP_DEFINITION: u8 = 1;
/// Messages are gathered in chunks of at least this many bytes, as a recorder of 2.0 does.
const CHUNK: usize = 768 << 10;
/// An entry of an INDEX record: time and position.
const ENTRY: u64 = 16;

/// True for a bag of format 1.2.
pub(crate) fn is_old(file: &impl ChunkedFile) -> bool {
    read_bytes(file, 0, OLD_MAGIC.len() as u32, "the first line")
        .is_ok_and(|line| *line == OLD_MAGIC[..])
}

/// What is known of a bag 1.2 beside its messages.
#[derive(Debug)]
pub(crate) struct Old {
    /// How many messages its index counts; `None` when there is no index.
    pub indexed: Option<u64>,
}

/// Topic, publisher, latching: what makes a connection of a message.
type Publisher = (String, Option<String>, bool);

/// The messages so far.
struct Reader<'f, F> {
    file: &'f F,
    limits: Limits,
    /// Bytes that were made of the file's so far.
    made: u64,
    /// By topic, as the definition record says.
    definitions: HashMap<String, Connection>,
    ids: HashMap<Publisher, u32>,
    connections: Vec<Connection>,
    chunks: Vec<(ChunkInfo, Vec<u8>)>,
    open: Vec<u8>,
    times: (u64, u64),
    counts: BTreeMap<u32, u32>,
    indexed: u64,
}

/// Fills the bag with every whole message of a file 1.2, in the file's order; all of them are
/// rebuilt in memory, which the bag's limit bounds.
pub(crate) fn read_old<F: ChunkedFile>(mut bag: Bag<F>) -> Result<Bag<F>, BagError> {
    let header = FileRecord::read(&bag.file, OLD_MAGIC.len() as u64)?;
    let index_position = Fields::require_u64(&header.header, "index_pos").unwrap_or(0);
    let (first, length) = (header.end(), bag.file.len());
    drop(header);
    let mut reader = Reader::new(&bag.file, bag.limits);
    let mut at = first;
    let mut loss = None;
    if at > length {
        let description = "the rest of the file header record".to_owned();
        let (offset, bytes) = (length, at - length);
        loss = Some(Loss { offset, bytes, messages: None, description });
    }
    let mut begun = at;
    while at < length {
        match reader.record(at) {
            Ok(next) => at = next,
            Err(BagError::Damaged { offset, expected }) => {
                let bytes = length - at;
                loss = Some(Loss { offset, bytes, messages: None, description: expected });
                break;
            }
            Err(error) => return Err(error),
        }
        if reader.open.len() >= CHUNK {
            reader.close((begun, at));
            begun = at;
        }
    }
    reader.close((begun, at));
    let kept: u64 = reader.chunks.iter().map(|(chunk, _)| chunk.messages()).sum();
    if let Some(loss) = loss.as_mut().filter(|_| index_position >= at) {
        loss.messages = counted(&bag.file, index_position).map(|all| all.saturating_sub(kept));
    }
    let indexed = (index_position > 0).then_some(reader.indexed);
    let Reader { connections, chunks, .. } = reader;
    connections.into_iter().for_each(|each| bag.add_connection(each));
    chunks.into_iter().for_each(|(chunk, bytes)| bag.add_chunk(chunk, Some(bytes)));
    (bag.loss, bag.old) = (loss, Some(Old { indexed }));
    Ok(bag)
}

/// What the INDEX records at `at` and behind count; `None` if one of them is not whole.
fn counted(file: &impl ChunkedFile, mut at: u64) -> Option<u64> {
    let mut all = 0;
    while at < file.len() {
        let record = FileRecord::read(file, at).ok().filter(|record| record.op == OP_INDEX)?;
        let count = u64::from(Fields::require_u32(&record.header, "count").ok()?);
        // A count that has no entries behind it is no count.
        if record.end() > file.len() || count * ENTRY != u64::from(record.data_length) {
            return None;
        }
        all += count;
        at = record.end();
    }
    Some(all)
}

impl<'f, F: ChunkedFile> Reader<'f, F> {
    fn new(file: &'f F, limits: Limits) -> Self {
        Self {
            file,
            limits,
            made: 0,
            definitions: HashMap::new(),
            ids: HashMap::new(),
            connections: Vec::new(),
            chunks: Vec::new(),
            open: Vec::new(),
            times: (u64::MAX, 0),
            counts: BTreeMap::new(),
            indexed: 0,
        }
    }

    /// Takes over one record; returns where the next begins.
    fn record(&mut self, at: u64) -> Result<u64, BagError> {
        let record = FileRecord::read(self.file, at)?;
        let fail = |defect| record.in_header(defect);
        let text = |name| {
            let value = Fields::require(&record.header, name).map_err(fail)?;
            Ok::<_, BagError>(String::from_utf8_lossy(value).into_owned())
        };
        match record.op {
            OP_DEFINITION => {
                let connection = Connection {
                    topic: text("topic")?,
                    datatype: text("type")?,
                    md5sum: text("md5")?,
                    definition: text("def")?.into(),
                    ..Connection::default()
                };
                self.definitions.insert(connection.topic.clone(), connection);
            }
            OP_MESSAGE => {
                let seconds = Fields::require_u32(&record.header, "sec").map_err(fail)?;
                let nanos = Fields::require_u32(&record.header, "nsec").map_err(fail)?;
                let time = u64::from(seconds) * 1_000_000_000 + u64::from(nanos);
                let caller = Fields::find(&record.header, "callerid").map_err(fail)?;
                let caller = caller.map(|name| String::from_utf8_lossy(name).into_owned());
                let latching = Fields::find(&record.header, "latching").map_err(fail)?;
                let publisher = (text("topic")?, caller, latching == Some(b"1"));
                let data = record.data(self.file)?;
                let id = self.connection(at, publisher)?.ok_or_else(|| {
                    let expected = "a definition of the message's topic before it";
                    BagError::damaged(record.header_position, expected)
                })?;
                self.message(at, id, time, &data)?;
            }
            OP_INDEX => {
                let count = Fields::require_u32(&record.header, "count").map_err(fail)?;
                record.data(self.file)?;
                self.indexed += u64::from(count);
            }
            op => {
                let expected = format!("a definition (1), message (2) or index (4), found op {op}");
                return Err(BagError::damaged(record.header_position, expected));
            }
        }
        Ok(record.end())
    }

    /// The id of a publisher's connection; `None` when its topic has no definition yet.
    fn connection(&mut self, at: u64, publisher: Publisher) -> Result<Option<u32>, BagError> {
        if let Some(id) = self.ids.get(&publisher) {
            return Ok(Some(*id));
        }
        let (_, caller_id, latching) = publisher.clone();
        let Some(known) = self.definitions.get(&publisher.0) else {
            return Ok(None);
        };
        // One definition may serve many publishers, each of which gets a copy of it.
        let copied = known.topic.len() + known.datatype.len() + known.definition.len();
        let id = self.connections.len() as u32;
        let connection = Connection { id, caller_id, latching, ..known.clone() };
        self.take(at, copied)?;
        self.connections.push(connection);
        self.ids.insert(publisher, id);
        Ok(Some(id))
    }

    fn message(&mut self, at: u64, id: u32, time: u64, data: &[u8]) -> Result<(), BagError> {
        let header = message_header(id, time, data.len() as u32);
        let grown = header.len() + data.len();
        if self.open.len() + grown > u32::MAX as usize {
            return Err(BagError::MessageTooLong(data.len()));
        }
        self.take(at, grown)?;
        self.open.extend_from_slice(&header);
        self.open.extend_from_slice(data);
        self.times = (self.times.0.min(time), self.times.1.max(time));
        *self.counts.entry(id).or_default() += 1;
        Ok(())
    }

    /// Counts memory before it is taken.
    fn take(&mut self, offset: u64, bytes: usize) -> Result<(), BagError> {
        let needed = bytes as u64;
        let allowed = self.limits.decompressed_bytes.saturating_sub(self.made);
        if needed > allowed {
            return Err(BagError::MemoryLimit { offset, needed, allowed });
        }
        self.made += needed;
        Ok(())
    }

    /// Closes the chunk of what stood between those places of the file.
    fn close(&mut self, (begun, end): (u64, u64)) {
        if self.open.is_empty() {
            return;
        }
        let bytes = std::mem::take(&mut self.open);
        let (start, last) = std::mem::replace(&mut self.times, (u64::MAX, 0));
        let size = bytes.len() as u32;
        let chunk = ChunkInfo {
            position: begun,
            start,
            end: last,
            counts: std::mem::take(&mut self.counts).into_iter().collect(),
            compression: Compression::None,
            data_position: begun,
            data_length: u32::try_from(end - begun).unwrap_or(u32::MAX),
            size,
            usable: size,
            damaged: false,
        };
        self.chunks.push((chunk, bytes));
    }
}
