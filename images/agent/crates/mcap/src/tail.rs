//! What planning needs to know of a recording, from bytes that the caller has read: its head, its
//! footer and its summary, and of a chunk the message indexes behind it.
//!
//! Nothing here reads a file, as whoever plans over a network chooses the ranges. Other than
//! [`crate::Mcap`], which keeps what is whole, this refuses a recording of which anything that
//! planning needs is missing.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use bagpipe_log::{Index, Publisher, Reason, Refusal, Span};

use crate::MAGIC;
use crate::connection::{Type, connection};
use crate::record::{
    ATTACHMENT_INDEX, CHANNEL, CHUNK_INDEX, Channel, Defect, FOOTER, Fields, HEAD, HEADER, Head,
    MESSAGE_INDEX, METADATA_INDEX, SCHEMA, STATISTICS, Schema,
};

/// Bytes with which a whole file ends: the footer record and the magic.
pub const FOOTER_BYTES: u64 = HEAD as u64 + 20 + MAGIC.len() as u64;
const MAX_SUMMARY_BYTES: u64 = 1 << 30;
/// A message index has a time and an offset for each message, behind its channel and their length.
const INDEX_ENTRY: u64 = 16;
const INDEX_FIELDS: u64 = HEAD as u64 + 6;
/// Where in the footer record its CRC-32 stands, behind two places.
const CRC_IN_FOOTER: usize = HEAD + 16;
/// The record behind the data.
const DATA_END_BYTES: u64 = HEAD as u64 + 4;
pub(crate) const ADVICE: &str = "write it again with chunks, message indexes and a summary \
                                 (`bagpipe bag reindex BAG --to NEW`)";

/// Where the head ends, which is the magic and the header record, in the bytes with which a file
/// begins.
pub fn parse_head(bytes: &[u8]) -> Result<u64, Refusal> {
    let head = Head::read(bytes, MAGIC.len()).map_err(|defect| cut(&defect, 0))?;
    if head.op != HEADER {
        let sentence = format!("byte {} holds opcode {}, expected 1", MAGIC.len(), head.op);
        return Err(refused(Reason::Unreadable, sentence));
    }
    let end = head.end(bytes.len()).ok_or_else(|| cut(&head.cut(bytes.len()), 0))?;
    Ok(end as u64)
}

/// Where the summary begins and ends in a file of `size` bytes, of which `bytes` are the last
/// [`FOOTER_BYTES`], or all where there are fewer.
pub fn parse_footer(bytes: &[u8], size: u64) -> Result<(u64, u64), Refusal> {
    let base = size.saturating_sub(bytes.len() as u64);
    if bytes.len() as u64 != FOOTER_BYTES || !bytes.ends_with(MAGIC) || bytes[0] != FOOTER {
        let sentence = format!(
            "the recording is cut: no footer at byte {base} (its recorder was stopped, or it was \
             not copied as a whole): copy it again, or {ADVICE}"
        );
        return Err(refused(Reason::Cut, sentence));
    }
    let begin = Fields::new(bytes, HEAD).u64("where the summary begins");
    let begin = begin.map_err(|defect| cut(&defect, base))?;
    if begin == 0 {
        let sentence = format!("the recording has no summary: {ADVICE}");
        return Err(refused(Reason::NotIndexed, sentence));
    }
    if !(MAGIC.len() as u64..=base).contains(&begin) {
        let sentence = format!("the footer at byte {base} names a summary at byte {begin}");
        return Err(refused(Reason::Unreadable, sentence));
    }
    if base - begin > MAX_SUMMARY_BYTES {
        let sentence = format!("the summary at byte {begin} is above 1 GiB");
        return Err(refused(Reason::Unreadable, sentence));
    }
    Ok((begin, base))
}

