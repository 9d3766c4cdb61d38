//! Damages MCAP files at random and reads them: nothing may panic, hang, or take more memory
//! than the stated bound. `cargo run --release -p bagpipe-mcap --example damage -- 1000000`
//! prints the figures; a second argument is the seed.
//!
//! The bound, per damaged file: the caller's limit of uncompressed bytes twice (a chunk and its
//! doubling buffer), 16 bytes for each of the input's (places, channels), and [`CONSTANT`] bytes
//! (the decompressors' own tables and the first buffer of a chunk).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use bagpipe_mcap::{
    Attachment, Compression, Connection, Limits, Mcap, McapWriter, Metadata, WriterOptions, rewrite,
};

const TIMES_INPUT: usize = 16;
const CONSTANT: usize = 4 << 20;
/// What a caller allows to be uncompressed, as a multiple of the input.
const LIMIT: usize = 16;
const SLOWEST: Duration = Duration::from_secs(2);
const WAYS: [&str; 3] = ["by time", "pass", "rewrite"];

/// Counts what is allocated and the most that was.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static MOST: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged; only sizes are counted.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        MOST.fetch_max(held, Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: the caller's promise is passed on.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// xorshift: the same damages for the same seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }
}

fn sample(compression: Compression, messages: u64) -> Vec<u8> {
    let options =
        WriterOptions { chunk_threshold: 1500, ..WriterOptions::with_compression(compression) };
    let mut writer = McapWriter::new(options);
    let ids = ["/a", "/map"].map(|topic| {
        writer.add_connection(&Connection {
            topic: topic.to_owned(),
            datatype: "std_msgs/String".to_owned(),
            definition: "string data\n".into(),
            ..Connection::default()
        })
    });
    let entries = [("robot".to_owned(), "r2".to_owned())].into();
    writer.describe(&Metadata { name: "about".to_owned(), entries }).unwrap();
    let (log_time, create_time, name, media_type) = (1, 2, "notes", "text/plain");
    let data = b"hello";
    writer.attach(&Attachment { log_time, create_time, name, media_type, data }).unwrap();
    for number in 0..messages {
        let data: Vec<u8> = (0..50 + number).map(|byte| (byte * 31 + number * 7) as u8).collect();
        writer.write(ids[number as usize % 2], number * 1_000_000, &data).unwrap();
    }
    writer.finish().unwrap()
}

/// The records of a chunk outside of it, as a recorder in a hurry writes them.
fn unchunked(plain: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut at = 8;
    bytes.extend_from_slice(&plain[..8]);
    while let Some(head) = plain.get(at..at + 9) {
        let length = u64::from_le_bytes(head[1..].try_into().unwrap()) as usize;
        let record = &plain[at..at + 9 + length];
        match head[0] {
            6 => bytes.extend_from_slice(&record[49..]),
            7 => {}
            15 => break,
            _ => bytes.extend_from_slice(record),
        }
        at += record.len();
    }
    bytes.extend([&[15, 4][..], &[0; 11], &[2, 20], &[0; 27], &plain[..8]].concat());
    bytes
}

/// One to four damages: bytes, lengths, cuts, repeats, holes.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(8) {
            0..=2 => bytes[at] = random.next() as u8,
            3 | 4 => {
                let values = [0, 1, u64::MAX, 1 << 31, 1 << 63, bytes.len() as u64, random.next()];
                let value = values[random.below(values.len())].to_le_bytes();
                let room = (bytes.len() - at).min([2, 4, 8][random.below(3)]);
                bytes[at..at + room].copy_from_slice(&value[..room]);
            }
            5 => bytes[at] ^= 1 << random.below(8),
            6 => {
                let end = (at + random.below(400)).min(bytes.len());
                let part = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, part);
            }
            _ if random.below(3) == 0 => bytes.truncate(at.max(1)),
            _ => drop(bytes.drain(at..(at + random.below(50)).min(bytes.len() - 1).max(at))),
        }
    }
}

/// Reads the file in one of three ways; how many messages came out.
fn read(bytes: Vec<u8>, way: usize) -> u64 {
    let limits = Limits { decompressed_bytes: (bytes.len() * LIMIT) as u64 };
    let Ok(recording) = Mcap::open_limited(bytes, limits) else { return 0 };
    recording.attachments().for_each(drop);
    match way {
        0 => recording.timeline(|_| true).map_or(0, |timeline| {
            let messages = (0..timeline.len()).filter_map(|at| timeline.get(at));
            messages.filter(|each| each.frame.len() == each.data.len() + 4).count() as u64
        }),
        1 => {
            let mut count = 0;
            let _ = recording.pass(|_| true, |each| count += u64::from(!each.frame.is_empty()));
            count
        }
        _ => rewrite(&recording, WriterOptions::default())
            .map_or(0, |bytes| Mcap::open(bytes).unwrap().message_count()),
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1).map(|word| word.parse::<u64>().unwrap());
    let rounds = arguments.next().unwrap_or(100_000);
    let mut random = Random(arguments.next().unwrap_or(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let plain = sample(Compression::None, 60);
    let samples =
        [unchunked(&plain), plain, sample(Compression::Lz4, 60), sample(Compression::Zstd, 60)];
    assert!(samples.iter().all(|each| read(each.clone(), 0) == 60));
    let (mut slowest, mut most) = ([Duration::ZERO; WAYS.len()], [(0, 0); WAYS.len()]);
    let (mut counts, mut kept) = ([0u64; 4], 0);
    let start = Instant::now();
    for _ in 0..rounds {
        let (kind, way) = (random.below(4), random.below(WAYS.len()));
        counts[kind] += 1;
        let mut bytes = samples[kind].clone();
        damage(&mut bytes, &mut random);
        let length = bytes.len();
        let held = HELD.load(Ordering::Relaxed);
        MOST.store(held, Ordering::Relaxed);
        let began = Instant::now();
        kept += read(bytes, way);
        slowest[way] = slowest[way].max(began.elapsed());
        let taken = MOST.load(Ordering::Relaxed).saturating_sub(held);
        let bound = length * (TIMES_INPUT + 2 * LIMIT) + CONSTANT;
        assert!(taken <= bound, "{taken} bytes for an input of {length}, {}", WAYS[way]);
        most[way] = most[way].max((taken, length));
    }
    let took = start.elapsed();
    println!("{rounds} damaged files ({counts:?} of unchunked, none, lz4, zstd) in {took:?}");
    println!("no panic; {kept} messages kept");
    for (way, name) in WAYS.iter().enumerate() {
        let (slowest, (taken, length)) = (slowest[way], most[way]);
        assert!(slowest < SLOWEST, "one damage took {slowest:?}");
        println!("{name}: slowest {slowest:?}, most {taken} bytes beside an input of {length}");
    }
    println!("bound: {} x input + {CONSTANT} bytes", TIMES_INPUT + 2 * LIMIT);
}
