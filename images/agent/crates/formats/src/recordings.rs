//! Recordings that lie in memory as MCAP.

use std::path::Path;

use bagpipe_log::{Checked, Connection, Loss, Window, mixed_types, packed};
use bagpipe_mcap::{Latched, Limits, Mcap, Sliced, WriterOptions};
use bagpipe_rosbag2::{Database, Folder, METADATA, Metadata, Reading, Selection, mcap_of_database};

use crate::{FormatError, Kind, kind_of};

/// Everything but a bag: the files of one recording, in their order.
#[derive(Debug)]
pub struct Recordings {
    /// Each of them.
    pub files: Vec<Mcap>,
    /// Of a folder of rosbag2, what its `metadata.yaml` says.
    pub metadata: Option<Metadata>,
}

impl Recordings {
    /// Reads a file, or a folder's files, into memory and opens them. `memory` bounds the bytes
    /// of the files, and again those of their uncompressed chunks.
    ///
    /// # Errors
    /// [`FormatError::System`], [`FormatError::Mcap`], [`FormatError::Rosbag2`], or
    /// [`FormatError::Refused`] for a file that is larger than the memory, or whose messages were
    /// compressed one by one.
    pub fn open(path: &Path, memory: u64) -> Result<Self, FormatError> {
        let opened = Self::read(path, Reading { memory, scanned: false })?;
        match opened.files.iter().find_map(Mcap::packed_topic) {
            None => Ok(opened),
            Some(topic) => Err(FormatError::Refused(packed(topic))),
        }
    }

    /// The same with every chunk uncompressed: damage in one is a loss, and no error later. What the
    /// messages are is not asked, so that a file of a folder can be mended alone.
    ///
    /// # Errors
    /// As [`Recordings::open`].
    pub fn scanned(path: &Path, memory: u64) -> Result<Self, FormatError> {
        Self::read(path, Reading { memory, scanned: true })
    }

    fn read(path: &Path, how: Reading) -> Result<Self, FormatError> {
        match kind_of(path)? {
            Kind::Folder => {
                let Folder { metadata, files } = Folder::open(folder_of(path), how)?;
                Ok(Self { files, metadata: Some(metadata) })
            }
            Kind::Database => {
                let selection = Selection::all(&|_| true);
                let bytes = mcap_of_database(&Database::open(path)?, &selection, how.memory)?;
                Self::of_bytes(bytes, how.memory)
            }
            Kind::Mcap | Kind::Bag => {
                let bytes = bounded(path, how.memory)?;
                Ok(Self { files: vec![how.open(bytes)?], metadata: None })
            }
        }
    }

    /// The same as [`Recordings::open`] of an MCAP file's bytes.
    ///
    /// # Errors
    /// [`FormatError::Mcap`].
    pub fn of_bytes(bytes: Vec<u8>, memory: u64) -> Result<Self, FormatError> {
        let limits = Limits { decompressed_bytes: memory };
        Ok(Self { files: vec![Mcap::open_limited(bytes, limits)?], metadata: None })
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
        Ok(bagpipe_mcap::slice(&self.files, window, Latched::AT_START, wanted, options)?)
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

    /// Reads every record of a recording and compares what it finds with the summary, and with
    /// `metadata.yaml`.
    ///
    /// # Errors
    /// As [`Recordings::open`].
    pub fn check(path: &Path, memory: u64) -> Result<Checked, FormatError> {
        if kind_of(path)? == Kind::Mcap {
            let limits = Limits { decompressed_bytes: memory };
            return Ok(bagpipe_mcap::check(bounded(path, memory)?, limits)?);
        }
        let found = Self::scanned(path, memory)?;
        let connections: Vec<Connection> = found.connections().cloned().collect();
        let mut problems = mixed_types(&connections);
        problems.extend(found.files.iter().find_map(Mcap::packed_topic).map(packed));
        if let Some(metadata) = &found.metadata {
            problems.extend(found.miscounted(metadata));
        }
        let messages = found.message_count();
        Ok(Checked { messages, loss: found.loss().cloned(), problems })
    }

    /// Sentences about what `metadata.yaml` counts otherwise.
    fn miscounted(&self, metadata: &Metadata) -> Vec<String> {
        let found = self.message_count();
        let mut problems = Vec::new();
        if metadata.messages != found {
            let counted = metadata.messages;
            problems
                .push(format!("{METADATA} counts {counted} messages, and the files hold {found}"));
        }
        let counts: Vec<_> = self.files.iter().map(Mcap::counts).collect();
        for of in &metadata.topics {
            let found: u64 = self
                .files
                .iter()
                .zip(&counts)
                .flat_map(|(file, counts)| {
                    let of_it = file.connections().iter().filter(|each| each.topic == of.topic);
                    of_it.map(|each| counts.get(&each.id).copied().unwrap_or(0))
                })
                .sum();
            if of.messages != found {
                let (topic, counted) = (&of.topic, of.messages);
                problems.push(format!(
                    "{METADATA} counts {counted} messages of {topic}, and the files hold {found}"
                ));
            }
        }
        problems
    }

    /// With the profile that the recording has.
    fn profiled(&self, options: WriterOptions) -> WriterOptions {
        let profile = self.files.first().map(|file| file.profile().to_owned());
        WriterOptions { profile: profile.unwrap_or_default(), ..options }
    }
}

/// The folder that a path names, perhaps by its `metadata.yaml`.
fn folder_of(path: &Path) -> &Path {
    if path.is_dir() { path } else { path.parent().unwrap_or(path) }
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
