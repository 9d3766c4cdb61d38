//! The records inside a chunk's uncompressed data.

use crate::record::{self, Defect, Fields, MAX_HEADER, OP_CONNECTION, OP_MESSAGE, time_at, u32_at};
use crate::{Connection, ahead};

/// Bytes of a MESSAGE record without data: no message takes less.
pub(crate) const LEAST_MESSAGE: u64 = 46;
/// Bytes of a MESSAGE record's header as everybody writes it.
const MESSAGE_HEADER: usize = 38;
/// How many records ahead memory is asked for.
pub(crate) const AHEAD: usize = 16;

/// One record of a chunk.
#[derive(Debug)]
pub(crate) enum ChunkRecord {
    Connection(Box<Connection>),
    /// The frame is the bytes `start..end` of the chunk: length, then data.
    Message {
        connection: u32,
        time: u64,
        start: u32,
        end: u32,
    },
}

/// A message, as in [`ChunkRecord::Message`].
pub(crate) struct Usual {
    pub connection: u32,
    pub time: u64,
    pub start: u32,
    pub end: u32,
}

/// Walks a chunk's records without copying them.
pub(crate) struct ChunkWalk<'a> {
    bytes: &'a [u8],
    /// The offset of the next record: all before it is whole.
    pub at: usize,
}

impl<'a> ChunkWalk<'a> {
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { bytes, at: 0 }
    }

    /// The next record if it is a message as everybody writes it: nearly all are.
    #[inline]
    pub fn next_usual(&mut self) -> Option<Usual> {
        let rest = self.bytes.get(self.at..)?;
        let (head, data) = rest.split_first_chunk::<{ LEAST_MESSAGE as usize }>()?;
        if head[..4] != (MESSAGE_HEADER as u32).to_le_bytes() {
            return None;
        }
        let header = head[4..4 + MESSAGE_HEADER].try_into().ok()?;
        let (connection, time) = usual_header(header)?;
        let length = u32_at(head, 4 + MESSAGE_HEADER)? as usize;
        if length > data.len() {
            return None;
        }
        let start = self.at + 4 + MESSAGE_HEADER;
        self.at = start + 4 + length;
        // Messages of a topic are mostly of one length, so this is where a later one should be.
        if let Some(far) = (length + LEAST_MESSAGE as usize).checked_mul(AHEAD) {
            ahead::ask(rest, far, LEAST_MESSAGE as usize);
        }
        // Chunks end below 4 GiB because their size is a u32.
        Some(Usual { connection, time, start: start as u32, end: self.at as u32 })
    }

    /// The next record, or `None` at the end.
    pub fn next_record(&mut self) -> Result<Option<ChunkRecord>, Defect> {
        if let Some(Usual { connection, time, start, end }) = self.next_usual() {
            return Ok(Some(ChunkRecord::Message { connection, time, start, end }));
        }
        let at = self.at;
        if at == self.bytes.len() {
            return Ok(None);
        }
        let cut = |what: &str| Defect::new(at, format!("a whole record in the chunk ({what})"));
        let header_length = u32_at(self.bytes, at).ok_or_else(|| cut("its header length"))?;
        if header_length > MAX_HEADER {
            return Err(cut("a header of at most 1 MiB"));
        }
        let header_end = at + 4 + header_length as usize;
        let header = self.bytes.get(at + 4..header_end).ok_or_else(|| cut("its header"))?;
        let data_length = u32_at(self.bytes, header_end).ok_or_else(|| cut("its data length"))?;
        let end = (header_end + 4)
            .checked_add(data_length as usize)
            .filter(|end| *end <= self.bytes.len())
            .ok_or_else(|| cut("its data"))?;
        let shift = |defect: Defect| Defect::new(at + 4 + defect.at, defect.expected);
        let record = match message_header(header).map_err(shift)? {
            Header::Message { connection, time } => ChunkRecord::Message {
                connection,
                time,
                // Chunks end below 4 GiB because their size is a u32.
                start: header_end as u32,
                end: end as u32,
            },
            Header::Connection => {
                let data = &self.bytes[header_end + 4..end];
                let connection = record::connection(header, data).map_err(shift)?;
                ChunkRecord::Connection(Box::new(connection))
            }
        };
        self.at = end;
        Ok(Some(record))
    }
}

enum Header {
    Message { connection: u32, time: u64 },
    Connection,
}

/// The two orders of fields that recorders write: rosbag's C++ and this crate sort them by name,
/// rosbag's Python puts the op first.
#[inline]
fn usual_header(header: &[u8; MESSAGE_HEADER]) -> Option<(u32, u64)> {
    const OP: &[u8; 8] = &[4, 0, 0, 0, b'o', b'p', b'=', OP_MESSAGE];
    const CONN: &[u8; 9] = b"\x09\0\0\0conn=";
    const TIME: &[u8; 9] = b"\x0d\0\0\0time=";
    if header[21..30] != TIME[..] {
        return None;
    }
    let connection = if header[..8] == OP[..] && header[8..17] == CONN[..] {
        u32_at(header, 17)?
    } else if header[..9] == CONN[..] && header[13..21] == OP[..] {
        u32_at(header, 9)?
    } else {
        return None;
    };
    Some((connection, time_at(header, 30)?))
}

/// One pass over the fields, in whatever order they come.
fn message_header(header: &[u8]) -> Result<Header, Defect> {
    let (mut op, mut connection, mut time) = (None, None, None);
    let mut fields = Fields::new(header);
    while let Some((name, value)) = fields.next_field()? {
        match (name, value.len()) {
            (b"op", 1) => op = Some(value[0]),
            (b"conn", 4) => connection = u32_at(value, 0),
            (b"time", 8) => time = time_at(value, 0),
            _ => {}
        }
    }
    match (op, connection, time) {
        (Some(OP_MESSAGE), Some(connection), Some(time)) => {
            Ok(Header::Message { connection, time })
        }
        (Some(OP_CONNECTION), ..) => Ok(Header::Connection),
        (Some(OP_MESSAGE), ..) => Err(Defect::new(0, "fields conn (4 bytes) and time (8 bytes)")),
        (Some(op), ..) => {
            Err(Defect::new(0, format!("a MESSAGE (2) or CONNECTION (7) record, found op {op}")))
        }
        (None, ..) => Err(Defect::new(0, "a field op (1 byte)")),
    }
}
