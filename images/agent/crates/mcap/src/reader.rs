//! An MCAP file: its connections, its chunks, and the way to its messages.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::thread;

use bagpipe_log::{Connection, Message, Place, Timeline, Window};
use bagpipe_packing::threads;

use crate::asked::Asked;
use crate::layout::{Layout, lay_out};
use crate::loss::Tally;
use crate::names::Names;
use crate::part::{Made, Packed, Part};
use crate::promise::Broken;
use crate::publish::FRAME_IN_RECORD;
use crate::record::{Attachment, Metadata, Schema};
use crate::walk::{Channels, Declared, Walked};
use crate::{Channel, Loss, McapError};

/// How much memory reading may take beside the file's own bytes.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Uncompressed bytes of all compressed chunks together; `u64::MAX` is no limit. A chunk of
    /// its own is below 4 GiB.
    pub decompressed_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { decompressed_bytes: u64::MAX }
    }
}

/// What the seam has no place for: a message's number and when it was published.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stamp {
    /// The recorder's or the middleware's number of the message; 0 where there is none.
    pub sequence: u32,
    /// When it was published, in nanoseconds.
    pub publish_time: u64,
}

/// Less than this is done sooner than threads start.
const LEAST_BYTES: u64 = 1 << 20;

/// An MCAP file in memory.
#[derive(Debug)]
pub struct Mcap {
    /// Half of each publish time that lies here gave way to a length ([`crate::publish`]).
    pub(crate) file: Vec<u8>,
    profile: String,
    library: String,
    names: Names,
    connections: Vec<Connection>,
    pub(crate) parts: Vec<Part>,
    attachments: Vec<std::ops::Range<usize>>,
    metadata: Vec<Metadata>,
    limits: Limits,
    /// True where chunks may still be compressed, since the summary states enough of them.
    indexed: bool,
    /// Bytes of all chunks that were uncompressed.
    made_bytes: AtomicU64,
    lost: Tally,
}

impl Mcap {
    /// Opens a file that lies in memory. Chunks stay compressed until their messages are asked
    /// for, if the summary declares all channels and counts all messages; else all of them are
    /// uncompressed here. Every whole message before damage is kept, and [`Mcap::loss`] says
    /// what was lost.
    ///
    /// # Errors
    /// [`McapError::NotMcap`], [`McapError::Damaged`] where the Header record is not whole, or
    /// [`McapError::MemoryLimit`].
    pub fn open(file: Vec<u8>) -> Result<Self, McapError> {
        Self::open_limited(file, Limits::default())
    }

    /// [`Mcap::open`] with bounded memory.
    ///
    /// # Errors
    /// As [`Mcap::open`].
    pub fn open_limited(file: Vec<u8>, limits: Limits) -> Result<Self, McapError> {
        Self::opened(file, limits, true)
    }

    /// The same, with every chunk uncompressed, so that [`Mcap::loss`] is all that is lost.
    ///
    /// # Errors
    /// As [`Mcap::open`].
    pub fn open_scanned(file: Vec<u8>, limits: Limits) -> Result<Self, McapError> {
        Self::opened(file, limits, false)
    }

    fn opened(mut file: Vec<u8>, limits: Limits, by_index: bool) -> Result<Self, McapError> {
        let Layout { profile, library, parts, attachments, metadata, declared, statistics, lost } =
            lay_out(&mut file)?;
        let mut mcap = Self {
            file,
            profile,
            library,
            names: Names::default(),
            connections: Vec::new(),
            parts,
            attachments,
            metadata,
            limits,
            indexed: false,
            made_bytes: AtomicU64::new(0),
            lost,
        };
        for (offset, declared) in declared {
            mcap.names.add(offset, declared, &mut mcap.lost);
        }
        mcap.learn();
        mcap.compare_plain();
        mcap.indexed = by_index && mcap.is_indexed(statistics);
        if !mcap.indexed {
            let all: Vec<usize> = (0..mcap.parts.len()).collect();
            mcap.unpack(&all)?;
            mcap.learn();
            mcap.settle(statistics);
        }
        mcap.connections = mcap.names.connections();
        Ok(mcap)
    }

