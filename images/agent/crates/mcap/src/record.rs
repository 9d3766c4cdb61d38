//! Records, which are an opcode, a length and fields; and those that declare something.

use std::collections::BTreeMap;

/// Opcode and length before a record's content.
pub(crate) const HEAD: usize = 9;
/// A message's channel, sequence number and two times before its data.
pub(crate) const MESSAGE_FIELDS: usize = 22;

pub(crate) const HEADER: u8 = 0x01;
pub(crate) const FOOTER: u8 = 0x02;
pub(crate) const SCHEMA: u8 = 0x03;
pub(crate) const CHANNEL: u8 = 0x04;
pub(crate) const MESSAGE: u8 = 0x05;
pub(crate) const CHUNK: u8 = 0x06;
pub(crate) const MESSAGE_INDEX: u8 = 0x07;
pub(crate) const CHUNK_INDEX: u8 = 0x08;
pub(crate) const ATTACHMENT: u8 = 0x09;
pub(crate) const ATTACHMENT_INDEX: u8 = 0x0a;
pub(crate) const STATISTICS: u8 = 0x0b;
pub(crate) const METADATA: u8 = 0x0c;
pub(crate) const METADATA_INDEX: u8 = 0x0d;
pub(crate) const SUMMARY_OFFSET: u8 = 0x0e;
pub(crate) const DATA_END: u8 = 0x0f;

/// Bytes of a type's name, which each of its channels has a copy of.
const MOST_NAME: usize = 1024;

/// What bytes should have been, and where in them.
#[derive(Debug)]
pub(crate) struct Defect {
    pub at: usize,
    pub expected: String,
}

impl Defect {
    pub fn new(at: usize, expected: impl Into<String>) -> Self {
        Self { at, expected: expected.into() }
    }
}

/// A record's opcode, and where its content lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Head {
    pub op: u8,
    pub start: usize,
    /// As the record says; the bytes may be fewer.
    length: u64,
}

impl Head {
    /// The head of the record at `at`.
    pub fn read(bytes: &[u8], at: usize) -> Result<Self, Defect> {
        let rest = bytes.get(at..).unwrap_or_default();
        let Some(head) = rest.first_chunk::<HEAD>() else {
            let expected = format!("a record of at least {HEAD} bytes, found {}", rest.len());
            return Err(Defect::new(at, expected));
        };
        let [op, length @ ..] = *head;
        if op == 0 {
            return Err(Defect::new(at, "a record's opcode, found 0"));
        }
        Ok(Self { op, start: at + HEAD, length: u64::from_le_bytes(length) })
    }

    /// Where the record ends, if so many bytes hold it.
    pub fn end(&self, bytes: usize) -> Option<usize> {
        let length = usize::try_from(self.length).ok()?;
        self.start.checked_add(length).filter(|end| *end <= bytes)
    }

    /// How many bytes the record lacks, where the last one is at `bytes`.
    pub fn missing(&self, bytes: usize) -> u64 {
        self.length.saturating_sub(bytes.saturating_sub(self.start) as u64)
    }

    /// That its content is cut.
    pub fn cut(&self, bytes: usize) -> Defect {
        let Self { op, start, length } = *self;
        let found = bytes.saturating_sub(start);
        let expected = format!("{length} bytes of a record (opcode {op}), found {found}");
        Defect::new(start - HEAD + 1, expected)
    }
}

/// A record's fields, one after the other.
pub(crate) struct Fields<'a> {
    bytes: &'a [u8],
    pub at: usize,
}

impl<'a> Fields<'a> {
    /// Those from `at` on.
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    fn take(&mut self, length: u64, what: &str) -> Result<&'a [u8], Defect> {
        let end = usize::try_from(length).ok().and_then(|length| self.at.checked_add(length));
        let Some(found) = end.and_then(|end| self.bytes.get(self.at..end)) else {
            let found = self.bytes.len().saturating_sub(self.at);
            return Err(Defect::new(self.at, format!("{length} bytes of {what}, found {found}")));
        };
        self.at += found.len();
        Ok(found)
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N], Defect> {
        let mut bytes = [0; N];
        bytes.copy_from_slice(self.take(N as u64, what)?);
        Ok(bytes)
    }

    pub fn u16(&mut self, what: &str) -> Result<u16, Defect> {
        Ok(u16::from_le_bytes(self.array(what)?))
    }

    pub fn u32(&mut self, what: &str) -> Result<u32, Defect> {
        Ok(u32::from_le_bytes(self.array(what)?))
    }

    pub fn u64(&mut self, what: &str) -> Result<u64, Defect> {
        Ok(u64::from_le_bytes(self.array(what)?))
    }

    /// Bytes behind their length of 32 bits.
    pub fn bytes(&mut self, what: &str) -> Result<&'a [u8], Defect> {
        let length = self.u32(what)?;
        self.take(u64::from(length), what)
    }

    /// Bytes behind their length of 64 bits.
    pub fn long_bytes(&mut self, what: &str) -> Result<&'a [u8], Defect> {
        let length = self.u64(what)?;
        self.take(length, what)
    }

    pub fn text(&mut self, what: &str) -> Result<&'a str, Defect> {
        let at = self.at;
        std::str::from_utf8(self.bytes(what)?)
            .map_err(|_| Defect::new(at, format!("{what} in UTF-8")))
    }

    pub fn map(&mut self, what: &str) -> Result<BTreeMap<String, String>, Defect> {
        let length = self.u32(what)?;
        let end = self.at + self.take(u64::from(length), what)?.len();
        let mut entries = Fields { bytes: &self.bytes[..end], at: end - length as usize };
        let mut map = BTreeMap::new();
        while entries.at < end {
            let (key, value) = (entries.text(what)?, entries.text(what)?);
            map.insert(key.to_owned(), value.to_owned());
        }
        Ok(map)
    }
}

