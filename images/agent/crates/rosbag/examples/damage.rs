//! Damages bags of both formats at random and reads them in every way: nothing may panic, hang, or take more
//! memory than the stated bound. `cargo run --release -p bagpipe-rosbag --example damage -- 1000000`
//! prints the figures; a second argument is the seed.
//!
//! The bound, per damaged bag and for each way of reading: the caller's limit of uncompressed
//! bytes three times (a chunk, its doubling buffer, its copy in a new bag), the input's size
//! [`TIMES_INPUT`] times (entries of the timeline, connections, the new bag), and
//! [`CONSTANT`] bytes (bzip2's and LZ4's own tables and the first buffer of a chunk).
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::print_stdout, unsafe_code)]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use bagpipe_rosbag::{
    Bag, BagWriter, Compression, Connection, Limits, MemoryChunkedFile, Window, WriterOptions,
    check_limited, reindex_limited, slice,
};

const TIMES_INPUT: usize = 16;
const CONSTANT: usize = 8 << 20;
/// What a caller allows to be uncompressed, as a multiple of the input.
const LIMIT: usize = 16;
const SLOWEST: Duration = Duration::from_secs(2);
const WAYS: [&str; 5] = ["by index", "from the front", "slice", "check", "reindex"];

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
    let options = WriterOptions { compression, chunk_threshold: 1500, byte_budget: None };
    let mut writer = BagWriter::new(options);
    for (topic, latching) in [("/a", false), ("/map", true)] {
        writer.add_connection(&Connection {
            topic: topic.to_owned(),
            datatype: "std_msgs/String".to_owned(),
            md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".into(),
            latching,
            ..Connection::default()
        });
    }
    for number in 0..messages {
        let data: Vec<u8> = (0..50 + number).map(|byte| (byte * 31 + number * 7) as u8).collect();
        writer.write((number % 2) as u32, number * 1_000_000, &data).unwrap();
    }
    writer.finish().unwrap()
}

fn record(fields: &[(&str, &[u8])], data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend_from_slice(&((name.len() + 1 + value.len()) as u32).to_le_bytes());
        header.extend_from_slice(&[name.as_bytes(), b"=", value].concat());
    }
    let length = (header.len() as u32).to_le_bytes();
    [&length[..], &header, &(data.len() as u32).to_le_bytes(), data].concat()
}

/// A bag of format 1.2, two publishers to each of two topics.
fn old_sample(messages: u32) -> Vec<u8> {
    let mut bytes = b"#ROSBAG V1.2\n".to_vec();
    bytes.extend(record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 100]));
    let datatype: (&str, &[u8]) = ("type", b"std_msgs/String");
    let md5: (&str, &[u8]) = ("md5", b"992ce8a1687cec8c8bd883ec73ca41d1");
    let topics: [(&str, &[u8]); 2] = [("topic", b"/a"), ("topic", b"/map")];
    for topic in topics {
        let definition = ("def", &b"string data\n"[..]);
        bytes.extend(record(&[("op", &[1]), topic, datatype, md5, definition], &[]));
    }
    for number in 0..messages {
        let topic = topics[number as usize % 2];
        let (sec, nsec) = (number.to_le_bytes(), 500u32.to_le_bytes());
        let caller: [(&str, &[u8]); 2] = [("callerid", b"/left"), ("callerid", b"/right")];
        let caller = caller[number as usize / 2 % 2];
        let latching = ("latching", if number % 2 == 1 { &b"1"[..] } else { b"0" });
        let (sec, nsec) = (("sec", &sec[..]), ("nsec", &nsec[..]));
        let fields = [("op", &[2][..]), topic, datatype, md5, sec, nsec, caller, latching];
        bytes.extend(record(&fields, &vec![number as u8; 50 + number as usize]));
    }
    bytes
}

/// One to four damages: bytes, lengths, cuts, repeats, holes.
fn damage(bytes: &mut Vec<u8>, random: &mut Random) {
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(8) {
            0..=2 => bytes[at] = random.next() as u8,
            3 | 4 => {
                let values = [0, 1, u32::MAX, 1 << 31, bytes.len() as u32, random.next() as u32];
                let value = values[random.below(values.len())].to_le_bytes();
                let room = (bytes.len() - at).min(4);
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

/// Reads the bag in one of five ways; how many messages came out.
fn read(bytes: Vec<u8>, way: usize) -> u64 {
    let limits = Limits { decompressed_bytes: (bytes.len() * LIMIT) as u64 };
    let file = MemoryChunkedFile::new(bytes);
    let count = |bag: Bag<MemoryChunkedFile>| {
        bag.timeline(|_| true).map_or(0, |timeline| {
            timeline.iter().filter(|each| each.frame.len() == each.data.len() + 4).count() as u64
        })
    };
    match way {
        0 => Bag::open_limited(file, limits).map_or(0, count),
        1 => Bag::open_unindexed_limited(file, limits).map_or(0, count),
        2 => {
            let Ok(bag) = Bag::open_limited(file, limits) else { return 0 };
            let window = Window { start: 5_000_000, end: 30_000_000 };
            let options = WriterOptions::default();
            slice(&bag, window, |_| true, options).map_or(0, |made| made.messages)
        }
        3 => check_limited(&file, limits).map_or(0, |checked| checked.messages),
        _ => {
            reindex_limited(file, WriterOptions::default(), limits).map_or(0, |made| made.messages)
        }
    }
}

fn main() {
    let mut arguments = std::env::args().skip(1).map(|word| word.parse::<u64>().unwrap());
    let rounds = arguments.next().unwrap_or(100_000);
    let mut random = Random(arguments.next().unwrap_or(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
    let samples = [
        sample(Compression::None, 60),
        sample(Compression::Lz4, 60),
        sample(Compression::Bz2, 12),
        old_sample(60),
    ];
    let mut slowest = [Duration::ZERO; WAYS.len()];
    let mut most = [(0, 0); WAYS.len()];
    let (mut counts, mut kept) = ([0u64; 4], 0);
    let start = Instant::now();
    for _ in 0..rounds {
        // bzip2's tables cost a thousand times what the reading does.
        let kind = match random.below(100) {
            0..40 => 0,
            40..70 => 1,
            70..72 => 2,
            _ => 3,
        };
        counts[kind] += 1;
        let mut bytes = samples[kind].clone();
        damage(&mut bytes, &mut random);
        let (length, way) = (bytes.len(), random.below(WAYS.len()));
        let held = HELD.load(Ordering::Relaxed);
        MOST.store(held, Ordering::Relaxed);
        let began = Instant::now();
        kept += read(bytes, way);
        slowest[way] = slowest[way].max(began.elapsed());
        let taken = MOST.load(Ordering::Relaxed).saturating_sub(held);
        let bound = length * (TIMES_INPUT + 3 * LIMIT) + CONSTANT;
        assert!(taken <= bound, "{taken} bytes for an input of {length}, {}", WAYS[way]);
        most[way] = most[way].max((taken, length));
    }
    println!("{rounds} damaged bags ({counts:?} of none, lz4, bz2, 1.2) in {:?}", start.elapsed());
    println!("no panic; {kept} messages kept");
    for (way, name) in WAYS.iter().enumerate() {
        let (slowest, (taken, length)) = (slowest[way], most[way]);
        assert!(slowest < SLOWEST, "one damage took {slowest:?}");
        println!("{name}: slowest {slowest:?}, most {taken} bytes beside an input of {length}");
    }
    println!("bound: {} x input + {CONSTANT} bytes", TIMES_INPUT + 3 * LIMIT);
}
