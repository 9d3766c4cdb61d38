//! Bags of the shapes of real recordings, and what reading and writing any bag again takes.
//!
//! The shapes (docs/performance.md says where they come from), each by what comes in a second:
//! KITTI: 14 topics at 10 Hz, 56 MB; Udacity: 1,645 messages and 51 MB, each image a chunk;
//! Autoware on a campus: 1,865 messages, of which 63 % are /tf, and 122 MB, LZ4.

use std::path::Path;

use bagpipe_rosbag::{Bag, BagWriter, Compression, MemoryChunkedFile, WriterOptions};
use std::hint::black_box;

use crate::{PAYLOAD, START, connection, say, timed};

/// Messages of one length that come at one rate, on so many topics.
struct Stream {
    name: &'static str,
    topics: usize,
    /// On each of them.
    per_second: f64,
    bytes: usize,
}

const fn stream(name: &'static str, topics: usize, per_second: f64, bytes: usize) -> Stream {
    Stream { name, topics, per_second, bytes }
}

struct Shape {
    file: &'static str,
    compression: Compression,
    seconds: f64,
    streams: &'static [Stream],
}

const SHAPES: [Shape; 3] = [
    Shape {
        file: "kitti",
        compression: Compression::None,
        seconds: 3.0,
        streams: &[
            stream("colour", 2, 10.0, 1_400_000),
            stream("grey", 2, 10.0, 466_000),
            stream("velodyne", 1, 10.0, 1_950_000),
            stream("small", 9, 10.0, 400),
        ],
    },
    Shape {
        file: "udacity",
        compression: Compression::None,
        seconds: 3.0,
        streams: &[stream("camera", 3, 20.0, 820_000), stream("small", 15, 105.7, 1_200)],
    },
    Shape {
        file: "autoware",
        compression: Compression::Lz4,
        seconds: 1.5,
        streams: &[
            stream("tf", 1, 1_175.0, 160),
            stream("image", 1, 30.0, 2_700_000),
            stream("points", 1, 10.0, 3_600_000),
            stream("other", 13, 50.0, 7_000),
        ],
    },
];

/// Writes the bags of all shapes into a folder.
pub fn make(folder: &Path, payload: &[u8], scale: f64) {
    for shape in &SHAPES {
        let options = WriterOptions { compression: shape.compression, ..WriterOptions::default() };
        let mut writer = BagWriter::new(options);
        let mut due = Vec::new();
        for stream in shape.streams {
            for topic in 0..stream.topics {
                let id = writer.add_connection(&connection(&format!("/{}{topic}", stream.name)));
                let count = (stream.per_second * shape.seconds * scale).max(1.0) as usize;
                due.extend((0..count).map(|number| {
                    let time = (number as f64 * 1e9 / stream.per_second) as u64;
                    (time + u64::from(id), id, stream.bytes)
                }));
            }
        }
        due.sort_unstable();
        for (number, (time, id, bytes)) in due.into_iter().enumerate() {
            let from = number * 4099 % (PAYLOAD - bytes);
            writer.write(id, START + time, &payload[from..from + bytes]).unwrap();
        }
        std::fs::write(folder.join(format!("{}.bag", shape.file)), writer.finish().unwrap())
            .unwrap();
    }
}

/// Reads and writes each bag of a list: lines of a case's name, a tab, and the bag's path.
pub fn again(list: &Path) {
    for line in std::fs::read_to_string(list).unwrap().lines() {
        let (name, path) = line.split_once('\t').unwrap();
        copy(name, std::fs::read(path).unwrap());
    }
}

/// Bags are read, and written, so often that it is at least this many bytes: some are tiny.
const LEAST: usize = 32 << 20;
const MOST_TIMES: usize = 20;

fn copy(name: &str, file: Vec<u8>) {
    let bag = Bag::open(MemoryChunkedFile::new(file)).unwrap();
    let compression = bag.chunks().first().map_or(Compression::None, |chunk| chunk.compression);
    let bytes: usize = bag.messages(|_| true).map(|each| each.unwrap().data.len()).sum();
    let times = (LEAST / bytes.max(1)).clamp(1, MOST_TIMES);
    let amount = (bytes * times) as f64 / 1e6;
    let file = bag.into_file();
    let mut longest = Vec::new();
    let (_, took) = timed(|| {
        for _ in 0..times {
            for message in Bag::open(&file).unwrap().messages(|_| true) {
                longest.clear();
                longest.extend_from_slice(message.unwrap().data);
                black_box(&longest);
            }
        }
    });
    say(name, "read and copy out", "MB/s", "bagpipe", amount / took);
    let bag = Bag::open(&file).unwrap();
    let messages: Vec<_> = bag.messages(|_| true).map(Result::unwrap).collect();
    let (length, took) = timed(|| {
        let mut length = 0;
        for _ in 0..times {
            let options = WriterOptions { compression, ..WriterOptions::default() };
            // As much as the agent reserves for a recording: its budget.
            let memory = Vec::with_capacity(bytes + bytes / 8 + (1 << 20));
            let mut writer = BagWriter::with_buffer(options, memory);
            let known = bag.connections().iter().map(|each| (each.id, writer.add_connection(each)));
            let ids: std::collections::HashMap<u32, u32> = known.collect();
            for message in &messages {
                writer.write(ids[&message.connection], message.time, message.data).unwrap();
            }
            length = writer.finish().unwrap().len();
        }
        length
    });
    say(name, "write", "MB/s", "bagpipe", amount / took);
    say(name, "size of the bag", "MB", "bagpipe", length as f64 / 1e6);
}
