//! Times the bag's hot paths beside plain copies, one run of each, as JSON lines:
//! `{"case", "metric", "unit", "by", "value"}`. `tests/bench/run.py bag` runs it in turn
//! with the peers; alone: `cargo run --release -p bagpipe-rosbag --example bench -- [case...]`.
//! `payload FILE` and `shapes FOLDER` make what all programs read, `again LIST` reads bags.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout)]

mod shapes;

use std::hint::black_box;
use std::time::Instant;

use bagpipe_rosbag::{
    Bag, BagWriter, Compression, Connection, DiskChunkedFile, MemoryChunkedFile, WriterOptions,
};

const START: u64 = 1_700_000_000_000_000_000;
const STEP: u64 = 1_000_000;
const PAYLOAD: usize = 16 << 20;
/// A MESSAGE record before its data.
const MESSAGE_OFFSET: usize = 46;

/// What is asked for on the command line; nothing is everything.
struct Asked(Vec<String>);

impl Asked {
    fn wants(&self, case: &str) -> bool {
        self.0.is_empty() || self.0.iter().any(|word| case.contains(word.as_str()))
    }
}

fn main() {
    let mut words: Vec<String> = std::env::args().skip(1).collect();
    let scale = match words.iter().position(|word| word == "--scale") {
        Some(at) => words.drain(at..at + 2).nth(1).unwrap().parse().unwrap(),
        None => 1.0,
    };
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        // The same bytes for every program of the comparison.
        ["payload", path] => return std::fs::write(path, payload()).unwrap(),
        ["shapes", folder] => return shapes::make(folder.as_ref(), &payload(), scale),
        ["again", list] => return shapes::again(list.as_ref()),
        _ => {}
    }
    let asked = Asked(words);
    let payload = payload();
    let count = |base: f64| (base * scale).max(1.0) as usize;
    for (name, size, base, compression) in [
        ("1 KB", 1 << 10, 300_000.0, Compression::None),
        ("1 MB", 1 << 20, 400.0, Compression::None),
        ("1 KB lz4", 1 << 10, 200_000.0, Compression::Lz4),
        ("1 MB lz4", 1 << 20, 200.0, Compression::Lz4),
        ("1 KB bz2", 1 << 10, 10_000.0, Compression::Bz2),
    ] {
        if asked.wants(name) {
            Case { name, size, count: count(base), compression, payload: &payload }.measure();
        }
    }
    if asked.wants("memcpy") {
        copies(&payload, count(400.0));
    }
    if asked.wants("mcap") {
        mcap_reference(&payload, count(200_000.0));
    }
    if asked.wants("plan") {
        plan(count(200_000.0));
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

fn message(payload: &[u8], number: usize, size: usize) -> &[u8] {
    &payload[number % (PAYLOAD / size) * size..][..size]
}

fn say(case: &str, metric: &str, unit: &str, by: &str, value: f64) {
    println!(
        "{{\"case\": \"{case}\", \"metric\": \"{metric}\", \"unit\": \"{unit}\", \
         \"by\": \"{by}\", \"value\": {value:.6}}}"
    );
}

fn timed<T>(work: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let made = work();
    (made, start.elapsed().as_secs_f64())
}

fn connection(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        ..Connection::default()
    }
}

/// What is measured of messages of one size.
struct Case<'p> {
    name: &'static str,
    size: usize,
    count: usize,
    compression: Compression,
    payload: &'p [u8],
}

impl Case<'_> {
    /// Small messages by number, large ones by bytes.
    fn say(&self, metric: &str, took: f64) {
        let (unit, amount) = match self.size {
            1024 => ("msg/s", self.count as f64),
            _ => ("MB/s", (self.count * self.size) as f64 / 1e6),
        };
        say(self.name, metric, unit, "bagpipe", amount / took);
    }

    fn write(&self, memory: Vec<u8>) -> Vec<u8> {
        let options = WriterOptions { compression: self.compression, ..WriterOptions::default() };
        let mut writer = BagWriter::with_buffer(options, memory);
        let id = writer.add_connection(&connection("/chatter"));
        for number in 0..self.count {
            let time = START + number as u64 * STEP;
            writer.write(id, time, message(self.payload, number, self.size)).unwrap();
        }
        writer.finish().unwrap()
    }

    /// Writes and reads the messages.
    fn measure(&self) {
        // As much as the agent reserves for a recording: its budget.
        let room = self.count * (self.size + 128) + (1 << 20);
        let (bytes, took) = timed(|| self.write(Vec::with_capacity(room)));
        self.say("write", took);
        if self.compression != Compression::None {
            say(self.name, "size of the bag", "MB", "bagpipe", bytes.len() as f64 / 1e6);
        }
        let memory = self.read(bytes);
        if self.compression == Compression::None {
            let (_, took) = timed(|| self.write(memory));
            self.say("write, memory reused", took);
        }
    }

    /// Reads the bag in each way, and gives its memory back.
    fn read(&self, bytes: Vec<u8>) -> Vec<u8> {
        let (bag, took) = timed(|| {
            let bag = Bag::open(MemoryChunkedFile::new(bytes)).unwrap();
            let (mut sum, mut found) = (0u64, 0);
            for message in bag.messages(|_| true) {
                let message = message.unwrap();
                sum += message.time + u64::from(message.data[0]);
                found += 1;
            }
            black_box(sum);
            assert_eq!(found, self.count);
            bag
        });
        self.say("read", took);
        let bytes = bag.into_file().into_inner();
        let (bag, took) = timed(|| {
            let bag = Bag::open(MemoryChunkedFile::new(bytes)).unwrap();
            let timeline = bag.timeline(|_| true).unwrap();
            let sum: u64 = timeline.iter().map(|each| each.time + u64::from(each.data[0])).sum();
            black_box(sum);
            assert_eq!(timeline.len(), self.count);
            drop(timeline);
            bag
        });
        self.say("read, all ordered first", took);
        let bytes = bag.into_file().into_inner();
        let mut copy = vec![1; self.size];
        let (bag, took) = timed(|| {
            let bag = Bag::open(MemoryChunkedFile::new(bytes)).unwrap();
            for message in bag.messages(|_| true) {
                copy.copy_from_slice(message.unwrap().data);
                black_box(&copy);
            }
            bag
        });
        self.say("read and copy out", took);
        bag.into_file().into_inner()
    }
}

