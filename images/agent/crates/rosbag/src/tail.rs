//! What planning needs to know of a bag, from bytes that the caller has read: its head and its
//! tail, and of a chunk the header and the INDEX records behind it.
//!
//! Nothing here reads a file, as whoever plans over a network chooses the ranges. Other than
//! [`crate::Bag`], which keeps what is whole, this refuses a bag of which anything is missing.

use std::collections::HashMap;

use bagpipe_log::{Connection, Index, Publisher, Reason, Refusal, Span};

use crate::MAGIC;
use crate::record::{
    Field, FieldDefect, Fields, OP_CHUNK_INFO, OP_CONNECTION, OP_FILE_HEADER, OP_INDEX, Short,
    sized, time_at, u32_at, u64_at,
};

const MAX_TAIL_BYTES: u64 = 1 << 30;
/// An INDEX record has a time and an offset for each message.
const INDEX_ENTRY: usize = 12;

fn refused(reason: Reason, sentence: impl Into<String>) -> Refusal {
    Refusal { reason, sentence: sentence.into() }
}

fn unreadable(sentence: impl Into<String>) -> Refusal {
    refused(Reason::Unreadable, sentence)
}

/// What the file header record says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    /// Where the tail begins.
    pub index_position: u64,
    /// How many connections the tail must have.
    pub connections: u32,
    /// How many chunks the tail must have.
    pub chunks: u32,
}

/// Reads the file header record out of the bytes with which a file of `size` bytes begins. Its
/// magic line is not looked at.
pub fn parse_head(bytes: &[u8], size: u64) -> Result<Head, Refusal> {
    let first = MAGIC.len() as u64;
    let record = Records { bytes, base: 0, at: MAGIC.len() }
        .next_record()?
        .ok_or_else(|| unreadable(format!("no file header record at byte {first}")))?;
    if record.op != OP_FILE_HEADER {
        return Err(unreadable(format!("byte {first} holds op {}, expected op 3", record.op)));
    }
    let index_position = record.header.u64("index_pos", first)?;
    if record.header.get("encryptor").is_some_and(|name| !name.is_empty()) {
        return Err(unreadable("the bag is encrypted: decrypt it with rosbag decrypt"));
    }
    if index_position == 0 {
        let sentence = "the bag has no index (its recorder was stopped): `bagpipe bag reindex BAG \
                        --to NEW` writes it";
        return Err(refused(Reason::NotIndexed, sentence));
    }
    if !(first..=size).contains(&index_position) {
        let sentence = format!(
            "the bag is cut: its index should be at byte {index_position}, but the file ends at \
             byte {size}: copy it again, or `bagpipe bag reindex BAG --to NEW` saves what is whole"
        );
        return Err(refused(Reason::Cut, sentence));
    }
    if size - index_position > MAX_TAIL_BYTES {
        return Err(unreadable(format!("the index at byte {index_position} is above 1 GiB")));
    }
    Ok(Head {
        index_position,
        connections: record.header.u32("conn_count", first)?,
        chunks: record.header.u32("chunk_count", first)?,
    })
}

/// Reads the tail, which is all bytes of the file from `head.index_position` on.
pub fn parse_tail(bytes: &[u8], head: &Head) -> Result<Index, Refusal> {
    let base = head.index_position;
    let (mut connections, mut infos) = (Vec::new(), Vec::new());
    let mut records = Records { bytes, base, at: 0 };
    while let Some(record) = records.next_record()? {
        match record.op {
            OP_CONNECTION => connections.push(publisher(&record)?),
            OP_CHUNK_INFO => infos.push(chunk_info(&record)?),
            op => {
                let offset = record.offset;
                return Err(unreadable(format!("byte {offset} of the index holds op {op}")));
            }
        }
    }
    let expected = (head.connections as usize, head.chunks as usize);
    if (connections.len(), infos.len()) != expected {
        let sentence = format!(
            "the bag is cut: its index at byte {base} holds {} connections and {} chunks, its \
             header counts {} and {}: copy it again, or `bagpipe bag reindex BAG --to NEW` saves what \
             is whole",
            connections.len(),
            infos.len(),
            expected.0,
            expected.1
        );
        return Err(refused(Reason::Cut, sentence));
    }
    if infos.iter().all(|info| info.counts.iter().all(|(_, count)| *count == 0)) {
        return Err(refused(Reason::Empty, "the bag holds no messages"));
    }
    let declarations = connections.iter().map(|each| (each.offset, each.length)).collect();
    Ok(Index { declarations, connections, chunks: in_order(infos, base)?, counted: true })
}

/// The compression that a CHUNK record's header names, empty where it names none. `bytes` begin
/// with the record, at `base` of the file.
pub fn chunk_compression(bytes: &[u8], base: u64) -> Result<String, Refusal> {
    let header = sized(bytes, 0).map_err(|short| cut(&short, base))?;
    Ok(Header::parse(header, base)?.text("compression"))
}