    /// All channels, in the order in which the file declares them: the summary first.
    pub fn connections(&self) -> &[Connection] {
        &self.connections
    }

    /// The same, as they lie in the file.
    pub fn channels(&self) -> &[Channel] {
        &self.names.channels
    }

    /// The definitions of the channels' types, as they lie in the file.
    pub fn schemas(&self) -> &[Schema] {
        &self.names.schemas
    }

    /// What the header says of the recorded system, such as `ros2`.
    pub fn profile(&self) -> &str {
        &self.profile
    }

    /// What the header says of who wrote the file.
    pub fn library(&self) -> &str {
        &self.library
    }

    /// What was lost to damage; `None` when the file is whole as far as it has been read.
    /// (Damage inside a chunk that [`Mcap::open`] left compressed is an error of
    /// [`Mcap::timeline`].)
    pub fn loss(&self) -> Option<&Loss> {
        self.lost.as_ref()
    }

    /// How many messages the file holds, damaged ones left out.
    pub fn message_count(&self) -> u64 {
        self.parts.iter().map(Part::messages).sum()
    }

    /// The times of the first and the last message, in nanoseconds; of chunks that are still
    /// compressed, as these state them.
    pub fn time_range(&self) -> Option<(u64, u64)> {
        let times = || self.parts.iter().filter_map(Part::times);
        Some((times().map(|(start, _)| start).min()?, times().map(|(_, end)| end).max()?))
    }

