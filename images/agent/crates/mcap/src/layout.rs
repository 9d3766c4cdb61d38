//! One pass over the records of a file, from its front: where chunks, messages outside of them
//! and all else lie. What is compressed stays so.
//!
//! The file lies in memory, so that passing all records costs a look at each one's head, and no
//! index can hide a record: those of the summary are not read.

use std::sync::OnceLock;

use crc32fast::Hasher;

use crate::crc::{DataCrc, STRIDE};
use crate::loss::Tally;
use crate::part::{Made, Packed, Part, wrong_crc};
use crate::promise::Promise;
use crate::record::{
    ATTACHMENT, ATTACHMENT_INDEX, Attachment, CHANNEL, CHUNK, CHUNK_INDEX, Channel, DATA_END,
    Defect, FOOTER, Fields, HEADER, Head, MESSAGE, MESSAGE_INDEX, METADATA, METADATA_INDEX,
    Metadata, SCHEMA, STATISTICS, SUMMARY_OFFSET, Schema,
};
use crate::walk::{Channels, Declared, Walk, Walked};
use crate::{Compression, MAGIC, McapError};

/// Places in a part are numbers of 32 bits.
const MOST: usize = u32::MAX as usize;

/// Messages outside of chunks, while more of them may follow.
#[derive(Debug)]
struct Run {
    base: usize,
    end: usize,
    walked: Walked,
}

/// What the file consists of.
#[derive(Debug, Default)]
pub(crate) struct Layout {
    pub profile: String,
    pub library: String,
    pub parts: Vec<Part>,
    /// Where the contents of Attachment records lie.
    pub attachments: Vec<std::ops::Range<usize>>,
    pub metadata: Vec<Metadata>,
    /// What the summary declares, and where.
    pub declared: Vec<(usize, Declared)>,
    /// How many messages there are by the statistics, and where these lie.
    pub statistics: Option<(usize, u64)>,
    pub lost: Tally,
}

/// Passes all records, and puts lengths before the messages that lie in the file as they are.
pub(crate) fn lay_out(file: &mut [u8]) -> Result<Layout, McapError> {
    if !file.starts_with(MAGIC) {
        let found = String::from_utf8_lossy(&file[..file.len().min(MAGIC.len())]);
        return Err(McapError::NotMcap { found: format!("{found:?}") });
    }
    let damaged = |defect: Defect| McapError::damaged(defect.at, defect.expected);
    let head = Head::read(file, MAGIC.len()).map_err(damaged)?;
    let end = head.end(file.len()).ok_or_else(|| damaged(head.cut(file.len())))?;
    if head.op != HEADER {
        let expected = format!("a Header record (opcode 1), found opcode {}", head.op);
        return Err(McapError::damaged(MAGIC.len(), expected));
    }
    let mut fields = Fields::new(&file[..end], head.start);
    let profile = fields.text("the profile").map_err(damaged)?.to_owned();
    let library = fields.text("the library").map_err(damaged)?.to_owned();
    let found = Layout { profile, library, ..Layout::default() };
    let crc = DataCrc::of(file, MAGIC.len());
    let channels = Channels::default();
    let mut pass = Pass { file, at: end, crc, channels, run: None, found };
    let whole = pass.data_section();
    pass.close_run();
    if whole {
        pass.summary_section();
    }
    Ok(pass.found)
}

struct Pass<'f> {
    file: &'f mut [u8],
    /// Where the next record begins.
    at: usize,
    crc: Option<DataCrc>,
    channels: Channels,
    run: Option<Run>,
    found: Layout,
}

