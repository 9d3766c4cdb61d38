//! Records: a header of `name=value` fields, then data.

use std::borrow::Cow;

use crate::{BagError, ChunkedFile, Connection};

pub(crate) const OP_MESSAGE: u8 = 2;
pub(crate) const OP_FILE_HEADER: u8 = 3;
pub(crate) const OP_INDEX: u8 = 4;
pub(crate) const OP_CHUNK: u8 = 5;
pub(crate) const OP_CHUNK_INFO: u8 = 6;
pub(crate) const OP_CONNECTION: u8 = 7;

/// Record headers hold a few short fields; a longer one is damage, not data.
pub(crate) const MAX_HEADER: u32 = 1 << 20;

/// What is wrong at a place in a buffer; the caller knows where the buffer lies.
#[derive(Debug)]
pub(crate) struct Defect {
    pub at: usize,
    pub expected: String,
}

impl Defect {
    pub fn new(at: usize, expected: impl Into<String>) -> Self {
        Self { at, expected: expected.into() }
    }

    pub fn in_file(self, base: u64) -> BagError {
        BagError::damaged(base + self.at as u64, self.expected)
    }
}

pub(crate) fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    let four = bytes.get(at..at.checked_add(4)?)?;
    Some(u32::from_le_bytes(four.try_into().ok()?))
}

pub(crate) fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    let eight = bytes.get(at..at.checked_add(8)?)?;
    Some(u64::from_le_bytes(eight.try_into().ok()?))
}

/// ROS time (seconds, nanoseconds) as nanoseconds.
pub(crate) fn time_at(bytes: &[u8], at: usize) -> Option<u64> {
    let seconds = u32_at(bytes, at)?;
    let nanoseconds = u32_at(bytes, at.checked_add(4)?)?;
    Some(u64::from(seconds) * 1_000_000_000 + u64::from(nanoseconds))
}

/// Why bytes that stand behind their own length are not all there.
#[derive(Debug)]
pub(crate) enum Short {
    /// Not even the length is.
    Length { at: usize },
    /// The length at `at` demands more bytes than are left behind it.
    Bytes { at: usize, needed: u32, left: usize },
}

impl Short {
    pub fn at(&self) -> usize {
        match self {
            Self::Length { at } | Self::Bytes { at, .. } => *at,
        }
    }
}

/// The bytes behind the length that stands at `at`.
pub(crate) fn sized(bytes: &[u8], at: usize) -> Result<&[u8], Short> {
    let needed = u32_at(bytes, at).ok_or(Short::Length { at })?;
    let behind = bytes.get(at + 4..).unwrap_or_default();
    behind.get(..needed as usize).ok_or(Short::Bytes { at, needed, left: behind.len() })
}

/// A field's name and value.
pub type Field<'a> = (&'a [u8], &'a [u8]);

/// What is wrong with a record's header, for whoever has its own words for it.
#[derive(Debug)]
pub(crate) enum FieldDefect {
    Short(Short),
    /// A field without `=`.
    Nameless {
        at: usize,
    },
}

impl From<FieldDefect> for Defect {
    fn from(defect: FieldDefect) -> Self {
        match defect {
            FieldDefect::Short(Short::Length { at }) => Self::new(at, "a field's length"),
            FieldDefect::Short(Short::Bytes { at, needed, left }) => {
                Self::new(at, format!("a field of at most {left} bytes, found {needed}"))
            }
            FieldDefect::Nameless { at } => Self::new(at, "a field of the form name=value"),
        }
    }
}

/// Walks the fields of a record's header.
pub(crate) struct Fields<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Fields<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next field, its value's place included, or `None` at the end.
    pub fn next_field(&mut self) -> Result<Option<Field<'a>>, FieldDefect> {
        if self.at == self.bytes.len() {
            return Ok(None);
        }
        let at = self.at;
        let field = sized(self.bytes, at).map_err(FieldDefect::Short)?;
        let equals =
            field.iter().position(|byte| *byte == b'=').ok_or(FieldDefect::Nameless { at })?;
        self.at = at + 4 + field.len();
        Ok(Some((&field[..equals], &field[equals + 1..])))
    }

    /// The value of the first field of that name.
    pub fn find(bytes: &'a [u8], name: &str) -> Result<Option<&'a [u8]>, Defect> {
        let mut fields = Fields::new(bytes);
        while let Some((found, value)) = fields.next_field()? {
            if found == name.as_bytes() {
                return Ok(Some(value));
            }
        }
        Ok(None)
    }

    /// The same, with its absence an error.
    pub fn require(bytes: &'a [u8], name: &str) -> Result<&'a [u8], Defect> {
        Self::find(bytes, name)?
            .ok_or_else(|| Defect::new(0, format!("a field named {name:?} in the record's header")))
    }

    pub fn require_u32(bytes: &'a [u8], name: &str) -> Result<u32, Defect> {
        let value = Self::require(bytes, name)?;
        u32_at(value, 0)
            .filter(|_| value.len() == 4)
            .ok_or_else(|| Defect::new(0, format!("4 bytes in the field {name:?}")))
    }

    pub fn require_u64(bytes: &'a [u8], name: &str) -> Result<u64, Defect> {
        let value = Self::require(bytes, name)?;
        u64_at(value, 0)
            .filter(|_| value.len() == 8)
            .ok_or_else(|| Defect::new(0, format!("8 bytes in the field {name:?}")))
    }

    pub fn op(bytes: &'a [u8]) -> Result<u8, Defect> {
        match Self::require(bytes, "op")? {
            [op] => Ok(*op),
            _ => Err(Defect::new(0, "1 byte in the field \"op\"")),
        }
    }
}

/// A record of the file's top level: its header, and where its data lies.
pub(crate) struct FileRecord<'a> {
    pub header: Cow<'a, [u8]>,
    pub header_position: u64,
    pub op: u8,
    pub data_position: u64,
    pub data_length: u32,
}

