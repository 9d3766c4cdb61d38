//! Times reading and writing MCAP in memory beside the crate `mcap`, the same messages in turn
//! in one process: `cargo run --release -p bagpipe-mcap --example bench -- [rounds] [scale] [case]`,
//! where a case is such as `zstd` or `1 KB lz4`.
//! `pass` gives each message once, as the crate does; `order` has all of them by time, in memory.
//! For each case a line: the median of each, of the rounds' ratios with the least and most, and
//! of the ratios of processor time, which a busy machine disturbs less.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

use std::collections::BTreeMap;
use std::hint::black_box;
use std::io::Cursor;
use std::time::Instant;

use bagpipe_mcap::{Compression, Connection, Mcap, McapWriter, WriterOptions};

const START: u64 = 1_700_000_000_000_000_000;
const STEP: u64 = 1_000_000;
const PAYLOAD: usize = 16 << 20;

fn main() {
    let mut words = std::env::args().skip(1);
    let rounds: usize = words.next().map_or(7, |word| word.parse().unwrap());
    let scale: f64 = words.next().map_or(1.0, |word| word.parse().unwrap());
    let wanted = words.next().unwrap_or_default();
    let payload = payload();
    for (name, size, base) in [("1 KB", 1 << 10, 200_000.0), ("1 MB", 1 << 20, 200.0)] {
        let count = (base * scale) as usize;
        for compression in [Compression::None, Compression::Lz4, Compression::Zstd] {
            if format!("{name} {}", compression.name()).contains(&wanted) {
                Case { name, size, count, compression, payload: &payload }.measure(rounds);
            }
        }
    }
}

/// Bytes that LZ4 compresses to about 55 %, as it does a real AV bag's: 8 random ones and 12
/// that were there before.
fn payload() -> Vec<u8> {
    let mut state: u64 = 0x9e37_79b9_7f4a_7c15;
    let mut bytes = Vec::with_capacity(PAYLOAD + 20);
    while bytes.len() < PAYLOAD {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        let page = (bytes.len() as u64) >> 12;
        bytes.extend_from_slice(&state.to_le_bytes());
        bytes.extend_from_slice(&page.to_le_bytes());
        bytes.extend_from_slice(&[0; 4]);
    }
    bytes.truncate(PAYLOAD);
    bytes
}

/// Seconds on the clock, and of processors (in hundredths).
#[derive(Clone, Copy)]
struct Took {
    clock: f64,
    processors: f64,
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, Took) {
    let (start, before) = (Instant::now(), processors());
    let made = work();
    (made, Took { clock: start.elapsed().as_secs_f64(), processors: processors() - before })
}

/// Of this process, from /proc: in it and in the system for it.
fn processors() -> f64 {
    let text = std::fs::read_to_string("/proc/self/stat").unwrap();
    let fields = text.rsplit_once(')').unwrap().1.split_whitespace();
    fields.skip(11).take(2).map(|ticks| ticks.parse::<f64>().unwrap() / 100.0).sum()
}

fn median(mut values: Vec<f64>) -> (f64, f64, f64) {
    values.sort_by(f64::total_cmp);
    (values[0], values[values.len() / 2], values[values.len() - 1])
}

struct Case<'p> {
    name: &'static str,
    size: usize,
    count: usize,
    compression: Compression,
    payload: &'p [u8],
}

