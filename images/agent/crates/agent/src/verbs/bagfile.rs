//! What the verbs that make bags share: reading one, and writing one beside it.

use std::io::Write;
use std::path::{Path, PathBuf};

use bagpipe_log::Loss;
use bagpipe_rosbag::{
    Bag, BagError, ChunkedFile, Compression, DiskChunkedFile, Limits, WriterOptions,
};
use clap::{Args, ValueEnum};

use crate::formats::Refused;
use crate::size::bytes;

/// Where the new bag goes, and how.
#[derive(Debug, Clone, Args)]
pub struct Output {
    /// The new bag; a file that is there is never overwritten.
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
    /// How rewritten chunks are compressed; whole chunks stay as they are.
    #[arg(long, value_enum, default_value = "none")]
    pub compression: Packing,
}

/// How much memory a bag may take.
#[derive(Debug, Clone, Copy, Args)]
pub struct Memory {
    /// The most memory that what a bag holds compressed, or in format 1.2, may take, for each
    /// bag: bytes, or a number with KiB, MiB or GiB.
    #[arg(long, value_name = "SIZE", default_value = "4GiB", value_parser = bytes)]
    pub memory_budget: u64,
}

impl Memory {
    /// The same for the reader.
    pub fn limits(self) -> Limits {
        Limits { decompressed_bytes: self.memory_budget }
    }

    /// Opens a bag in whatever state it is.
    pub fn open<F: ChunkedFile>(self, path: &Path, file: F) -> Result<Bag<F>, String> {
        Bag::open_limited(file, self.limits()).map_err(|error| unreadable(path, &error))
    }

    /// Opens a bag; damage is an error, because a part of a part would look whole.
    pub fn open_whole(self, path: &Path) -> Result<Bag<DiskChunkedFile>, String> {
        let bag = self.open(path, file(path)?)?;
        match bag.loss() {
            None => Ok(bag),
            Some(lost) => Err(format!(
                "{}: {}; `bagpipe-agent reindex` saves what is whole",
                path.display(),
                loss(lost)
            )),
        }
    }
}

/// Writes a file so that it is there as a whole or not at all.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let mut active = path.as_os_str().to_owned();
    active.push(".active");
    std::fs::write(&active, bytes)
        .and_then(|()| std::fs::rename(&active, path))
        .map_err(|error| format!("{}: {error}", path.display()))
}

/// Why a recording could not be read, and what to do.
pub fn refused(path: &Path, refused: &Refused) -> String {
    let advice = if refused.over_memory { "; --memory-budget allows more" } else { "" };
    format!("{}: {}{advice}", path.display(), refused.text)
}

/// Why a bag could not be read or made, and what to do.
pub fn unreadable(path: &Path, error: &BagError) -> String {
    let advice = match error {
        BagError::MemoryLimit { .. } | BagError::BudgetExceeded { .. } => {
            "; --memory-budget allows more"
        }
        BagError::NotABag { found, .. } if found.contains("MCAP") => {
            "; it is MCAP, which `play` alone takes"
        }
        _ => "",
    };
    format!("{}: {error}{advice}", path.display())
}

/// The three compressions by the names that `rosbag` uses.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Packing {
    None,
    Lz4,
    Bz2,
}

impl Output {
    /// How the bag is written.
    pub fn options(&self) -> WriterOptions {
        let compression = match self.compression {
            Packing::None => Compression::None,
            Packing::Lz4 => Compression::Lz4,
            Packing::Bz2 => Compression::Bz2,
        };
        WriterOptions::with_compression(compression)
    }

    /// Writes the bag under a passing name first: no reader sees half of it.
    pub fn write(&self, bytes: &[u8]) -> Result<(), String> {
        let path = &self.output;
        let fail = |error: std::io::Error| format!("cannot write {}: {error}", path.display());
        if path.exists() {
            return Err(format!("{} is there already; choose another name", path.display()));
        }
        let mut passing = path.clone().into_os_string();
        passing.push(".part");
        let mut file = std::fs::File::create(&passing).map_err(fail)?;
        file.write_all(bytes).and_then(|()| file.sync_all()).map_err(fail)?;
        std::fs::rename(&passing, path).map_err(fail)
    }
}

/// Opens the file, without reading it whole.
pub fn file(path: &Path) -> Result<DiskChunkedFile, String> {
    DiskChunkedFile::open(path).map_err(|error| format!("{}: {error}", path.display()))
}

/// What was lost, as a sentence.
pub fn loss(loss: &Loss) -> String {
    let messages = match loss.messages {
        Some(count) => format!("{count} messages"),
        None => "an unknown number of messages".to_owned(),
    };
    format!(
        "damaged at byte {}: expected {}; {} bytes and {messages} are lost",
        loss.offset, loss.description, loss.bytes
    )
}