/// The definition of a message type.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Schema {
    /// Its number in the file, not 0.
    pub id: u16,
    /// The type's name, such as `sensor_msgs/msg/Imu`.
    pub name: String,
    /// What the definition is written in, such as `ros2msg`.
    pub encoding: String,
    /// The definition.
    pub data: Vec<u8>,
}

impl Schema {
    pub(crate) fn read(bytes: &[u8], at: usize) -> Result<Self, Defect> {
        let mut fields = Fields::new(bytes, at);
        let id = fields.u16("a schema's number")?;
        let (name_at, name) = (fields.at, fields.text("a schema's name")?);
        if name.len() > MOST_NAME {
            let found = name.len();
            let expected = format!("a schema's name of at most {MOST_NAME} bytes, found {found}");
            return Err(Defect::new(name_at, expected));
        }
        Ok(Self {
            id,
            name: name.to_owned(),
            encoding: fields.text("a schema's encoding")?.to_owned(),
            data: fields.bytes("a schema's definition")?.to_vec(),
        })
    }
}

/// Messages of one topic and one type.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub struct Channel {
    /// Its number in the file.
    pub id: u16,
    /// The number of its [`Schema`]; 0 where it has none.
    pub schema_id: u16,
    /// The topic's name.
    pub topic: String,
    /// What its messages' bytes are, such as `cdr`.
    pub message_encoding: String,
    /// What else the recorder knew of it.
    pub metadata: BTreeMap<String, String>,
}

impl Channel {
    pub(crate) fn read(bytes: &[u8], at: usize) -> Result<Self, Defect> {
        let mut fields = Fields::new(bytes, at);
        Ok(Self {
            id: fields.u16("a channel's number")?,
            schema_id: fields.u16("a channel's schema")?,
            topic: fields.text("a channel's topic")?.to_owned(),
            message_encoding: fields.text("a channel's message encoding")?.to_owned(),
            metadata: fields.map("a channel's metadata")?,
        })
    }
}

/// A file within the recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attachment<'a> {
    /// When it was recorded, in nanoseconds.
    pub log_time: u64,
    /// When it was made, in nanoseconds; 0 where it is not known.
    pub create_time: u64,
    /// Its name.
    pub name: &'a str,
    /// Its media type, such as `text/plain`.
    pub media_type: &'a str,
    /// What it holds.
    pub data: &'a [u8],
}

impl<'a> Attachment<'a> {
    /// With the CRC-32 that the record ends in, and where that lies.
    pub(crate) fn read(bytes: &'a [u8], at: usize) -> Result<(Self, u32, usize), Defect> {
        let mut fields = Fields::new(bytes, at);
        let attachment = Self {
            log_time: fields.u64("an attachment's time")?,
            create_time: fields.u64("an attachment's time")?,
            name: fields.text("an attachment's name")?,
            media_type: fields.text("an attachment's media type")?,
            data: fields.long_bytes("an attachment")?,
        };
        let end = fields.at;
        Ok((attachment, fields.u32("an attachment's CRC-32")?, end))
    }
}

/// Words about the recording.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Metadata {
    /// What they are about.
    pub name: String,
    /// Keys and values.
    pub entries: BTreeMap<String, String>,
}

impl Metadata {
    pub(crate) fn read(bytes: &[u8], at: usize) -> Result<Self, Defect> {
        let mut fields = Fields::new(bytes, at);
        let name = fields.text("a metadata record's name")?.to_owned();
        Ok(Self { name, entries: fields.map("metadata")? })
    }
}