impl Case<'_> {
    fn message(&self, number: usize) -> &[u8] {
        &self.payload[number % (PAYLOAD / self.size) * self.size..][..self.size]
    }

    /// As much as the agent reserves for a recording: its budget.
    fn room(&self) -> Vec<u8> {
        Vec::with_capacity(self.count * (self.size + 128) + (1 << 20))
    }

    fn measure(&self, rounds: usize) {
        let (mut writes, mut reads, mut passes) = (Vec::new(), Vec::new(), Vec::new());
        let mut sizes = (0, 0);
        for _ in 0..rounds {
            let memory = self.room();
            let (ours, took) = timed(|| self.write(memory));
            let memory = self.room();
            let (theirs, their_time) = timed(|| self.write_by_crate(memory));
            writes.push((took, their_time));
            sizes = (ours.len(), theirs.len());
            for file in [theirs, ours] {
                // What takes the bytes over gets its own, which both read once more.
                let copy = file.clone();
                let (_, their_time) = timed(|| self.read_by_crate(&file));
                let again = file.clone();
                let (_, took) = timed(|| self.pass(again));
                passes.push((took, their_time));
                let (_, took) = timed(|| self.read(copy));
                reads.push((took, their_time));
            }
        }
        self.say("write", &writes);
        self.say("pass", &passes);
        self.say("order", &reads);
        println!("{:>12}   size: {} and {} bytes", "", sizes.0, sizes.1);
    }

    fn say(&self, what: &str, times: &[(Took, Took)]) {
        let rate = |took: f64| match self.size {
            1024 => self.count as f64 / took / 1e6,
            _ => (self.count * self.size) as f64 / took / 1e6,
        };
        let unit = if self.size == 1024 { "M msg/s" } else { "MB/s" };
        let (_, ours, _) = median(times.iter().map(|(ours, _)| rate(ours.clock)).collect());
        let (_, theirs, _) = median(times.iter().map(|(_, theirs)| rate(theirs.clock)).collect());
        let (least, ratio, most) = median(times.iter().map(|(a, b)| b.clock / a.clock).collect());
        let tick = 0.01;
        let load = |took: &Took| took.processors.max(tick);
        let (_, cost, _) = median(times.iter().map(|(a, b)| load(b) / load(a)).collect());
        let compression = match self.compression {
            Compression::None => "none",
            other => other.name(),
        };
        println!(
            "{:>4} {compression:>4} {what:>5}: {ours:.2} {unit}, mcap {theirs:.2}; \
             {ratio:.2} times ({least:.2}..{most:.2}), {cost:.2} by processor time",
            self.name
        );
    }

    fn write(&self, memory: Vec<u8>) -> Vec<u8> {
        let options = WriterOptions::with_compression(self.compression);
        let mut writer = McapWriter::with_buffer(options, memory);
        let id = writer.add_connection(&Connection {
            topic: "/chatter".to_owned(),
            datatype: "std_msgs/String".to_owned(),
            definition: "string data\n".into(),
            ..Connection::default()
        });
        for number in 0..self.count {
            writer.write(id, START + number as u64 * STEP, self.message(number)).unwrap();
        }
        writer.finish().unwrap()
    }

    fn write_by_crate(&self, memory: Vec<u8>) -> Vec<u8> {
        let options = mcap::WriteOptions::new().compression(match self.compression {
            Compression::None => None,
            Compression::Lz4 => Some(mcap::Compression::Lz4),
            Compression::Zstd => Some(mcap::Compression::Zstd),
        });
        // The levels that ours has: LZ4's fast one, and Zstandard's first.
        let level = if self.compression == Compression::Zstd { 1 } else { 0 };
        let options = options.compression_level(level);
        let mut writer = options.create(Cursor::new(memory)).unwrap();
        let schema = writer.add_schema("std_msgs/String", "ros1msg", b"string data\n").unwrap();
        let channel_id = writer.add_channel(schema, "/chatter", "ros1", &BTreeMap::new()).unwrap();
        for number in 0..self.count {
            let time = START + number as u64 * STEP;
            let (log_time, publish_time, sequence) = (time, time, 0);
            let head =
                mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
            writer.write_to_known_channel(&head, self.message(number)).unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    }

    fn read(&self, file: Vec<u8>) -> Mcap {
        let recording = Mcap::open(file).unwrap();
        let timeline = recording.timeline(|_| true).unwrap();
        let messages = (0..timeline.len()).filter_map(|at| timeline.get(at));
        black_box(messages.map(|each| each.time + u64::from(each.data[0])).sum::<u64>());
        assert_eq!(timeline.len(), self.count);
        drop(timeline);
        recording
    }

    fn pass(&self, file: Vec<u8>) -> Mcap {
        let recording = Mcap::open(file).unwrap();
        let (mut sum, mut count) = (0, 0);
        let take = |each: bagpipe_mcap::Message<'_>| {
            sum += each.time + u64::from(each.data[0]);
            count += 1;
        };
        recording.pass(|_| true, take).unwrap();
        black_box(sum);
        assert_eq!(count, self.count);
        recording
    }

    fn read_by_crate(&self, file: &[u8]) {
        let (mut sum, mut count) = (0, 0);
        for message in mcap::MessageStream::new(file).unwrap() {
            let message = message.unwrap();
            sum += message.log_time + u64::from(message.data[0]);
            count += 1;
        }
        black_box(sum);
        assert_eq!(count, self.count);
    }
}
