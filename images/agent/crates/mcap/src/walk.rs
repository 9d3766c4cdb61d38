//! The records of a chunk, or of the data section between two chunks: where messages lie, and
//! what is declared.

use bagpipe_log::Place;

use crate::loss::Tally;
use crate::publish::{FRAME_IN_RECORD, UpperHalves};
use crate::record::{CHANNEL, Channel, DATA_END, Defect, HEAD, Head, MESSAGE, MESSAGE_FIELDS};
use crate::record::{SCHEMA, Schema};

/// A Message record without data.
pub(crate) const LEAST_MESSAGE: usize = HEAD + MESSAGE_FIELDS;

/// A schema or a channel.
#[derive(Debug)]
pub(crate) enum Declared {
    Schema(Schema),
    Channel(Channel),
}

/// The messages of one channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Count {
    pub channel: u16,
    pub messages: u32,
    /// Where the first one's record lies.
    pub first: u32,
    /// Of their times ([`with_time`]).
    pub times: u64,
}

/// What a walk has found so far.
#[derive(Debug, Default)]
pub(crate) struct Walked {
    /// Messages, as they lie; their connections are the channels' numbers.
    pub places: Vec<Place>,
    pub counts: Vec<Count>,
    /// By where they lie.
    pub declared: Vec<(u32, Declared)>,
    pub upper_halves: UpperHalves,
    pub lost: Tally,
    /// The first and the last time; meaningless without a message.
    pub times: (u64, u64),
}

impl Walked {
    /// Forgets all and keeps the memory.
    pub fn clear(&mut self) {
        self.places.clear();
        self.counts.clear();
        self.declared.clear();
        self.upper_halves.clear();
        self.lost = Tally::default();
    }
}

/// A table from channels to places in [`Walked::counts`], used for one walk after the other.
#[derive(Debug, Default)]
pub(crate) struct Channels(Vec<u32>);

impl Channels {
    /// Makes the table empty behind a walk that is over.
    pub fn forget(&mut self, counts: &[Count]) {
        for count in counts {
            *self.slot(count.channel) = 0;
        }
    }

    #[inline]
    fn slot(&mut self, channel: u16) -> &mut u32 {
        let at = usize::from(channel);
        if at >= self.0.len() {
            self.0.resize(at + 1, 0);
        }
        &mut self.0[at]
    }
}

/// Walks through records and puts each message's length before its data.
pub(crate) struct Walk<'w> {
    pub walked: &'w mut Walked,
    pub channels: &'w mut Channels,
    /// The number that the places get.
    pub chunk: u32,
    /// True for a chunk's records: there may be no others than those of messages.
    pub inside: bool,
}

impl Walk<'_> {
    /// Goes on from `at` until the bytes end, or where there is a record that only a data
    /// section has; and says where that is. Bytes are fewer than 4 GiB.
    pub fn run(&mut self, bytes: &mut [u8], mut at: usize) -> usize {
        loop {
            while let Some(next) = self.usual_message(bytes, at) {
                at = next;
            }
            if at == bytes.len() {
                return at;
            }
            let head = match Head::read(bytes, at) {
                Ok(head) => head,
                Err(_) if !self.inside => return at,
                Err(defect) => return self.stop(bytes, defect),
            };
            let Some(end) = head.end(bytes.len()) else {
                if self.inside {
                    return self.stop(bytes, head.cut(bytes.len()));
                }
                return at;
            };
            if !self.inside && !matches!(head.op, SCHEMA | CHANNEL | MESSAGE) {
                return at;
            }
            self.record(&bytes[..end], at, head);
            at = end;
        }
    }

    /// Takes the record if it is a whole message, as nearly all are.
    #[inline]
    fn usual_message(&mut self, bytes: &mut [u8], at: usize) -> Option<usize> {
        let (head, data) = bytes.get_mut(at..)?.split_first_chunk_mut::<LEAST_MESSAGE>()?;
        if head[0] != MESSAGE {
            return None;
        }
        let data_length = u64_in(head, 1).checked_sub(MESSAGE_FIELDS as u64)?;
        if data_length > data.len() as u64 {
            return None;
        }
        let channel = u16::from_le_bytes([head[9], head[10]]);
        let (time, publish_time) = (u64_in(head, 15), u64_in(head, 23));
        // Bytes are fewer than 4 GiB.
        let start = (at + FRAME_IN_RECORD) as u32;
        self.walked.upper_halves.keep(start, time, publish_time);
        head[FRAME_IN_RECORD..].copy_from_slice(&(data_length as u32).to_le_bytes());
        let end = at + LEAST_MESSAGE + data_length as usize;
        self.count(channel, at as u32, time);
        let (first, last) = self.walked.times;
        self.walked.times = if self.walked.places.is_empty() {
            (time, time)
        } else {
            (first.min(time), last.max(time))
        };
        let connection = u32::from(channel);
        let (chunk, end_of_place) = (self.chunk, end as u32);
        self.walked.places.push(Place { time, chunk, start, end: end_of_place, connection });
        Some(end)
    }

    #[inline]
    fn count(&mut self, channel: u16, at: u32, time: u64) {
        let slot = self.channels.slot(channel);
        if *slot == 0 {
            let times = with_time(0, time);
            self.walked.counts.push(Count { channel, messages: 1, first: at, times });
            *slot = self.walked.counts.len() as u32;
        } else {
            let count = &mut self.walked.counts[*slot as usize - 1];
            count.messages += 1;
            count.times = with_time(count.times, time);
        }
    }

    /// Any other record, which ends where the bytes do.
    fn record(&mut self, bytes: &[u8], at: usize, head: Head) {
        let declared = match head.op {
            SCHEMA => Schema::read(bytes, head.start).map(Declared::Schema),
            CHANNEL => Channel::read(bytes, head.start).map(Declared::Channel),
            MESSAGE => {
                let found = bytes.len() - head.start;
                let expected =
                    format!("a message of at least {MESSAGE_FIELDS} bytes, found {found}");
                return self.lose(Defect::new(at + 1, expected), bytes.len() - at, Some(1));
            }
            op if op > DATA_END => return,
            op => {
                let expected =
                    format!("a schema, a channel or a message in a chunk, found opcode {op}");
                return self.lose(Defect::new(at, expected), bytes.len() - at, Some(0));
            }
        };
        match declared {
            Ok(declared) => self.walked.declared.push((at as u32, declared)),
            Err(defect) => self.lose(defect, bytes.len() - at, Some(0)),
        }
    }

    fn lose(&mut self, defect: Defect, bytes: usize, messages: Option<u64>) {
        self.walked.lost.add(defect.at, defect.expected, bytes as u64, messages);
    }

    /// Nothing says where the next record of the chunk begins.
    fn stop(&mut self, bytes: &[u8], defect: Defect) -> usize {
        let lost = bytes.len() - defect.at.min(bytes.len());
        self.lose(defect, lost, None);
        bytes.len()
    }
}

/// A sum of times with one more: the same for the same times in any order.
#[inline]
pub(crate) fn with_time(sum: u64, time: u64) -> u64 {
    // Mixed, since of plain times two that are wrong could make up for each other.
    let mixed = time.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    sum.wrapping_add(mixed ^ (mixed >> 32))
}

#[inline]
fn u64_in(head: &[u8; LEAST_MESSAGE], at: usize) -> u64 {
    let mut bytes = [0; 8];
    bytes.copy_from_slice(&head[at..at + 8]);
    u64::from_le_bytes(bytes)
}