/// How many bytes a CHUNK record has, by its header; `None` where `bytes`, which begin with it,
/// end too early to say.
pub fn chunk_length(bytes: &[u8], base: u64) -> Result<Option<u64>, Refusal> {
    let header = sized(bytes, 0).map_err(|short| cut(&short, base))?;
    let data = u32_at(bytes, 4 + header.len());
    Ok(data.map(|length| 4 + header.len() as u64 + 4 + u64::from(length)))
}

/// The times in nanoseconds of the messages that INDEX records name, for each connection, in the
/// order in which the records come.
pub fn index_times(bytes: &[u8], base: u64) -> Result<Vec<(u32, Vec<u64>)>, Refusal> {
    let mut times: Vec<(u32, Vec<u64>)> = Vec::new();
    let mut places = HashMap::new();
    let mut records = Records { bytes, base, at: 0 };
    while let Some(record) = records.next_record()? {
        if record.op != OP_INDEX || record.data.len() % INDEX_ENTRY != 0 {
            continue;
        }
        let connection = record.header.u32("conn", record.offset)?;
        let place = *places.entry(connection).or_insert_with(|| {
            times.push((connection, Vec::new()));
            times.len() - 1
        });
        let entries = record.data.chunks_exact(INDEX_ENTRY);
        times[place].1.extend(entries.filter_map(|entry| time_at(entry, 0)));
    }
    Ok(times)
}

/// A record's fields, and where its data lies in the bytes.
pub type Split<'a> = (Vec<Field<'a>>, usize, usize);

/// The record that begins at `at` of the bytes, which lie at `base` of the file.
pub fn split_record(bytes: &[u8], at: usize, base: u64) -> Result<Split<'_>, Refusal> {
    let short = |short: Short| cut(&short, base);
    let header = sized(bytes, at).map_err(short)?;
    let length_at = at + 4 + header.len();
    let data = sized(bytes, length_at).map_err(short)?;
    let fields = Header::parse(header, base.saturating_add(at as u64))?.0;
    Ok((fields, length_at + 4, length_at + 4 + data.len()))
}

/// What a CONNECTION record at `offset` of the file says of its publisher.
pub fn connection_fields(record: &[u8], offset: u64) -> Result<Vec<Field<'_>>, Refusal> {
    let (_, begin, end) = split_record(record, 0, offset)?;
    Ok(Header::parse(&record[begin..end], offset)?.0)
}

fn cut(short: &Short, base: u64) -> Refusal {
    let at = base.saturating_add(short.at() as u64);
    let sentence = match short {
        Short::Length { .. } => {
            format!("the bag is cut: a record's length is missing at byte {at}")
        }
        Short::Bytes { needed, left, .. } => {
            format!("the bag is cut: the record at byte {at} needs {needed} bytes, {left} are left")
        }
    };
    refused(Reason::Cut, sentence)
}

/// The fields of a header, of which the last of a name counts.
struct Header<'a>(Vec<Field<'a>>);

impl<'a> Header<'a> {
    /// `offset` is the byte of the file that errors count from.
    fn parse(bytes: &'a [u8], offset: u64) -> Result<Self, Refusal> {
        let mut found = Vec::new();
        let mut fields = Fields::new(bytes);
        loop {
            match fields.next_field() {
                Ok(Some(field)) => found.push(field),
                Ok(None) => return Ok(Self(found)),
                Err(FieldDefect::Short(short)) => return Err(cut(&short, offset)),
                Err(FieldDefect::Nameless { .. }) => {
                    let sentence = format!("a header field without '=' near byte {offset}");
                    return Err(unreadable(sentence));
                }
            }
        }
    }

    fn get(&self, name: &str) -> Option<&'a [u8]> {
        let mut last_first = self.0.iter().rev();
        last_first.find(|(found, _)| *found == name.as_bytes()).map(|(_, value)| *value)
    }

    fn text(&self, name: &str) -> String {
        String::from_utf8_lossy(self.get(name).unwrap_or_default()).into_owned()
    }

    fn of_length(&self, name: &str, length: usize, offset: u64) -> Result<&'a [u8], Refusal> {
        self.get(name)
            .filter(|value| value.len() == length)
            .ok_or_else(|| unreadable(format!("the record at byte {offset} has no valid {name}")))
    }

    fn u32(&self, name: &str, offset: u64) -> Result<u32, Refusal> {
        Ok(u32_at(self.of_length(name, 4, offset)?, 0).unwrap_or_default())
    }

    fn u64(&self, name: &str, offset: u64) -> Result<u64, Refusal> {
        Ok(u64_at(self.of_length(name, 8, offset)?, 0).unwrap_or_default())
    }

    fn time(&self, name: &str, offset: u64) -> Result<u64, Refusal> {
        Ok(time_at(self.of_length(name, 8, offset)?, 0).unwrap_or_default())
    }
}