/// Reads the summary, which lies at `base` of the file; the head ends at `head_end`, and `footer` is
/// what [`parse_footer`] was given.
pub fn parse_summary(
    bytes: &[u8],
    base: u64,
    head_end: u64,
    footer: &[u8],
) -> Result<Index, Refusal> {
    check_crc(bytes, base, footer)?;
    let mut found = Summary::default();
    let mut at = 0;
    while at < bytes.len() {
        let head = Head::read(bytes, at).map_err(|defect| cut(&defect, base))?;
        let end = head.end(bytes.len()).ok_or_else(|| cut(&head.cut(bytes.len()), base))?;
        let place = (base + at as u64, (end - at) as u64);
        let read = found.take(head.op, &bytes[..end], head.start, place);
        read.map_err(|defect| unreadable(&defect, base))?;
        at = end;
    }
    found.index(base, head_end)
}

/// Compares the summary with the CRC-32 that the footer states of it and of its own begin.
fn check_crc(bytes: &[u8], base: u64, footer: &[u8]) -> Result<(), Refusal> {
    let (covered, rest) = footer.split_at_checked(CRC_IN_FOOTER).unwrap_or_default();
    let stated = rest.first_chunk().map_or(0, |crc| u32::from_le_bytes(*crc));
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(bytes);
    hasher.update(covered);
    if stated == 0 || stated == hasher.finalize() {
        return Ok(());
    }
    let sentence = format!(
        "the summary at byte {base} does not have the CRC-32 that the footer states: copy the \
         recording again, or {ADVICE}"
    );
    Err(refused(Reason::Unreadable, sentence))
}

/// The times in nanoseconds of the messages that message indexes name, for each channel, in the
/// order in which these come. `bytes` lie at `base` of the file.
pub fn index_times(bytes: &[u8], base: u64) -> Result<Vec<(u32, Vec<u64>)>, Refusal> {
    let mut times = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let head = Head::read(bytes, at).map_err(|defect| cut(&defect, base))?;
        let end = head.end(bytes.len()).ok_or_else(|| cut(&head.cut(bytes.len()), base))?;
        if head.op == MESSAGE_INDEX {
            let read = channel_times(&bytes[..end], head.start);
            times.push(read.map_err(|defect| unreadable(&defect, base))?);
        }
        at = end;
    }
    Ok(times)
}

fn channel_times(bytes: &[u8], at: usize) -> Result<(u32, Vec<u64>), Defect> {
    let mut fields = Fields::new(bytes, at);
    let channel = fields.u16("a message index's channel")?;
    let entries = fields.bytes("a message index")?.chunks_exact(INDEX_ENTRY as usize);
    let time = |entry: &[u8]| entry.first_chunk().map(|time| u64::from_le_bytes(*time));
    Ok((u32::from(channel), entries.filter_map(time).collect()))
}

/// Where a record lies in the file: its offset and its bytes.
type Range = (u64, u64);

#[derive(Default)]
struct Summary {
    schemas: BTreeMap<u16, (Schema, Range)>,
    channels: BTreeMap<u16, (Channel, Range)>,
    chunks: Vec<ChunkIndex>,
    /// Where attachments and metadata lie, between the chunks.
    others: Vec<Range>,
    statistics: Option<Statistics>,
}

#[derive(Default)]
struct Statistics {
    messages: u64,
    /// The first and the last time; 0 where it is not stated.
    times: (u64, u64),
    /// Messages of each channel, which need not be counted.
    by_channel: BTreeMap<u32, u64>,
}

struct ChunkIndex {
    start_time: u64,
    end_time: u64,
    offset: u64,
    length: u64,
    /// Where each channel's message index begins.
    indexes: Vec<(u16, u64)>,
    index_length: u64,
    compression: String,
    /// Where the record itself lies.
    place: u64,
}

