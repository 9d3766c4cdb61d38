//! What the verbs that make recordings share: reading one, and writing one beside it.

use std::io::Write;
use std::path::{Path, PathBuf};

use bagpipe_formats::{FormatError, Kind, Recordings, kind_of};
use bagpipe_log::Loss;
use bagpipe_rosbag::{Bag, BagError, ChunkedFile, DiskChunkedFile, Limits};
use clap::{Args, ValueEnum};

use crate::formats::Refused;
use crate::size::bytes;

/// Where the new recording goes, and how.
#[derive(Debug, Clone, Args)]
pub struct Output {
    /// The new recording; a file that is there is never overwritten.
    #[arg(long, short, value_name = "FILE")]
    pub output: PathBuf,
    /// How rewritten chunks are compressed (a bag: none, lz4 or bz2; MCAP: none, lz4 or zstd).
    /// A bag's whole chunks stay as they are.
    #[arg(long, value_enum, default_value = "none")]
    pub compression: Packing,
}

/// How much memory a recording may take.
#[derive(Debug, Clone, Copy, Args)]
pub struct Memory {
    /// The most memory that what a bag holds compressed, or in format 1.2, may take, for each
    /// bag; and any other recording's file, and again what it holds compressed. Bytes, or a
    /// number with KiB, MiB or GiB.
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

    /// Opens a recording that is no bag, in whatever state it is.
    pub fn recordings(self, path: &Path) -> Result<Recordings, String> {
        Recordings::open(path, self.memory_budget).map_err(|error| failed(path, &error))
    }

    /// The same with every chunk uncompressed, so that what is lost is known.
    pub fn scanned(self, path: &Path) -> Result<Recordings, String> {
        Recordings::scanned(path, self.memory_budget).map_err(|error| failed(path, &error))
    }

    /// A recording that is no bag; damage is an error, because a part of a part would look whole.
    pub fn whole_recordings(self, path: &Path) -> Result<Recordings, String> {
        let recordings = self.recordings(path)?;
        match recordings.loss() {
            None => Ok(recordings),
            Some(lost) => Err(damaged(path, lost)),
        }
    }

    /// Opens a bag; damage is an error as well.
    pub fn open_whole(self, path: &Path) -> Result<Bag<DiskChunkedFile>, String> {
        let bag = self.open(path, file(path)?)?;
        match bag.loss() {
            None => Ok(bag),
            Some(lost) => Err(damaged(path, lost)),
        }
    }
}

fn damaged(path: &Path, lost: &Loss) -> String {
    let lost = loss(lost);
    format!("{}: {lost}; `bagpipe-agent reindex` saves what is whole", path.display())
}

/// The format of a recording.
pub fn kind(path: &Path) -> Result<Kind, String> {
    kind_of(path).map_err(|error| format!("{}: {error}", path.display()))
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
        _ => "",
    };
    format!("{}: {error}{advice}", path.display())
}

/// Why a recording of any format could not be read or made, and what to do.
pub fn failed(path: &Path, error: &FormatError) -> String {
    let advice = if error.over_memory() { "; --memory-budget allows more" } else { "" };
    format!("{}: {error}{advice}", path.display())
}

/// The compressions of all formats.
#[derive(Debug, Clone, Copy, ValueEnum)]
pub enum Packing {
    None,
    Lz4,
    Bz2,
    Zstd,
}

impl Output {
    /// How rewritten chunks are compressed.
    pub fn packing(&self) -> bagpipe_formats::Packing {
        match self.compression {
            Packing::None => bagpipe_formats::Packing::None,
            Packing::Lz4 => bagpipe_formats::Packing::Lz4,
            Packing::Bz2 => bagpipe_formats::Packing::Bz2,
            Packing::Zstd => bagpipe_formats::Packing::Zstd,
        }
    }

    /// How a bag is written.
    pub fn of_bag(&self) -> Result<bagpipe_rosbag::WriterOptions, String> {
        self.packing().of_bag().map_err(|error| format!("--compression: {error}"))
    }

    /// How MCAP is written.
    pub fn of_mcap(&self) -> Result<bagpipe_mcap::WriterOptions, String> {
        self.packing().of_mcap().map_err(|error| format!("--compression: {error}"))
    }

    /// Writes the recording under a passing name first: no reader sees half of it.
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
