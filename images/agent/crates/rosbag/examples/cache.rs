//! The two layers of the bag with and without the cache, one run each, as a figure on stdout:
//! seconds. `make bench BENCH=cache` runs it; alone:
//! `cargo run --release -p bagpipe-rosbag --example cache -- VERB FILE BYTES MESSAGES`.
//! `keep` writes messages into a bag in memory, `reuse` into the memory of an earlier one, and
//! `spill` into FILE, which `force` also waits
//! for to be on the disk; `recall` reads and copies out the messages of FILE, which it read into
//! memory before, and `read` does so from the file.
#![allow(clippy::unwrap_used, clippy::print_stdout)]

use std::fs::File;
use std::hint::black_box;
use std::path::Path;
use std::time::{Duration, Instant};

use bagpipe_rosbag::{
    Bag, BagWriter, ChunkedFile, Connection, DiskChunkedFile, MemoryChunkedFile, WriterOptions,
};

const PAYLOAD: usize = 16 << 20;
/// Room for a message's records beside its data.
const BESIDE: usize = 128;

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [verb, path, size, count] = &words[..] else { panic!("VERB FILE BYTES MESSAGES") };
    let (path, size, count) = (Path::new(path), size.parse().unwrap(), count.parse().unwrap());
    let payload = payload();
    let begun = Instant::now();
    let seconds = match verb.as_str() {
        "keep" => {
            let memory = Vec::with_capacity(count * (size + BESIDE) + (1 << 20));
            kept(memory, &payload, size, count).1
        }
        "reuse" => {
            let memory = Vec::with_capacity(count * (size + BESIDE) + (1 << 20));
            let (bag, _) = kept(memory, &payload, size, count);
            kept(bag, &payload, size, count).1
        }
        "spill" | "force" => {
            let mut file = File::create(path).unwrap();
            let writer = BagWriter::new(WriterOptions::default());
            let spill = |writer: &mut BagWriter| writer.spill(&mut file).unwrap();
            let writer = written(writer, &payload, size, count, spill);
            writer.finish_spilled(&mut file).unwrap();
            if verb == "force" {
                file.sync_data().unwrap();
            }
            begun.elapsed()
        }
        "recall" => {
            let bytes = std::fs::read(path).unwrap();
            let begun = Instant::now();
            copy_out(MemoryChunkedFile::new(bytes), size, count);
            begun.elapsed()
        }
        "read" => {
            copy_out(DiskChunkedFile::open(path).unwrap(), size, count);
            begun.elapsed()
        }
        other => panic!("{other:?} is no verb"),
    };
    println!("{:.9}", seconds.as_secs_f64());
}

fn kept(memory: Vec<u8>, payload: &[u8], size: usize, count: usize) -> (Vec<u8>, Duration) {
    let begun = Instant::now();
    let writer = BagWriter::with_buffer(WriterOptions::default(), memory);
    let bag = written(writer, payload, size, count, |_| ()).finish().unwrap();
    (bag, begun.elapsed())
}

fn written(
    mut writer: BagWriter,
    payload: &[u8],
    size: usize,
    count: usize,
    mut after_each: impl FnMut(&mut BagWriter),
) -> BagWriter {
    let id = writer.add_connection(&Connection {
        topic: "/data".to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        ..Connection::default()
    });
    // A std_msgs/String: its length, then its text.
    let mut data = vec![0; size];
    data[..4].copy_from_slice(&(size as u32 - 4).to_le_bytes());
    for number in 0..count {
        let place = number % (PAYLOAD / size) * size;
        data[4..].copy_from_slice(&payload[place + 4..place + size]);
        writer.write(id, 1_000_000_000 + number as u64 * 100_000, &data).unwrap();
        after_each(&mut writer);
    }
    writer
}

fn copy_out(file: impl ChunkedFile, size: usize, count: usize) {
    let bag = Bag::open(file).unwrap();
    let mut copy = vec![1; size];
    let mut found = 0;
    for message in bag.messages(|_| true) {
        copy.copy_from_slice(message.unwrap().data);
        black_box(&copy);
        found += 1;
    }
    assert_eq!(found, count);
}

/// Bytes that LZ4 compresses to about 55 %, as it does a real AV bag's.
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
