//! What is in a recording, as data.

use std::collections::BTreeMap;

use bagpipe_mcap::Mcap;

use crate::Recordings;

/// What there is of one topic and type.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// As it was recorded.
    pub topic: String,
    /// Its type.
    pub datatype: String,
    /// What its messages' bytes are, such as `cdr`.
    pub encoding: String,
    /// How many messages.
    pub messages: u64,
}

/// What is in a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Described {
    /// Files.
    pub files: usize,
    /// Bytes of them.
    pub bytes: u64,
    /// The first and the last time, in nanoseconds.
    pub times: Option<(u64, u64)>,
    /// Messages.
    pub messages: u64,
    /// Chunks of each compression.
    pub chunks: BTreeMap<&'static str, usize>,
    /// Attachments, and metadata records.
    pub surroundings: (usize, usize),
    /// By topic and type.
    pub topics: Vec<Topic>,
}

/// What is in a recording.
pub fn described(recordings: &Recordings) -> Described {
    let mut chunks = BTreeMap::new();
    let mut topics: BTreeMap<(&str, &str, &str), u64> = BTreeMap::new();
    for file in &recordings.files {
        for (name, count) in file.chunks() {
            *chunks.entry(name).or_default() += count;
        }
        let counts = file.counts();
        for each in file.connections() {
            let key = (&*each.topic, &*each.datatype, each.message_encoding.name());
            *topics.entry(key).or_default() += counts.get(&each.id).copied().unwrap_or(0);
        }
    }
    let files = || recordings.files.iter();
    Described {
        files: recordings.files.len(),
        bytes: files().map(Mcap::file_size).sum(),
        times: recordings.time_range(),
        messages: recordings.message_count(),
        chunks,
        surroundings: (
            files().map(|file| file.attachments().count()).sum(),
            files().map(|file| file.metadata().len()).sum(),
        ),
        topics: topics
            .into_iter()
            .map(|((topic, datatype, encoding), messages)| Topic {
                topic: topic.to_owned(),
                datatype: datatype.to_owned(),
                encoding: encoding.to_owned(),
                messages,
            })
            .collect(),
    }
}