impl ChunkIndex {
    fn read(bytes: &[u8], at: usize, place: u64) -> Result<Self, Defect> {
        let mut fields = Fields::new(bytes, at);
        let [start_time, end_time, offset, length] = [
            fields.u64("a chunk's first time")?,
            fields.u64("a chunk's last time")?,
            fields.u64("a chunk's offset")?,
            fields.u64("a chunk's length")?,
        ];
        let entries = fields.bytes("a chunk's message indexes")?.chunks_exact(10);
        let entry = |entry: &[u8]| {
            let (channel, offset) = entry.split_first_chunk()?;
            Some((u16::from_le_bytes(*channel), u64::from_le_bytes(*offset.first_chunk()?)))
        };
        let mut indexes: Vec<(u16, u64)> = entries.filter_map(entry).collect();
        indexes.sort_by_key(|(_, offset)| *offset);
        let index_length = fields.u64("the length of a chunk's message indexes")?;
        let compression = fields.text("a chunk's compression")?;
        let compression = if compression.is_empty() { "none" } else { compression }.to_owned();
        Ok(Self { start_time, end_time, offset, length, indexes, index_length, compression, place })
    }

    /// With the messages of each channel, which the lengths of its indexes say.
    fn span(self) -> Result<Span, Refusal> {
        let wrong = || {
            let Self { offset, place, .. } = self;
            let sentence = format!(
                "the chunk index at byte {place} does not say where the message indexes of the \
                 chunk at byte {offset} lie"
            );
            refused(Reason::Unreadable, sentence)
        };
        let index = self.offset.checked_add(self.length).ok_or_else(wrong)?;
        let end = index.checked_add(self.index_length).ok_or_else(wrong)?;
        let begins = self.indexes.iter().map(|(_, offset)| *offset);
        let ends = begins.clone().skip(1).chain([end]);
        if begins.clone().next().is_some_and(|first| first != index) {
            return Err(wrong());
        }
        let mut counts: BTreeMap<u32, u32> = BTreeMap::new();
        for ((channel, begin), end) in self.indexes.iter().zip(ends) {
            let length = end.checked_sub(*begin).and_then(|all| all.checked_sub(INDEX_FIELDS));
            let length = length.filter(|length| length % INDEX_ENTRY == 0).ok_or_else(wrong)?;
            let messages = u32::try_from(length / INDEX_ENTRY).map_err(|_| wrong())?;
            let count = counts.entry(u32::from(*channel)).or_default();
            *count = count.checked_add(messages).ok_or_else(wrong)?;
        }
        Ok(Span {
            offset: self.offset,
            end,
            index: Some(index),
            compression: Some(self.compression),
            start_time: self.start_time,
            end_time: self.end_time,
            counts: counts.into_iter().collect(),
        })
    }
}

impl Summary {
    fn take(&mut self, op: u8, bytes: &[u8], at: usize, place: Range) -> Result<(), Defect> {
        match op {
            SCHEMA => {
                let schema = Schema::read(bytes, at)?;
                self.schemas.insert(schema.id, (schema, place));
            }
            CHANNEL => {
                let channel = Channel::read(bytes, at)?;
                self.channels.insert(channel.id, (channel, place));
            }
            CHUNK_INDEX => self.chunks.push(ChunkIndex::read(bytes, at, place.0)?),
            ATTACHMENT_INDEX | METADATA_INDEX => {
                let mut fields = Fields::new(bytes, at);
                let offset = fields.u64("where a record lies")?;
                self.others.push((offset, fields.u64("a record's length")?));
            }
            STATISTICS => self.statistics = Some(Statistics::read(bytes, at)?),
            _ => {}
        }
        Ok(())
    }