struct Record<'a> {
    op: u8,
    header: Header<'a>,
    data: &'a [u8],
    /// Where it lies in the file, and how long it is.
    offset: u64,
    length: u64,
}

/// Walks records that lie side by side, `base` bytes behind the file's begin.
struct Records<'a> {
    bytes: &'a [u8],
    base: u64,
    at: usize,
}

impl<'a> Records<'a> {
    /// The next record, or `None` at the end, which is also behind a file header record: its
    /// padding need not be there.
    fn next_record(&mut self) -> Result<Option<Record<'a>>, Refusal> {
        if self.at >= self.bytes.len() {
            return Ok(None);
        }
        let short = |short: Short| cut(&short, self.base);
        let begin = self.at;
        let offset = self.base.saturating_add(begin as u64);
        let header_bytes = sized(self.bytes, begin).map_err(short)?;
        let header = Header::parse(header_bytes, offset)?;
        let Some(&[op]) = header.get("op") else {
            return Err(unreadable(format!("the record at byte {offset} has no op")));
        };
        if op == OP_FILE_HEADER {
            self.at = self.bytes.len();
            return Ok(Some(Record { op, header, data: &[], offset, length: 0 }));
        }
        let length_at = begin + 4 + header_bytes.len();
        let data = sized(self.bytes, length_at).map_err(short)?;
        self.at = length_at + 4 + data.len();
        Ok(Some(Record { op, header, data, offset, length: (self.at - begin) as u64 }))
    }
}

fn publisher(record: &Record<'_>) -> Result<Publisher, Refusal> {
    let fields = Header::parse(record.data, record.offset)?;
    let connection = Connection {
        datatype: fields.text("type"),
        caller_id: fields.get("callerid").map(|_| fields.text("callerid")),
        latching: fields.get("latching") == Some(b"1"),
        ..Connection::default()
    };
    Ok(Publisher {
        id: record.header.u32("conn", record.offset)?,
        topic: record.header.text("topic"),
        in_force: connection.in_force(),
        datatype: connection.datatype,
        caller_id: connection.caller_id.unwrap_or_default(),
        encoding: "ros1".to_owned(),
        offered_qos: String::new(),
        offset: record.offset,
        length: record.length,
    })
}

/// A chunk whose end is not known yet.
fn chunk_info(record: &Record<'_>) -> Result<Span, Refusal> {
    let Record { header, data, offset, .. } = record;
    let position = header.u64("chunk_pos", *offset)?;
    let count = header.u32("count", *offset)?;
    if data.len() as u64 != u64::from(count) * 8 {
        let sentence =
            format!("chunk info at byte {offset}: {} bytes for {count} counts", data.len());
        return Err(unreadable(sentence));
    }
    Ok(Span {
        offset: position,
        end: 0,
        index: None,
        compression: None,
        start_time: header.time("start_time", *offset)?,
        end_time: header.time("end_time", *offset)?,
        counts: counts(data),
    })
}

/// Each id once, with its last count.
fn counts(data: &[u8]) -> Vec<(u32, u32)> {
    let pairs = data.chunks_exact(8).filter_map(|pair| Some((u32_at(pair, 0)?, u32_at(pair, 4)?)));
    let mut counts: Vec<(u32, u32)> = pairs.collect();
    // Every recorder writes them in this order, which needs no map.
    if !counts.is_sorted_by(|(one, _), (next, _)| one < next) {
        let mut places = HashMap::with_capacity(counts.len());
        let mut kept: Vec<(u32, u32)> = Vec::with_capacity(counts.len());
        for (id, count) in counts {
            let place = *places.entry(id).or_insert(kept.len());
            match kept.get_mut(place) {
                Some(before) => before.1 = count,
                None => kept.push((id, count)),
            }
        }
        counts = kept;
    }
    counts
}

/// Chunks in the file's order; each ends where the next begins, its INDEX records included.
fn in_order(mut chunks: Vec<Span>, tail: u64) -> Result<Vec<Span>, Refusal> {
    chunks.sort_by_key(|chunk| chunk.offset);
    let ends = chunks.iter().skip(1).map(|chunk| chunk.offset).chain([tail]);
    let ends: Vec<u64> = ends.collect();
    for (chunk, end) in chunks.iter_mut().zip(ends) {
        let position = chunk.offset;
        if !(MAGIC.len() as u64 <= position && position < end && end <= tail) {
            let sentence = format!("the index names a chunk at byte {position}, outside the file");
            return Err(unreadable(sentence));
        }
        chunk.end = end;
    }
    Ok(chunks)
}