impl<'a> FileRecord<'a> {
    /// The offset just behind the record; may lie behind the file's end.
    pub fn end(&self) -> u64 {
        self.data_position + u64::from(self.data_length)
    }

    /// Reads the record's header at `position`; its data may be cut off.
    pub fn read(file: &'a impl ChunkedFile, position: u64) -> Result<Self, BagError> {
        let header_length = read_u32(file, position, "a record's header length")?;
        if header_length > MAX_HEADER {
            let expected = format!("a header of at most {MAX_HEADER} bytes, found {header_length}");
            return Err(BagError::damaged(position, expected));
        }
        let header_position = position + 4;
        let header = read_bytes(file, header_position, header_length, "a record's header")?;
        let length_position = header_position + u64::from(header_length);
        let data_length = read_u32(file, length_position, "a record's data length")?;
        let op = Fields::op(&header).map_err(|defect| defect.in_file(header_position))?;
        let data_position = length_position + 4;
        Ok(Self { header, header_position, op, data_position, data_length })
    }

    /// Reads the record's data, which must be there as a whole.
    pub fn data<'f>(&self, file: &'f impl ChunkedFile) -> Result<Cow<'f, [u8]>, BagError> {
        read_bytes(file, self.data_position, self.data_length, "a record's data")
    }

    pub fn in_header(&self, defect: Defect) -> BagError {
        defect.in_file(self.header_position)
    }
}

fn read_u32(file: &impl ChunkedFile, offset: u64, what: &str) -> Result<u32, BagError> {
    if let Some(bytes) = file.slice(offset, 4) {
        return u32_at(bytes, 0).ok_or_else(|| BagError::damaged(offset, what));
    }
    check_room(file, offset, 4, what)?;
    let mut bytes = [0; 4];
    file.read_at(offset, &mut bytes).map_err(|source| BagError::Io {
        offset,
        length: 4,
        source,
    })?;
    Ok(u32::from_le_bytes(bytes))
}

fn check_room(
    file: &impl ChunkedFile,
    offset: u64,
    length: u32,
    what: &str,
) -> Result<(), BagError> {
    let available = file.len().saturating_sub(offset);
    if u64::from(length) > available {
        let expected = format!("{length} bytes of {what}, found the end after {available}");
        return Err(BagError::damaged(offset, expected));
    }
    Ok(())
}

/// Bytes, borrowed where they lie in memory. Reads only after checking that the file has
/// them, so that a length is never believed.
pub(crate) fn read_bytes<'f>(
    file: &'f impl ChunkedFile,
    offset: u64,
    length: u32,
    what: &str,
) -> Result<Cow<'f, [u8]>, BagError> {
    if let Some(bytes) = file.slice(offset, length as usize) {
        return Ok(Cow::Borrowed(bytes));
    }
    check_room(file, offset, length, what)?;
    let mut bytes = vec![0; length as usize];
    file.read_at(offset, &mut bytes).map_err(|source| BagError::Io {
        offset,
        length: bytes.len(),
        source,
    })?;
    Ok(Cow::Owned(bytes))
}

/// A CONNECTION record's two headers as a [`Connection`].
pub(crate) fn connection(header: &[u8], data: &[u8]) -> Result<Connection, Defect> {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let id = Fields::require_u32(header, "conn")?;
    let topic = text(Fields::require(header, "topic")?);
    let datatype = text(Fields::require(data, "type")?);
    let md5sum = text(Fields::require(data, "md5sum")?);
    let definition = Fields::find(data, "message_definition")?.map(text).unwrap_or_default().into();
    let caller_id = Fields::find(data, "callerid")?.map(text);
    let latching = Fields::find(data, "latching")? == Some(b"1");
    let known = Connection { id, topic, datatype, md5sum, definition, ..Connection::default() };
    Ok(Connection { caller_id, latching, ..known })
}