    /// The files within the recording, as they lie in it.
    pub fn attachments(&self) -> impl Iterator<Item = Attachment<'_>> {
        self.attachments.iter().filter_map(|range| {
            let (attachment, ..) = Attachment::read(&self.file[..range.end], range.start).ok()?;
            Some(attachment)
        })
    }

    /// Words about the recording, as they lie in it.
    pub fn metadata(&self) -> &[Metadata] {
        &self.metadata
    }

    /// All messages of the connections that `wanted` keeps, by (time, place in the file).
    /// Chunks without such a connection are not touched.
    ///
    /// # Errors
    /// [`McapError::MemoryLimit`]; [`McapError::Damaged`] for what [`Mcap::loss`] does not
    /// already report.
    pub fn timeline(
        &self,
        wanted: impl Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, McapError> {
        self.ordered(wanted, None)
    }

    /// Those of them that lie in the window; chunks that state other times are not touched.
    ///
    /// # Errors
    /// As [`Mcap::timeline`].
    pub fn timeline_within(
        &self,
        window: Window,
        wanted: impl Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, McapError> {
        self.ordered(wanted, Some(window))
    }

    fn ordered(
        &self,
        wanted: impl Fn(&Connection) -> bool,
        window: Option<Window>,
    ) -> Result<Timeline<'_>, McapError> {
        let asked = self.asked(wanted);
        let mut chosen = self.holding(&asked);
        if let Some(window) = window {
            let near = |(first, last): (u64, u64)| window.overlaps(first, last);
            chosen.retain(|at| self.parts[*at].times().is_some_and(near));
        }
        self.unpack(&chosen)?;
        let mut chunks: Vec<&[u8]> = vec![&[]; self.parts.len()];
        let expected: u64 = chosen.iter().map(|at| self.parts[*at].messages()).sum();
        let mut places = Vec::with_capacity(expected as usize);
        for at in chosen {
            let (bytes, walked) = self.found(at)?;
            chunks[at] = bytes;
            let all = walked.counts.iter().all(|count| asked.has(count.channel.into()));
            if all && window.is_none() {
                places.extend_from_slice(&walked.places);
                continue;
            }
            let inside = |time: u64| window.is_none_or(|window| window.contains(time));
            let of_these = |place: &&Place| asked.has(place.connection) && inside(place.time);
            places.extend(walked.places.iter().filter(of_these));
        }
        Ok(Timeline::new(chunks, places))
    }

    /// The same messages in the order in which they lie in the file, each once: a chunk that is
    /// uncompressed for it goes into the memory of the one before.
    ///
    /// # Errors
    /// As [`Mcap::timeline`], when the chunk's turn comes.
    pub fn pass(
        &self,
        wanted: impl Fn(&Connection) -> bool,
        mut take: impl FnMut(Message<'_>),
    ) -> Result<(), McapError> {
        let asked = self.asked(wanted);
        let mut room = Room::default();
        for at in self.holding(&asked) {
            give(self.lent(at, &mut room)?, &asked, &mut take);
        }
        Ok(())
    }

    /// A part's records; those of a chunk that is uncompressed for it lie in this room.
    pub(crate) fn lent<'a>(
        &'a self,
        at: usize,
        Room { channels, made }: &'a mut Room,
    ) -> Result<(&'a [u8], &'a Walked), McapError> {
        let part = &self.parts[at];
        let (Some(packed), None) = (part.packed, part.made.get()) else { return self.found(at) };
        self.check_limit(part.position, packed, self.allowed())?;
        *made = part.make((packed, at as u32), &self.file, channels, std::mem::take(made));
        self.compare(part, made);
        whole(made)
    }

    /// What else the file says of a message of [`Mcap::timeline`], by its place; `None` where
    /// there is no such message.
    pub fn stamp(&self, place: &Place) -> Option<Stamp> {
        let bytes = self.chunk(place.chunk)?;
        let made = self.parts.get(place.chunk as usize)?.made.get()?;
        let record = (place.start as usize).checked_sub(FRAME_IN_RECORD)?;
        let word = |at: usize| Some(u32::from_le_bytes(*bytes.get(record + at..)?.first_chunk()?));
        let halves = &made.walked.upper_halves;
        let publish_time = halves.publish_time(place.start, place.time, word(23)?);
        Some(Stamp { sequence: word(11)?, publish_time })
    }

    /// The data that places of [`Mcap::timeline`] lie in, by their chunk's number; `None` where it
    /// was not asked for.
    pub fn chunk(&self, number: u32) -> Option<&[u8]> {
        let part = self.parts.get(number as usize)?;
        let made = part.made.get()?;
        Some(if part.packed.is_some() { &made.bytes } else { &self.file[part.data.clone()] })
    }

    /// A part's records, once [`Mcap::unpack`] made them.
    fn found(&self, at: usize) -> Result<(&[u8], &Walked), McapError> {
        let part = &self.parts[at];
        let made = part
            .made
            .get()
            .ok_or_else(|| McapError::damaged(part.position, "a chunk that can be uncompressed"))?;
        let Some(_) = part.packed else {
            return Ok((&self.file[part.data.clone()], &made.walked));
        };
        whole(made)
    }

    pub(crate) fn asked(&self, wanted: impl Fn(&Connection) -> bool) -> Asked {
        let mut asked = Vec::new();
        for connection in self.connections.iter().filter(|each| wanted(each)) {
            let at = connection.id as usize;
            asked.resize(asked.len().max(at + 1), false);
            asked[at] = true;
        }
        Asked(asked)
    }

    /// The parts that hold such messages.
    pub(crate) fn holding(&self, asked: &Asked) -> Vec<usize> {
        let holds = |at: &usize| self.parts[*at].holds(|channel| asked.has(channel.into()));
        (0..self.parts.len()).filter(holds).collect()
    }

    /// Uncompressed bytes that the limit leaves.
    fn allowed(&self) -> u64 {
        self.limits.decompressed_bytes.saturating_sub(self.made_bytes.load(Ordering::Relaxed))
    }

    fn check_limit(&self, at: usize, packed: Packed, allowed: u64) -> Result<u64, McapError> {
        let (offset, needed) = (at as u64, u64::from(packed.size));
        let left = allowed.checked_sub(needed);
        left.ok_or(McapError::MemoryLimit { offset, needed, allowed })
    }

    /// Uncompresses those of the parts that must be, side by side.
    fn unpack(&self, wanted: &[usize]) -> Result<(), McapError> {
        let mut left = self.allowed();
        let (mut work, mut bytes) = (Vec::new(), 0);
        for at in wanted {
            let part = &self.parts[*at];
            let Some(packed) = part.packed.filter(|_| part.made.get().is_none()) else { continue };
            left = self.check_limit(part.position, packed, left)?;
            bytes += u64::from(packed.size);
            work.push((*at, packed));
        }
        let threads = if bytes < LEAST_BYTES { 1 } else { threads().min(work.len()) };
        let next = AtomicUsize::new(0);
        let work_off = || {
            let mut channels = Channels::default();
            while let Some((at, packed)) = work.get(next.fetch_add(1, Ordering::Relaxed)) {
                let part = &self.parts[*at];
                let made =
                    part.make((*packed, *at as u32), &self.file, &mut channels, Made::default());
                self.keep(part, made);
            }
        };
        thread::scope(|scope| {
            for _ in 1..threads {
                // A thread that can't start leaves its part to the others.
                let _ = thread::Builder::new().spawn_scoped(scope, work_off);
            }
            work_off();
        });
        Ok(())
    }

    fn keep(&self, part: &Part, mut made: Made) {
        self.compare(part, &mut made);
        part.made.get_or_init(|| {
            self.made_bytes.fetch_add(made.bytes.len() as u64, Ordering::Relaxed);
            Box::new(made)
        });
    }

    /// Adds to what a chunk lost where it is not what the summary and its message indexes say.
    fn compare(&self, part: &Part, made: &mut Made) {
        let Walked { lost, declared, .. } = &mut made.walked;
        if self.indexed {
            // By them this chunk was passed over, or chosen.
            if declared.drain(..).any(|(_, declared)| self.names.contradicts(&declared)) {
                let expected = "the schemas and channels of the summary in this chunk";
                lost.add(part.position, expected.to_owned(), 0, None);
            }
        }
        if made.walked.lost.is_none()
            && let Some(expected) = self.broken_promise(part, &made.walked)
        {
            made.walked.lost.add(part.position, expected, 0, Some(0));
        }
    }

    /// The same for chunks that lie in the file as they are.
    fn compare_plain(&mut self) {
        let mut lost = Tally::default();
        for part in self.parts.iter().filter(|part| part.packed.is_none()) {
            if let Some(made) = part.made.get()
                && let Some(expected) = self.broken_promise(part, &made.walked)
            {
                lost.add(part.position, expected, 0, Some(0));
            }
        }
        self.lost.add_all(0, lost);
    }

    /// What is expected where a chunk has other messages than its message indexes name, by which
    /// cases are planned. Without a summary it need not have any.
    fn broken_promise(&self, part: &Part, walked: &Walked) -> Option<String> {
        if part.promised.is_empty() && !(self.indexed && part.packed.is_some()) {
            return None;
        }
        let broken = Broken::find(&part.promised, &walked.counts, &self.file)?;
        let of = self.names.channels.iter().find(|each| each.id == broken.channel);
        Some(broken.expected(of.map(|each| each.topic.as_str())))
    }

    /// Whether the summary declares every channel, and the indexes name every message.
    fn is_indexed(&self, statistics: Option<(usize, u64)>) -> bool {
        let promised = |part: &Part| part.promised.iter().all(|each| self.names.has(each.channel));
        self.lost.is_none()
            && statistics.is_some_and(|(_, messages)| messages == self.message_count())
            && self.names.without_schema().next().is_none()
            && self.parts.iter().all(promised)
            && self.all_known()
    }

    fn all_known(&self) -> bool {
        let known = |part: &Part| {
            part.made.get().is_none_or(|made| {
                made.walked.counts.iter().all(|count| self.names.has(count.channel))
            })
        };
        self.parts.iter().all(known)
    }

    /// Takes over what parts declare, in their order, and what they lost.
    fn learn(&mut self) {
        for part in &mut self.parts {
            let Some(made) = part.made.get_mut() else { continue };
            let walked = &mut made.walked;
            self.lost.add_all(0, std::mem::take(&mut walked.lost));
            let offset = |inside: u32| match part.packed {
                Some(_) => part.position,
                None => part.data.start + inside as usize,
            };
            let declared = std::mem::take(&mut walked.declared);
            for (at, channel, first) in late(&declared, walked) {
                if !self.names.has(channel) {
                    let expected = format!("channel {channel} declared before its first message");
                    self.lost.add(offset(first.min(at)), expected, 0, Some(0));
                }
            }
            for (at, declared) in declared {
                self.names.add(offset(at), declared, &mut self.lost);
            }
        }
    }

    /// Reports what nobody declared, and leaves such messages out.
    fn settle(&mut self, statistics: Option<(usize, u64)>) {
        for (offset, channel) in self.names.without_schema() {
            let expected =
                format!("a declared schema of channel {}, found {}", channel.id, channel.schema_id);
            self.lost.add(offset, expected, 0, Some(0));
        }
        for part in &mut self.parts {
            let Some(made) = part.made.get_mut() else { continue };
            let Walked { counts, places, .. } = &mut made.walked;
            if counts.iter().all(|count| self.names.has(count.channel)) {
                continue;
            }
            // In one pass, as any number of channels may be undeclared.
            let mut bytes: HashMap<u32, u64> = HashMap::new();
            places.retain(|place| {
                let is_declared = self.names.has(place.connection as u16);
                if !is_declared {
                    let length = u64::from(place.end - place.start);
                    *bytes.entry(place.connection).or_default() += length;
                }
                is_declared
            });
            for count in counts.iter().filter(|count| !self.names.has(count.channel)) {
                let inside = if part.packed.is_some() { 0 } else { count.first as usize };
                let expected = format!("a message of a declared channel, found {}", count.channel);
                let bytes = bytes.get(&count.channel.into()).copied().unwrap_or_default();
                let messages = Some(u64::from(count.messages));
                self.lost.add(part.data.start + inside, expected, bytes, messages);
            }
            counts.retain(|count| self.names.has(count.channel));
        }
        let found = self.message_count();
        if let (true, Some((at, stated))) = (self.lost.is_none(), statistics)
            && stated != found
        {
            let expected = format!("{found} messages in the statistics, found {stated}");
            self.lost.add(at, expected, 0, Some(stated.saturating_sub(found)));
        }
    }
}