    fn index(self, base: u64, head_end: u64) -> Result<Index, Refusal> {
        let Self { schemas, channels, chunks, others, statistics } = self;
        let indexed = chunks.iter().all(|chunk| !chunk.indexes.is_empty());
        let chunks = chunks.into_iter().map(ChunkIndex::span).collect::<Result<Vec<_>, _>>()?;
        let mut chunks = in_order(chunks, head_end, base)?;
        let indexed = indexed && is_covered(&chunks, others, head_end..base);
        let counts = chunks.iter().flat_map(|chunk| &chunk.counts);
        let found: u64 = counts.clone().map(|(_, count)| u64::from(*count)).sum();
        if statistics.as_ref().map_or(!indexed, |all| all.messages != found) {
            let sentence = format!(
                "the summary at byte {base} names the places of {found} messages, and not of all: \
                 {ADVICE}"
            );
            return Err(refused(Reason::NotIndexed, sentence));
        }
        let statistics = statistics.unwrap_or_default();
        if !agree(&statistics.by_channel, &chunks) {
            let sentence = format!(
                "the statistics in the summary at byte {base} count other messages of a channel than \
                 the message indexes: {ADVICE}"
            );
            return Err(refused(Reason::Unreadable, sentence));
        }
        if found == 0 {
            return Err(refused(Reason::Empty, "the recording holds no messages"));
        }
        let used: BTreeSet<u32> = counts.map(|(channel, _)| *channel).collect();
        let declared = |channel: &u32| {
            let known = u16::try_from(*channel).ok().and_then(|channel| channels.get(&channel));
            known.is_some_and(|(each, _)| {
                each.schema_id == 0 || schemas.contains_key(&each.schema_id)
            })
        };
        if let Some(channel) = used.iter().find(|channel| !declared(channel)) {
            let sentence =
                format!("the summary at byte {base} does not declare channel {channel}: {ADVICE}");
            return Err(refused(Reason::NotIndexed, sentence));
        }
        // A chunk without a message states times of nothing.
        chunks.retain(|chunk| chunk.counts.iter().any(|(_, count)| *count > 0));
        check_times(statistics.times, &chunks, base)?;
        let mut declarations = vec![(0, head_end)];
        in_places(schemas.values().map(|(_, place)| *place), &mut declarations);
        in_places(channels.values().map(|(_, place)| *place), &mut declarations);
        let connections = publishers(&channels, &schemas);
        let counted = !statistics.by_channel.is_empty();
        Ok(Index { declarations, connections, chunks, counted })
    }
}

impl Statistics {
    fn read(bytes: &[u8], at: usize) -> Result<Self, Defect> {
        let mut fields = Fields::new(bytes, at);
        let messages = fields.u64("how many messages there are")?;
        fields.u16("how many schemas there are")?;
        for _ in 0..4 {
            fields.u32("how many records there are")?;
        }
        let times = (fields.u64("the first time")?, fields.u64("the last time")?);
        let entries = fields.bytes("the messages of each channel")?.chunks_exact(10);
        let entry = |entry: &[u8]| {
            let (channel, count) = entry.split_first_chunk()?;
            let channel = u32::from(u16::from_le_bytes(*channel));
            Some((channel, u64::from_le_bytes(*count.first_chunk()?)))
        };
        Ok(Self { messages, times, by_channel: entries.filter_map(entry).collect() })
    }
}

/// Refuses chunks that state less time than the statistics: by the former messages would be in no
/// fragment.
fn check_times((first, last): (u64, u64), chunks: &[Span], base: u64) -> Result<(), Refusal> {
    let starts = chunks.iter().map(|chunk| chunk.start_time);
    let start = starts.min().unwrap_or_default();
    let end = chunks.iter().map(|chunk| chunk.end_time).max().unwrap_or_default();
    if (first == 0 || start <= first) && last <= end {
        return Ok(());
    }
    let sentence = format!(
        "the statistics in the summary at byte {base} state messages from {first} to {last} ns, and \
         the chunk indexes from {start} to {end} ns: {ADVICE}"
    );
    Err(refused(Reason::Unreadable, sentence))
}

