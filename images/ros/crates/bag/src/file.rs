//! Where a bag's bytes lie: the paper's `ChunkedFile`, in memory or on disk.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;

/// Random access to a bag's bytes.
pub trait ChunkedFile {
    /// Length in bytes.
    fn len(&self) -> u64;

    /// Fills `into` with the bytes from `offset` on; an error if there are fewer.
    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()>;

    /// The bytes themselves, when they lie in memory; `None` when they must be read.
    fn slice(&self, offset: u64, length: usize) -> Option<&[u8]>;

    /// True when there is not one byte.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// A bag that lies in memory as a whole: reads are borrows.
#[derive(Debug, Clone, Default)]
pub struct MemoryChunkedFile {
    bytes: Vec<u8>,
}

impl MemoryChunkedFile {
    /// Takes the bytes of a bag.
    pub fn new(bytes: Vec<u8>) -> Self {
        Self { bytes }
    }

    /// Gives the bytes back.
    pub fn into_inner(self) -> Vec<u8> {
        self.bytes
    }
}

impl From<Vec<u8>> for MemoryChunkedFile {
    fn from(bytes: Vec<u8>) -> Self {
        Self::new(bytes)
    }
}

impl ChunkedFile for MemoryChunkedFile {
    fn len(&self) -> u64 {
        self.bytes.len() as u64
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        let found = self.slice(offset, into.len()).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(found);
        Ok(())
    }

    fn slice(&self, offset: u64, length: usize) -> Option<&[u8]> {
        let start = usize::try_from(offset).ok()?;
        self.bytes.get(start..start.checked_add(length)?)
    }
}

/// A bag in a file, read with `pread`: the way without the cache.
#[derive(Debug)]
pub struct DiskChunkedFile {
    file: File,
    length: u64,
}

impl DiskChunkedFile {
    /// Opens the file for reading.
    pub fn open(path: impl AsRef<Path>) -> io::Result<Self> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        Ok(Self { file, length })
    }
}

impl ChunkedFile for DiskChunkedFile {
    fn len(&self) -> u64 {
        self.length
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        self.file.read_exact_at(into, offset)
    }

    fn slice(&self, _offset: u64, _length: usize) -> Option<&[u8]> {
        None
    }
}
