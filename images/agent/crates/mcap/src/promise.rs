//! What the message indexes behind a chunk say of its messages.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::tail::ADVICE;
use crate::walk::{Count, with_time};

/// Bytes of an entry: a message's time and its place.
const INDEX_ENTRY: usize = 16;

/// The message index of one channel.
#[derive(Debug)]
pub(crate) struct Promise {
    pub channel: u16,
    /// Where its entries lie in the file.
    pub entries: Range<usize>,
}

impl Promise {
    /// How many messages it names.
    pub fn messages(&self) -> u64 {
        (self.entries.len() / INDEX_ENTRY) as u64
    }

    fn times(&self, file: &[u8]) -> u64 {
        let entries = file[self.entries.clone()].chunks_exact(INDEX_ENTRY);
        let times = entries.filter_map(|entry| entry.first_chunk().copied());
        times.map(u64::from_le_bytes).fold(0, with_time)
    }
}

/// A channel of which a chunk has other messages than its message index names.
#[derive(Debug)]
pub(crate) struct Broken {
    pub channel: u16,
    /// Messages.
    named: u64,
    found: u64,
}

impl Broken {
    /// The first one of a chunk.
    pub fn find(promised: &[Promise], found: &[Count], file: &[u8]) -> Option<Self> {
        let mut named: BTreeMap<u16, (u64, u64)> = BTreeMap::new();
        for each in promised {
            // Some writers give a channel that has no message an index, too.
            if each.messages() > 0 {
                let (messages, times) = named.entry(each.channel).or_default();
                *messages += each.messages();
                *times = times.wrapping_add(each.times(file));
            }
        }
        let mut found: BTreeMap<u16, (u64, u64)> = found
            .iter()
            .map(|each| (each.channel, (u64::from(each.messages), each.times)))
            .collect();
        for channel in named.keys() {
            found.entry(*channel).or_default();
        }
        let other = |(channel, found): (u16, (u64, u64))| {
            let named = named.get(&channel).copied().unwrap_or_default();
            (named != found).then_some(Self { channel, named: named.0, found: found.0 })
        };
        found.into_iter().find_map(other)
    }

    /// What was expected, where `topic` is the channel's, if that is known.
    pub fn expected(&self, topic: Option<&str>) -> String {
        let Self { channel, named, found } = self;
        let of = match topic {
            Some(topic) => format!("{topic} (channel {channel})"),
            None => format!("channel {channel}"),
        };
        if named == found {
            return format!(
                "messages of {of} in this chunk at the times that its message index has: {ADVICE}"
            );
        }
        format!(
            "{named} messages of {of} in this chunk, as its message index has them, found {found}: \
             {ADVICE}"
        )
    }
}