impl Pass<'_> {
    fn lose(&mut self, defect: Defect, bytes: u64, messages: Option<u64>) {
        self.found.lost.add(defect.at, defect.expected, bytes, messages);
    }

    /// Bytes from the next record to the file's end.
    fn rest(&self) -> u64 {
        (self.file.len() - self.at) as u64
    }

    /// The next record, whose end is past the file's where it is cut; `None` at an end that
    /// comes too early.
    fn next(&mut self, last: &str) -> Option<Head> {
        let defect = match Head::read(self.file, self.at) {
            Ok(head) => return Some(head),
            Err(_) if self.rest() == 0 => {
                Defect::new(self.at, format!("a {last} record, found the file's end"))
            }
            Err(defect) => defect,
        };
        self.lose(defect, self.rest(), None);
        None
    }

    /// The last record, which goes on behind the file's end; of a chunk, what is there is kept.
    fn cut(&mut self, head: Head) {
        let length = self.file.len();
        let there = if head.op == CHUNK { 0 } else { self.rest() };
        self.lose(head.cut(length), head.missing(length).saturating_add(there), None);
        if head.op == CHUNK {
            self.chunk(head, length, true);
        }
    }

    /// True when its end was found, and a summary may follow.
    fn data_section(&mut self) -> bool {
        while let Some(head) = self.next("DataEnd") {
            if matches!(head.op, SCHEMA | CHANNEL | MESSAGE) {
                if !self.messages(head) {
                    return false;
                }
                continue;
            }
            let Some(end) = head.end(self.file.len()) else {
                self.cut(head);
                return false;
            };
            match head.op {
                CHUNK => self.chunk(head, end, false),
                MESSAGE_INDEX => self.message_index(head, end),
                ATTACHMENT => self.attachment(head, end),
                METADATA => match Metadata::read(&self.file[..end], head.start) {
                    Ok(metadata) => self.found.metadata.push(metadata),
                    Err(defect) => self.lose(defect, (end - self.at) as u64, Some(0)),
                },
                DATA_END => {
                    self.data_end();
                    self.at = end;
                    return true;
                }
                FOOTER => {
                    let expected = "a DataEnd record (opcode 15), found a Footer";
                    self.lose(Defect::new(self.at, expected), 0, None);
                    return true;
                }
                op => self.pass_over(op, end, "data section"),
            }
            self.at = end;
        }
        false
    }

    /// Unknown records are passed over; known ones have their places.
    fn pass_over(&mut self, op: u8, end: usize, section: &str) {
        if op <= DATA_END {
            let expected = format!("a record of the {section}, found opcode {op}");
            self.lose(Defect::new(self.at, expected), (end - self.at) as u64, Some(0));
        }
    }

    /// Takes the records of messages from here on; false when the next one is cut.
    fn messages(&mut self, head: Head) -> bool {
        let base = self.run.as_ref().map_or(self.at, |run| run.base);
        let most = self.file.len().min(base.saturating_add(MOST));
        let until = self.taken(most);
        let run =
            self.run.get_or_insert_with(|| Run { base, end: base, walked: Walked::default() });
        let chunk = self.found.parts.len() as u32;
        let mut walk =
            Walk { walked: &mut run.walked, channels: &mut self.channels, chunk, inside: false };
        let end = base + walk.run(&mut self.file[base..until], self.at - base);
        let before = std::mem::replace(&mut self.at, end);
        run.end = end;
        if end > before {
            return true;
        }
        self.close_run();
        match head.end(self.file.len()) {
            // There is no room for it in this run.
            Some(_) if base < before => true,
            Some(end) => {
                let expected = "a record of less than 4 GiB";
                self.lose(Defect::new(before + 1, expected), (end - before) as u64, None);
                self.at = end;
                true
            }
            None => {
                self.cut(head);
                false
            }
        }
    }

    /// Where a walk has to end, because bytes up to there are in the checksum: it writes into
    /// them.
    fn taken(&mut self, most: usize) -> usize {
        let Some(crc) = &mut self.crc else { return most };
        let mut end = self.at;
        while end < most && end - self.at < STRIDE {
            let Ok(head) = Head::read(self.file, end) else { break };
            match head.end(most) {
                Some(next) if matches!(head.op, SCHEMA | CHANNEL | MESSAGE) => end = next,
                _ => break,
            }
        }
        crc.take(self.file, end);
        end
    }

    fn close_run(&mut self) {
        let Some(Run { base, end, mut walked }) = self.run.take() else { return };
        self.channels.forget(&walked.counts);
        self.found.lost.add_all(base, std::mem::take(&mut walked.lost));
        let made = Made { bytes: Vec::new(), walked };
        self.found.parts.push(Part {
            position: base,
            data: base..end,
            packed: None,
            promised: Vec::new(),
            stated: (0, 0),
            made: OnceLock::from(Box::new(made)),
        });
    }

    fn chunk(&mut self, head: Head, end: usize, cut: bool) {
        self.close_run();
        match chunk(&self.file[..end], self.at, head, cut) {
            Err(defect) => self.lose(defect, (end - self.at) as u64, None),
            Ok((part, _)) if part.data.is_empty() => {}
            Ok((part, Packed { compression: Compression::None, size, crc })) => {
                if part.data.len() != size as usize && !cut {
                    let expected = format!("a size of {} bytes, found {size}", part.data.len());
                    self.lose(Defect::new(self.at, expected), 0, Some(0));
                }
                self.plain(part, if cut { 0 } else { crc });
            }
            Ok((part, packed)) => self.found.parts.push(Part { packed: Some(packed), ..part }),
        }
    }

    /// A chunk whose records lie in the file as they are.
    fn plain(&mut self, part: Part, crc: u32) {
        let mut walked = Walked::default();
        // With a wrong checksum no one knows which of its records are wrong.
        if self.is_whole(part.data.clone(), crc) {
            let start = part.data.start;
            let chunk = self.found.parts.len() as u32;
            let mut walk =
                Walk { walked: &mut walked, channels: &mut self.channels, chunk, inside: true };
            walk.run(&mut self.file[part.data.clone()], 0);
            self.channels.forget(&walked.counts);
            self.found.lost.add_all(start, std::mem::take(&mut walked.lost));
            part.compare_times(&mut walked);
            self.found.lost.add_all(0, std::mem::take(&mut walked.lost));
        }
        let made = Made { bytes: Vec::new(), walked };
        self.found.parts.push(Part { made: OnceLock::from(Box::new(made)), ..part });
    }

    /// Whether a chunk's records have their CRC-32, which is 0 where it is not known; and takes them
    /// for that of all data. If not, they are lost.
    fn is_whole(&mut self, records: std::ops::Range<usize>, crc: u32) -> bool {
        if crc == 0 {
            if let Some(data_crc) = &mut self.crc {
                data_crc.take(self.file, records.end);
            }
            return true;
        }
        let mut hasher = Hasher::new();
        hasher.update(&self.file[records.clone()]);
        if let Some(data_crc) = &mut self.crc {
            data_crc.take_chunk(self.file, records.clone(), &hasher);
        }
        let wrong = wrong_crc(crc, || hasher.finalize());
        if let Some(expected) = &wrong {
            self.lose(Defect::new(records.start, expected), records.len() as u64, None);
        }
        wrong.is_none()
    }

    fn message_index(&mut self, head: Head, end: usize) {
        let mut fields = Fields::new(&self.file[..end], head.start);
        let read = |fields: &mut Fields<'_>| {
            let channel = fields.u16("a channel")?;
            let length = fields.bytes("an index")?.len();
            Ok(Promise { channel, entries: fields.at - length..fields.at })
        };
        match (read(&mut fields), self.found.parts.last_mut()) {
            (Err(defect), _) => self.lose(defect, (end - self.at) as u64, Some(0)),
            (Ok(promise), Some(part)) if self.run.is_none() => part.promised.push(promise),
            (Ok(_), _) => {}
        }
    }

    fn attachment(&mut self, head: Head, end: usize) {
        let wrong = match Attachment::read(&self.file[..end], head.start) {
            Err(defect) => Some(defect),
            Ok((_, crc, at)) => wrong_crc(crc, || crc32fast::hash(&self.file[head.start..at]))
                .map(|expected| Defect::new(head.start, expected)),
        };
        match wrong {
            Some(defect) => self.lose(defect, (end - self.at) as u64, Some(0)),
            None => self.found.attachments.push(head.start..end),
        }
    }

    fn data_end(&mut self) {
        let Some(mut crc) = self.crc.take().filter(|crc| crc.end == self.at) else { return };
        crc.take(self.file, self.at);
        let expected = crc.expected;
        if let Some(expected) = wrong_crc(expected, || crc.found()) {
            // Where in the data section it is, other checksums may say.
            self.lose(Defect::new(self.at, expected), 0, None);
        }
    }

    fn summary_section(&mut self) {
        let start = self.at;
        while let Some(head) = self.next("Footer") {
            let Some(end) = head.end(self.file.len()) else {
                return self.lose(head.cut(self.file.len()), self.rest(), Some(0));
            };
            let bytes = &self.file[..end];
            let declared = match head.op {
                SCHEMA => Schema::read(bytes, head.start).map(Declared::Schema),
                CHANNEL => Channel::read(bytes, head.start).map(Declared::Channel),
                STATISTICS => match Fields::new(bytes, head.start).u64("a number of messages") {
                    Ok(messages) => {
                        self.found.statistics = Some((head.start, messages));
                        self.at = end;
                        continue;
                    }
                    Err(defect) => Err(defect),
                },
                FOOTER => return self.footer(start, head, end),
                CHUNK_INDEX | ATTACHMENT_INDEX | METADATA_INDEX | SUMMARY_OFFSET => {
                    self.at = end;
                    continue;
                }
                op => {
                    self.pass_over(op, end, "summary");
                    self.at = end;
                    continue;
                }
            };
            match declared {
                Ok(declared) => self.found.declared.push((self.at, declared)),
                Err(defect) => self.lose(defect, (end - self.at) as u64, Some(0)),
            }
            self.at = end;
        }
    }

    fn footer(&mut self, start: usize, head: Head, end: usize) {
        let mut fields = Fields::new(&self.file[..end], head.start);
        let stated = fields.u64("the summary's place").and_then(|place| {
            fields.u64("the summary offsets' place")?;
            Ok((place, fields.at, fields.u32("the summary's CRC-32")?))
        });
        let (place, crc_at, crc) = match stated {
            Ok(stated) => stated,
            Err(defect) => return self.lose(defect, self.rest(), Some(0)),
        };
        let begins = if start == self.at { 0 } else { start as u64 };
        if place != begins {
            let expected = format!("the summary's place, {begins}, found {place}");
            self.lose(Defect::new(head.start, expected), 0, Some(0));
        } else if let Some(expected) = wrong_crc(crc, || crc32fast::hash(&self.file[start..crc_at]))
        {
            self.lose(Defect::new(start, expected), (crc_at - start) as u64, Some(0));
        }
        if self.file[end..] != *MAGIC {
            let found = self.file.len() - end;
            let expected =
                format!("the 8 bytes that the file began with as its last, found {found}");
            self.lose(Defect::new(end, expected), found as u64, Some(0));
        }
    }
}