/// The physical limit: the same copies without a format.
fn copies(payload: &[u8], large: usize) {
    for (name, size, count) in [("1 KB", 1 << 10, large * 750), ("1 MB", 1 << 20, large)] {
        let (unit, amount) = match size {
            1024 => ("msg/s", count as f64),
            _ => ("MB/s", (count * size) as f64 / 1e6),
        };
        let (made, took) = timed(|| {
            let mut out = Vec::with_capacity(count * size);
            for number in 0..count {
                out.extend_from_slice(message(payload, number, size));
            }
            out
        });
        say(name, "write", unit, "memcpy", amount / took);
        let mut copy = vec![1; size];
        let ((), took) = timed(|| {
            for each in made.chunks_exact(size) {
                copy.copy_from_slice(each);
                black_box(&copy);
            }
        });
        say(name, "read and copy out", unit, "memcpy", amount / took);
        let (made, took) = timed(|| {
            let mut out = made;
            out.clear();
            for number in 0..count {
                out.extend_from_slice(message(payload, number, size));
            }
            out
        });
        say(name, "write, memory reused", unit, "memcpy", amount / took);
        // A record's header shifts what follows: the same copies, from where a bag's lie.
        let ((), took) = timed(|| {
            for each in made[MESSAGE_OFFSET..].chunks_exact(size) {
                copy.copy_from_slice(each);
                black_box(&copy);
            }
        });
        say(name, "read and copy out", unit, "memcpy, unaligned", amount / took);
    }
}

/// MCAP of the same messages, for reference: another format, with the same aim.
fn mcap_reference(payload: &[u8], count: usize) {
    let (bytes, took) = timed(|| {
        let options = mcap::WriteOptions::new().compression(None).calculate_chunk_crcs(false);
        let mut writer = options.create(std::io::Cursor::new(Vec::new())).unwrap();
        let schema = writer.add_schema("std_msgs/String", "ros1msg", b"string data\n").unwrap();
        let map = std::collections::BTreeMap::new();
        let channel = writer.add_channel(schema, "/chatter", "ros1", &map).unwrap();
        for number in 0..count {
            let time = START + number as u64 * STEP;
            let (sequence, log_time, publish_time) = (number as u32, time, time);
            let header = mcap::records::MessageHeader {
                channel_id: channel,
                sequence,
                log_time,
                publish_time,
            };
            writer.write_to_known_channel(&header, message(payload, number, 1024)).unwrap();
        }
        writer.finish().unwrap();
        writer.into_inner().into_inner()
    });
    say("1 KB", "write", "msg/s", "mcap (Rust)", count as f64 / took);
    let ((), took) = timed(|| {
        let mut sum = 0u64;
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            sum += message.log_time + u64::from(message.data[0]);
        }
        black_box(sum);
    });
    say("1 KB", "read", "msg/s", "mcap (Rust)", count as f64 / took);
}

/// A line of /proc/self/status, in bytes.
fn status(name: &str) -> f64 {
    let text = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = text.lines().find(|line| line.starts_with(name)).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<f64>().unwrap() * 1024.0
}

/// Opens a bag of very many small chunks by its index, cuts it, and orders its messages.
fn plan(chunks: usize) {
    let name = format!("plan {chunks} chunks, {} messages", chunks * 25);
    let mut writer =
        BagWriter::new(WriterOptions { chunk_threshold: 1500, ..WriterOptions::default() });
    let ids: Vec<u32> =
        (0..10).map(|each| writer.add_connection(&connection(&format!("/t{each}")))).collect();
    for number in 0..chunks * 25 {
        writer.write(ids[number % 10], START + number as u64 * STEP, &[7; 16]).unwrap();
    }
    let bytes = writer.finish().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("plan.bag");
    std::fs::write(&path, &bytes).unwrap();
    let before = status("VmRSS");
    let ((bag, fragments), took) = timed(|| {
        let bag = Bag::open(MemoryChunkedFile::new(bytes)).unwrap();
        let fragments = cut(bag.chunks());
        (bag, fragments)
    });
    assert!(bag.loss().is_none() && fragments > 1);
    say(&name, "open and cut, from memory", "s", "bagpipe", took);
    let (messages, took) = timed(|| bag.timeline(|_| true).unwrap().len());
    assert!(messages == bag.message_count() as usize && messages >= chunks * 24);
    say(&name, "order all messages", "s", "bagpipe", took);
    say(&name, "memory beside the bag", "MB", "bagpipe", (status("VmHWM") - before) / 1e6);
    drop(bag);
    let (fragments, took) = timed(|| {
        let bag = Bag::open(DiskChunkedFile::open(&path).unwrap()).unwrap();
        cut(bag.chunks())
    });
    assert!(fragments > 1);
    say(&name, "open and cut, from disk (hot)", "s", "bagpipe", took);
}

/// How many fragments of 20 s the chunks make.
fn cut(chunks: &[bagpipe_rosbag::ChunkInfo]) -> usize {
    let mut fragments = 0;
    let mut end = 0;
    for chunk in chunks {
        if chunk.start >= end {
            fragments += 1;
            end = chunk.start + 20_000_000_000;
        }
    }
    fragments
}
