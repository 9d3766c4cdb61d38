//! The way without the cache: a case's bag and its recording as files, to be measured beside.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use rustix::fs::{Advice, fadvise, fdatasync};

use crate::case::failure::Failure;

/// Where one slot's files lie.
pub struct OnDisk {
    folder: PathBuf,
    slot: u32,
    cold: bool,
}

impl OnDisk {
    /// The files of a slot; `cold`, the page cache forgets each before it is read.
    pub fn new(folder: &Path, slot: u32, cold: bool) -> Self {
        Self { folder: folder.to_owned(), slot, cold }
    }

    /// The path of the case's bag.
    pub fn input(&self) -> PathBuf {
        self.folder.join(format!("input-{}.bag", self.slot))
    }

    /// The path of the recording; nothing is there.
    pub fn recording(&self) -> Result<PathBuf, Failure> {
        let path = self.folder.join(format!("recording-{}.bag", self.slot));
        match std::fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(failed(&path, &error)),
            _ => Ok(path),
        }
    }

    /// Writes the case's bag, by `fill`.
    pub fn write<T>(
        &self,
        fill: impl FnOnce(&mut dyn Write) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let path = self.input();
        let with_path = |error: io::Error| failed(&path, &error);
        let mut file = BufWriter::with_capacity(1 << 20, File::create(&path).map_err(with_path)?);
        let filled = fill(&mut file)?;
        file.flush().map_err(with_path)?;
        Ok(filled)
    }

    /// Has the page cache forget a file where that is asked for, and says how long that took:
    /// it is no part of what is measured.
    pub fn settle(&self, path: &Path) -> Result<(), Failure> {
        if !self.cold {
            return Ok(());
        }
        let begun = Instant::now();
        let forget = || -> io::Result<()> {
            let file = File::open(path)?;
            fdatasync(&file)?;
            Ok(fadvise(&file, 0, None, Advice::DontNeed)?)
        };
        forget().map_err(|error| failed(path, &error))?;
        eprintln!("[slot {}] forgotten after {:.6} s", self.slot, begun.elapsed().as_secs_f64());
        Ok(())
    }
}

/// A file could not be written or read.
pub fn failed(path: &Path, error: &io::Error) -> Failure {
    Failure::new("Internal", format!("{}: {error}", path.display()))
}