/// What the Chunk record at `position` says, as far as the bytes go.
fn chunk(bytes: &[u8], position: usize, head: Head, cut: bool) -> Result<(Part, Packed), Defect> {
    let mut fields = Fields::new(bytes, head.start);
    let stated = (fields.u64("a chunk's first time")?, fields.u64("a chunk's last time")?);
    let size_at = fields.at;
    let size = fields.u64("a chunk's size")?;
    let crc = fields.u32("a chunk's CRC-32")?;
    let name_at = fields.at;
    let name = fields.text("a chunk's compression")?;
    let compression = Compression::from_name(name).ok_or_else(|| {
        Defect::new(name_at, format!("the compression lz4, zstd or none (\"\"), found {name:?}"))
    })?;
    let size = u32::try_from(size)
        .map_err(|_| Defect::new(size_at, format!("a chunk of less than 4 GiB, found {size}")))?;
    let length_at = fields.at;
    let length = fields.u64("the length of a chunk's records")?;
    let room = bytes.len() - fields.at;
    let fits = usize::try_from(length).ok().filter(|length| *length <= room);
    let length = match fits {
        Some(length) => length,
        None if cut => room,
        None => {
            let expected = format!("{length} bytes of a chunk's records, found {room}");
            return Err(Defect::new(length_at, expected));
        }
    };
    if length > MOST {
        return Err(Defect::new(length_at, format!("a chunk of less than 4 GiB, found {length}")));
    }
    let data = fields.at..fields.at + length;
    let (promised, made) = (Vec::new(), OnceLock::new());
    let part = Part { position, data, packed: None, promised, stated, made };
    Ok((part, Packed { compression, size, crc }))
}
