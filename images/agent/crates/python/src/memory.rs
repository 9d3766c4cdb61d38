//! Where the bytes of a bag lie that Python opened, and the bag over them.

use std::io;
use std::sync::Arc;

use bagpipe_log::Loss;
use bagpipe_rosbag::{Bag, ChunkedFile, Limits};
use pyo3::PyErr;
use pyo3::pybacked::PyBackedBytes;

use crate::{error, from_mcap};

/// The bytes of a bag: Python's own `bytes`, which never change and which this keeps alive, or
/// ours.
#[derive(Debug)]
pub enum Memory {
    /// Of a `bytes` object, not copied.
    Python(PyBackedBytes),
    /// Read from a file, written, or copied from a buffer that may change.
    Rust(Vec<u8>),
}

impl Memory {
    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        match self {
            Self::Python(bytes) => bytes,
            Self::Rust(bytes) => bytes,
        }
    }
}

impl Memory {
    /// The bytes themselves; a copy of Python's.
    fn into_bytes(self) -> Vec<u8> {
        match self {
            Self::Python(bytes) => bytes.to_vec(),
            Self::Rust(bytes) => bytes,
        }
    }
}

impl ChunkedFile for Memory {
    fn len(&self) -> u64 {
        self.bytes().len() as u64
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let found = self.slice(offset, into.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(found);
        Ok(())
    }

    fn slice(&self, offset: u64, length: usize) -> Option<&[u8]> {
        let start = usize::try_from(offset).ok()?;
        self.bytes().get(start..start.checked_add(length)?)
    }
}

/// An open bag, kept by everything that shows a part of it.
#[derive(Debug)]
pub struct Opened {
    /// The bag.
    pub bag: Bag<Memory>,
    /// Its path, for errors.
    pub name: Option<String>,
    /// What it was opened with; a slice of it gets the same.
    pub limits: Limits,
    /// What the recording had lost of which the bag was made; else the bag says that itself.
    lost: Option<Loss>,
}

impl Opened {
    /// Opens a bag, or what can be one; of a damaged one, what is whole. `mcap_topics` are those
    /// of which a bag is made, where one is made (`None`: all).
    pub fn open(
        memory: Memory,
        name: Option<String>,
        limits: Limits,
        mcap_topics: Option<&[String]>,
    ) -> Result<Arc<Self>, PyErr> {
        let (memory, lost) = if from_mcap::is_mcap(memory.bytes()) {
            let made = from_mcap::bag(memory.into_bytes(), limits, mcap_topics);
            let (bytes, lost) =
                made.map_err(|sentence| error::bag_error(name.as_deref(), &sentence))?;
            (Memory::Rust(bytes), lost)
        } else {
            (memory, None)
        };
        let bag = Bag::open_limited(memory, limits)
            .map_err(|error| error::raised(name.as_deref(), &error))?;
        Ok(Arc::new(Self { bag, name, limits, lost }))
    }

    /// What was lost to damage.
    pub fn loss(&self) -> Option<&Loss> {
        self.lost.as_ref().or(self.bag.loss())
    }

    /// An error of the crate about this bag.
    pub fn raised(&self, error: &bagpipe_rosbag::BagError) -> PyErr {
        error::raised(self.name.as_deref(), error)
    }

    /// A sentence about this bag as an exception.
    pub fn error(&self, sentence: &str) -> PyErr {
        error::bag_error(self.name.as_deref(), sentence)
    }
}
