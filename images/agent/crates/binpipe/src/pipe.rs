//! One session over a reader and a writer.

use std::fs::File;
use std::io::{self, Read, Write};

use bagpipe_wire::{
    Abort, Decoder, Encoder, End, FrameError, FrameType, MAX_PAYLOAD, PROTOCOL, from_map, to_map,
};
use serde::{Deserialize, Serialize};

use crate::field::Fields;

const SOFTWARE: &str = concat!("bagpipe-binpipe rust ", env!("CARGO_PKG_VERSION"));
const READ_BYTES: usize = 1 << 20;
const FLUSH_BYTES: usize = 256 * 1024;

/// Why the stream can't go on.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// The worker's pipe fails, or the worker is gone.
    #[error("the pipe to the worker: {0}")]
    Io(#[from] io::Error),
    /// Bytes that are no frame.
    #[error("the input: {0}")]
    Frame(#[from] FrameError),
    /// A frame's map is not what it should be.
    #[error("a frame's map can't be read: {0}")]
    Map(#[from] rmp_serde::decode::Error),
    /// A map can't be written.
    #[error("a frame's map can't be written: {0}")]
    Encode(#[from] rmp_serde::encode::Error),
    /// The two sides don't follow the protocol.
    #[error("{0}")]
    Protocol(String),
}

fn protocol(message: impl Into<String>) -> Error {
    Error::Protocol(message.into())
}

#[derive(Serialize, Deserialize)]
struct Hello {
    session: String,
    protocol: u32,
    #[serde(default)]
    software: String,
}

#[derive(Serialize)]
struct Head<'a> {
    name: &'a str,
    size: Option<u64>,
    fields: &'a Fields,
}

#[derive(Serialize)]
struct ProgramEnd {
    files: u64,
    bytes: u64,
    digest: u32,
    input: u32,
}

/// An input record without its bytes, which [`Pipe::piece`] and [`Pipe::read`] give.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct Record {
    /// Its name, usually a URI.
    pub name: String,
    /// Bytes; `None` when the size is not known before the record's end.
    #[serde(default)]
    pub size: Option<u64>,
    /// Its typed fields.
    #[serde(default)]
    pub fields: Fields,
}

/// The records of one session.
#[derive(Debug)]
pub struct Pipe<R = File, W = File> {
    input: R,
    output: W,
    decoder: Decoder,
    encoder: Encoder,
    buffer: Vec<u8>,
    begin: usize,
    end: usize,
    kind: FrameType,
    payload: Vec<u8>,
    /// The frame in `payload` has been looked at and belongs to what comes next.
    put_back: bool,
    pending: Vec<u8>,
    /// Bytes that are left of the record; `None` where that is not known.
    left: Option<u64>,
    in_record: bool,
    input_digest: Option<u32>,
}

impl Pipe {
    /// The session on stdin and stdout. What is printed from then on goes to stderr.
    pub fn standard() -> Result<Self, Error> {
        // A child of the program must not keep the frames' descriptors open.
        let kept = |file| rustix::io::fcntl_dupfd_cloexec(file, 3).map_err(io::Error::from);
        let (input, output) = (kept(rustix::stdio::stdin())?, kept(rustix::stdio::stdout())?);
        rustix::stdio::dup2_stdin(File::open("/dev/null")?).map_err(io::Error::from)?;
        rustix::stdio::dup2_stdout(rustix::stdio::stderr()).map_err(io::Error::from)?;
        Self::new(File::from(input), File::from(output))
    }
}

impl<R: Read, W: Write> Pipe<R, W> {
    /// The session on these two, for example named pipes.
    pub fn new(input: R, output: W) -> Result<Self, Error> {
        let mut pipe = Self {
            input,
            output,
            decoder: Decoder::new(),
            encoder: Encoder::new(),
            buffer: vec![0; READ_BYTES],
            begin: 0,
            end: 0,
            kind: FrameType::Abort,
            payload: Vec::new(),
            put_back: false,
            pending: Vec::with_capacity(FLUSH_BYTES + MAX_PAYLOAD),
            left: None,
            in_record: false,
            input_digest: None,
        };
        if !pipe.next_frame()? || pipe.kind != FrameType::Hello {
            return Err(protocol("stdin holds no session: bin_piped starts such a program"));
        }
        let hello: Hello = from_map(&pipe.payload)?;
        if hello.protocol != PROTOCOL {
            return Err(protocol(format!("the worker speaks protocol {}", hello.protocol)));
        }
        let software = SOFTWARE.to_owned();
        pipe.send_map(FrameType::Hello, &Hello { software, ..hello })?;
        Ok(pipe)
    }

    /// The next record; what was left of the one before is skipped. `None` after the last.
    pub fn next_record(&mut self) -> Result<Option<Record>, Error> {
        while self.piece()?.is_some() {}
        if self.input_digest.is_some() {
            return Ok(None);
        }
        self.need_frame()?;
        match self.kind {
            FrameType::File => {
                let record: Record = from_map(&self.payload)?;
                self.left = record.size;
                self.in_record = true;
                Ok(Some(record))
            }
            FrameType::End => {
                let end: End = from_map(&self.payload)?;
                if end.digest != self.decoder.digest() {
                    return Err(protocol("END of the input does not fit what came before it"));
                }
                self.input_digest = Some(end.digest);
                Ok(None)
            }
            other => Err(protocol(format!("{} stands between two records", other.name()))),
        }
    }

    /// The next bytes of the record, at most 1 MiB; `None` at its end.
    pub fn piece(&mut self) -> Result<Option<&[u8]>, Error> {
        if !self.in_record || self.left == Some(0) {
            self.in_record = false;
            return Ok(None);
        }
        self.need_frame()?;
        if self.kind == FrameType::Data {
            let taken = self.payload.len() as u64;
            self.left = match self.left.map(|left| left.checked_sub(taken)) {
                Some(None) => return Err(protocol("a record is longer than its size")),
                left => left.flatten(),
            };
            return Ok(Some(&self.payload));
        }
        if let Some(left) = self.left {
            return Err(protocol(format!("a record ends {left} bytes too early")));
        }
        self.put_back = true;
        self.in_record = false;
        Ok(None)
    }

    /// All that is left of the record.
    pub fn read(&mut self) -> Result<Vec<u8>, Error> {
        let mut all = Vec::new();
        while let Some(piece) = self.piece()? {
            all.extend_from_slice(piece);
        }
        Ok(all)
    }

    /// One output record.
    pub fn write(&mut self, name: &str, data: &[u8], fields: &Fields) -> Result<(), Error> {
        self.begin(name, Some(data.len() as u64), fields)?;
        self.append(data)
    }

    /// An output record in parts: then [`Pipe::append`]. With a size, exactly so many bytes.
    pub fn begin(&mut self, name: &str, size: Option<u64>, fields: &Fields) -> Result<(), Error> {
        self.send_map(FrameType::File, &Head { name, size, fields })
    }

    /// More bytes of the record that was begun.
    pub fn append(&mut self, data: &[u8]) -> Result<(), Error> {
        data.chunks(MAX_PAYLOAD).try_for_each(|piece| self.send(FrameType::Data, piece))
    }

    /// Hand over what was written so far. Waiting for input and `finish` do it as well.
    pub fn flush(&mut self) -> Result<(), Error> {
        self.output.write_all(&self.pending)?;
        self.pending.clear();
        Ok(self.output.flush()?)
    }

    /// The end of the output; an error where input is left that nobody asked for.
    pub fn finish(mut self) -> Result<(), Error> {
        let Some(input) = self.input_digest else {
            let message = "the program ended before it had asked for all its records".to_owned();
            let reason = "InputLeft".to_owned();
            let abort = Abort { reason, message: message.clone(), ..Abort::default() };
            self.send_map(FrameType::Abort, &abort)?;
            self.flush()?;
            return Err(Error::Protocol(message));
        };
        let End { files, bytes, digest } = self.encoder.end();
        self.send_map(FrameType::End, &ProgramEnd { files, bytes, digest, input })?;
        self.flush()
    }

    fn send_map(&mut self, kind: FrameType, map: &impl Serialize) -> Result<(), Error> {
        let payload = to_map(map)?;
        self.send(kind, &payload)
    }

    fn send(&mut self, kind: FrameType, payload: &[u8]) -> Result<(), Error> {
        let header = self.encoder.header(kind, payload).ok_or_else(|| {
            protocol(format!("{} of {} bytes is above 1 MiB", kind.name(), payload.len()))
        })?;
        self.pending.extend_from_slice(&header);
        self.pending.extend_from_slice(payload);
        if self.pending.len() >= FLUSH_BYTES { self.flush() } else { Ok(()) }
    }

    fn need_frame(&mut self) -> Result<(), Error> {
        if !std::mem::take(&mut self.put_back) && !self.next_frame()? {
            return Err(protocol("the worker left before the end of its records"));
        }
        if self.kind == FrameType::Abort {
            let abort: Abort = from_map(&self.payload)?;
            return Err(protocol(format!("the worker gave up: {}", abort.message)));
        }
        Ok(())
    }

    /// The next frame into `kind` and `payload`; false at the end of the stream.
    fn next_frame(&mut self) -> Result<bool, Error> {
        loop {
            let mut rest = &self.buffer[self.begin..self.end];
            let before = rest.len();
            if let Some(frame) = self.decoder.next_frame(&mut rest)? {
                self.kind = frame.kind;
                self.payload.clear();
                self.payload.extend_from_slice(frame.payload);
                self.begin += before - rest.len();
                return Ok(true);
            }
            self.flush()?;
            self.begin = 0;
            self.end = self.input.read(&mut self.buffer)?;
            if self.end == 0 {
                self.decoder.finish()?;
                return Ok(false);
            }
        }
    }
}
