//! Where a bag's bytes lie: the paper's `ChunkedFile`, in memory or on disk.

use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Random access to a bag's bytes; from several threads, as chunks are uncompressed side by
/// side.
pub trait ChunkedFile: Sync {
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

impl<F: ChunkedFile> ChunkedFile for &F {
    fn len(&self) -> u64 {
        (*self).len()
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        (*self).read_at(offset, into)
    }

    fn slice(&self, offset: u64, length: usize) -> Option<&[u8]> {
        (*self).slice(offset, length)
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

/// Reads ahead by a window, so that a run of short records is not a system call for each
/// field. What lies in memory passes through.
pub(crate) struct ReadAhead<'f, F> {
    file: &'f F,
    window: usize,
    /// Where the bytes that are held begin, and the bytes.
    held: Mutex<(u64, Vec<u8>)>,
}

impl<'f, F: ChunkedFile> ReadAhead<'f, F> {
    pub fn new(file: &'f F, window: usize) -> Self {
        Self { file, window, held: Mutex::new((0, Vec::new())) }
    }
}

impl<F: ChunkedFile> ChunkedFile for ReadAhead<'_, F> {
    fn len(&self) -> u64 {
        self.file.len()
    }

    fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
        if into.len() > self.window {
            return self.file.read_at(offset, into);
        }
        let mut held = self.held.lock().unwrap_or_else(PoisonError::into_inner);
        let inside = |held: &(u64, Vec<u8>)| {
            let start = usize::try_from(offset.checked_sub(held.0)?).ok()?;
            Some(start..start.checked_add(into.len())?).filter(|range| range.end <= held.1.len())
        };
        if inside(&held).is_none() {
            let length = self.file.len().saturating_sub(offset).min(self.window as u64) as usize;
            held.0 = offset;
            held.1.resize(length, 0);
            let outcome = self.file.read_at(offset, &mut held.1);
            if outcome.is_err() {
                held.1.clear();
                return outcome;
            }
        }
        let range = inside(&held).ok_or(io::ErrorKind::UnexpectedEof)?;
        into.copy_from_slice(&held.1[range]);
        Ok(())
    }

    fn slice(&self, offset: u64, length: usize) -> Option<&[u8]> {
        self.file.slice(offset, length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that must be read, and how often they were.
    struct Counted(Vec<u8>, Mutex<usize>);

    impl ChunkedFile for Counted {
        fn len(&self) -> u64 {
            self.0.len() as u64
        }

        fn read_at(&self, offset: u64, into: &mut [u8]) -> io::Result<()> {
            *self.1.lock().unwrap() += 1;
            MemoryChunkedFile::new(self.0.clone()).read_at(offset, into)
        }

        fn slice(&self, _offset: u64, _length: usize) -> Option<&[u8]> {
            None
        }
    }

    #[test]
    fn a_window_is_read_once_and_its_bytes_are_the_files() {
        let file = Counted((0..=255).collect(), Mutex::new(0));
        let ahead = ReadAhead::new(&file, 64);
        for at in 0..250u64 {
            let mut four = [0; 4];
            ahead.read_at(at, &mut four).unwrap();
            assert_eq!(four, [0, 1, 2, 3].map(|step| at as u8 + step));
        }
        assert_eq!(*file.1.lock().unwrap(), 5);
        let mut most = [0; 100];
        ahead.read_at(150, &mut most).unwrap();
        assert_eq!((most[0], most[99]), (150, 249));
        assert!(ahead.read_at(254, &mut [0; 4]).is_err());
        assert!(ahead.read_at(u64::MAX, &mut [0; 4]).is_err());
    }
}
