//! Recordings that lie in memory as MCAP.

use std::path::Path;

use bagpipe_log::{Checked, Connection, Loss, Window};
use bagpipe_mcap::{Latched, Limits, Mcap, Sliced, WriterOptions};

use crate::FormatError;

/// Everything but a bag: the files of one recording, in their order.
#[derive(Debug)]
pub struct Recordings {
    /// Each of them.
    pub files: Vec<Mcap>,
}

impl Recordings {
    /// Reads a file into memory and opens it. `memory` bounds the bytes of the file, and again
    /// those of its uncompressed chunks.
    ///
    /// # Errors
    /// [`FormatError::System`], [`FormatError::Mcap`], or [`FormatError::Refused`] for a file that
    /// is larger than the memory.
    pub fn open(path: &Path, memory: u64) -> Result<Self, FormatError> {
        Self::of_bytes(bounded(path, memory)?, memory)
    }

    /// The same with every chunk uncompressed: damage in one is a loss, and no error later.
    ///
    /// # Errors
    /// As [`Recordings::open`].
    pub fn scanned(path: &Path, memory: u64) -> Result<Self, FormatError> {
        let limits = Limits { decompressed_bytes: memory };
        Ok(Self { files: vec![Mcap::open_scanned(bounded(path, memory)?, limits)?] })
    }

    /// The same as [`Recordings::open`] of an MCAP file's bytes.
    ///
    /// # Errors
    /// [`FormatError::Mcap`].
    pub fn of_bytes(bytes: Vec<u8>, memory: u64) -> Result<Self, FormatError> {
        let limits = Limits { decompressed_bytes: memory };
        Ok(Self { files: vec![Mcap::open_limited(bytes, limits)?] })
    }

    /// What was lost to damage, in the first file that is damaged.
    pub fn loss(&self) -> Option<&Loss> {
        self.files.iter().find_map(Mcap::loss)
    }

    /// All connections of all files. Each file counts its own ids.
    pub fn connections(&self) -> impl Iterator<Item = &Connection> {
        self.files.iter().flat_map(Mcap::connections)
    }

    /// All messages, damaged ones left out.
    pub fn message_count(&self) -> u64 {
        self.files.iter().map(Mcap::message_count).sum()
    }

    /// The times of the first and the last message, in nanoseconds.
    pub fn time_range(&self) -> Option<(u64, u64)> {
        let times = || self.files.iter().filter_map(Mcap::time_range);
        Some((times().map(|(first, _)| first).min()?, times().map(|(_, last)| last).max()?))
    }

    /// A part as MCAP, latched messages in force at its start before it.
    ///
    /// # Errors
    /// [`FormatError::Mcap`].
    pub fn slice(
        &self,
        window: Window,
        wanted: impl Fn(&Connection) -> bool,
        options: WriterOptions,
    ) -> Result<Sliced, FormatError> {
        let options = self.profiled(options);
        Ok(bagpipe_mcap::slice(&self.files, window, Latched::AtStart, wanted, options)?)
    }

    /// All of it as one MCAP file, mended where it was damaged.
    ///
    /// # Errors
    /// [`FormatError::Mcap`].
    pub fn rewritten(&self, options: WriterOptions) -> Result<Vec<u8>, FormatError> {
        Ok(bagpipe_mcap::merge(&self.files, self.profiled(options))?)
    }

    /// Several recordings as one MCAP file; messages of the same time keep their order.
    ///
    /// # Errors
    /// [`FormatError::Mcap`].
    pub fn merge(all: &[Self], options: WriterOptions) -> Result<Vec<u8>, FormatError> {
        let files: Vec<&Mcap> = all.iter().flat_map(|each| &each.files).collect();
        let options = all.first().map_or(options.clone(), |first| first.profiled(options));
        Ok(bagpipe_mcap::merge(&files, options)?)
    }

    /// Reads every record of an MCAP file and compares what it finds with the summary.
    ///
    /// # Errors
    /// As [`Recordings::open`].
    pub fn check(path: &Path, memory: u64) -> Result<Checked, FormatError> {
        let limits = Limits { decompressed_bytes: memory };
        Ok(bagpipe_mcap::check(bounded(path, memory)?, limits)?)
    }

    /// With the profile that the recording has.
    fn profiled(&self, options: WriterOptions) -> WriterOptions {
        let profile = self.files.first().map(|file| file.profile().to_owned());
        WriterOptions { profile: profile.unwrap_or_default(), ..options }
    }
}

/// A file's bytes, if they are not more than that.
fn bounded(path: &Path, memory: u64) -> Result<Vec<u8>, FormatError> {
    let size = std::fs::metadata(path)?.len();
    if size > memory {
        return Err(FormatError::Refused(format!(
            "its {size} bytes are more than the memory that may be taken, {memory}; \
             --memory-budget allows more"
        )));
    }
    Ok(std::fs::read(path)?)
}