/// Whether the indexes name as many messages of each channel as the statistics count, if they do.
fn agree(by_channel: &BTreeMap<u32, u64>, chunks: &[Span]) -> bool {
    let mut found: BTreeMap<u32, u64> = by_channel.keys().map(|channel| (*channel, 0)).collect();
    for (channel, count) in chunks.iter().flat_map(|chunk| &chunk.counts) {
        *found.entry(*channel).or_default() += u64::from(*count);
    }
    by_channel.is_empty() || found == *by_channel
}

/// Whether chunks and other known records fill the data, so that no message lies elsewhere.
fn is_covered(chunks: &[Span], others: Vec<Range>, data: std::ops::Range<u64>) -> bool {
    let mut known = others;
    known.extend(chunks.iter().map(|chunk| (chunk.offset, chunk.end - chunk.offset)));
    known.sort_unstable();
    let mut at = data.start;
    for (offset, length) in known {
        if offset > at {
            return false;
        }
        at = at.max(offset.saturating_add(length));
    }
    at.saturating_add(DATA_END_BYTES) >= data.end
}

/// Adds records in the order in which they lie, whatever their numbers: so most are adjacent.
fn in_places(records: impl Iterator<Item = Range>, ranges: &mut Vec<Range>) {
    let mut records: Vec<Range> = records.collect();
    records.sort_unstable();
    records.into_iter().for_each(|record| join(ranges, record));
}

/// Adjacent records are read at once.
fn join(ranges: &mut Vec<Range>, (offset, length): Range) {
    match ranges.last_mut() {
        Some(last) if last.0 + last.1 == offset => last.1 += length,
        _ => ranges.push((offset, length)),
    }
}

fn publishers(
    channels: &BTreeMap<u16, (Channel, Range)>,
    schemas: &BTreeMap<u16, (Schema, Range)>,
) -> Vec<Publisher> {
    let types: HashMap<u16, Type> =
        schemas.iter().map(|(id, (schema, _))| (*id, Type::of(Some(schema)))).collect();
    let untyped = Type::of(None);
    let each = |(channel, place): &(Channel, Range)| {
        publisher(channel, types.get(&channel.schema_id).unwrap_or(&untyped), *place)
    };
    channels.values().map(each).collect()
}

fn publisher(channel: &Channel, of: &Type, (offset, length): Range) -> Publisher {
    let connection = connection(channel, of);
    Publisher {
        id: connection.id,
        in_force: connection.in_force(),
        offered_qos: connection.offered_qos.unwrap_or_default(),
        topic: connection.topic,
        datatype: connection.datatype,
        caller_id: connection.caller_id.unwrap_or_default(),
        encoding: connection.message_encoding.name().to_owned(),
        offset,
        length,
    }
}

/// Chunks in the file's order, which do not overlap and lie before the summary.
fn in_order(mut chunks: Vec<Span>, head_end: u64, base: u64) -> Result<Vec<Span>, Refusal> {
    chunks.sort_by_key(|chunk| chunk.offset);
    let mut before = head_end;
    for chunk in &chunks {
        if chunk.offset < before || chunk.end > base {
            let Span { offset, end, .. } = chunk;
            let sentence = format!(
                "the summary at byte {base} names a chunk at byte {offset} to {end}, where none can \
                 lie"
            );
            return Err(refused(Reason::Unreadable, sentence));
        }
        before = chunk.end;
    }
    Ok(chunks)
}

fn refused(reason: Reason, sentence: impl Into<String>) -> Refusal {
    Refusal { reason, sentence: sentence.into() }
}

fn cut(defect: &Defect, base: u64) -> Refusal {
    let at = base.saturating_add(defect.at as u64);
    let sentence = format!("the recording is cut: byte {at} should begin {}", defect.expected);
    refused(Reason::Cut, sentence)
}

fn unreadable(defect: &Defect, base: u64) -> Refusal {
    let at = base.saturating_add(defect.at as u64);
    refused(Reason::Unreadable, format!("byte {at}: expected {}", defect.expected))
}