/// What one chunk after the other is uncompressed into.
#[derive(Default)]
pub(crate) struct Room {
    channels: Channels,
    made: Made,
}

/// Records that came out of a chunk whole.
fn whole(made: &Made) -> Result<(&[u8], &Walked), McapError> {
    match made.walked.lost.as_ref() {
        Some(loss) => Err(McapError::damaged(loss.offset as usize, loss.description.clone())),
        None => Ok((&made.bytes, &made.walked)),
    }
}

/// Gives a part's messages of these channels.
fn give((bytes, walked): (&[u8], &Walked), asked: &Asked, take: &mut impl FnMut(Message<'_>)) {
    for place in walked.places.iter().filter(|place| asked.has(place.connection)) {
        let frame = &bytes[place.start as usize..place.end as usize];
        let Place { connection, time, .. } = *place;
        take(Message { connection, time, data: &frame[4..], frame });
    }
}

/// Channels that a part declares behind their first message: where both are.
fn late<'a>(
    declared: &'a [(u32, Declared)],
    walked: &'a Walked,
) -> impl Iterator<Item = (u32, u16, u32)> + 'a {
    let first: HashMap<u16, u32> =
        walked.counts.iter().map(|count| (count.channel, count.first)).collect();
    declared.iter().filter_map(move |(at, declared)| match declared {
        Declared::Channel(channel) => {
            let first = *first.get(&channel.id).filter(|first| *first < at)?;
            Some((*at, channel.id, first))
        }
        Declared::Schema(_) => None,
    })
}
