//! What there is in a recording, without looking at a message.

use std::collections::BTreeMap;

use crate::Mcap;

impl Mcap {
    /// The size of the file in bytes.
    pub fn file_size(&self) -> u64 {
        self.file.len() as u64
    }

    /// How many chunks there are of each compression, by its name; `none` where the records lie
    /// as they are. Messages outside of chunks have none.
    pub fn chunks(&self) -> BTreeMap<&'static str, usize> {
        let mut chunks = BTreeMap::new();
        for part in self.parts.iter().filter(|part| part.is_chunk()) {
            let name = part.packed.map_or("none", |packed| packed.compression.name());
            *chunks.entry(name).or_default() += 1;
        }
        chunks
    }

    /// How many messages each connection has, by its id; by the message indexes where chunks are
    /// still compressed.
    pub fn counts(&self) -> BTreeMap<u32, u64> {
        let mut counts = BTreeMap::new();
        for part in &self.parts {
            match part.made.get() {
                Some(made) => made.walked.counts.iter().for_each(|each| {
                    *counts.entry(u32::from(each.channel)).or_default() += u64::from(each.messages);
                }),
                None => part.promised.iter().for_each(|each| {
                    *counts.entry(u32::from(each.channel)).or_default() += each.messages();
                }),
            }
        }
        counts
    }
}
