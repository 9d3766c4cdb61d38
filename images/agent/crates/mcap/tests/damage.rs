//! Damaged input: never a panic, never a loss of what lies before the damage.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use bagpipe_mcap::{
    Compression, Limits, Loss, Mcap, McapError, McapWriter, WriterOptions, rewrite,
};
use sample::{ALL, Form, Plain, connection, messages, read, sample, theirs};

const LIMITS: Limits = Limits { decompressed_bytes: 1 << 20 };

fn open(bytes: &[u8]) -> Mcap {
    Mcap::open(bytes.to_vec()).unwrap()
}

fn loss(bytes: &[u8]) -> Loss {
    open(bytes).loss().unwrap().clone()
}

fn plain(compression: Compression, chunked: bool) -> Vec<u8> {
    theirs(Form { compression, chunked, summary: true, index: true, crc: true })
}

/// Bytes from `at` on, in place of those that are there.
fn with(bytes: &[u8], at: usize, new: &[u8]) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    bytes[at..at + new.len()].copy_from_slice(new);
    bytes
}

fn record(op: u8, content: &[u8]) -> Vec<u8> {
    [&[op][..], &(content.len() as u64).to_le_bytes(), content].concat()
}

/// A file of these records, without a summary or checksums.
fn file(records: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    bytes.extend(record(1, &[0; 8]));
    bytes.extend(records.concat());
    bytes.extend([record(15, &[0; 4]), record(2, &[0; 20])].concat());
    bytes.extend(b"\x89MCAP0\r\n");
    bytes
}

/// The first record behind the header.
const FIRST: usize = 8 + 17;

fn a_channel(id: u8, schema: u8) -> Vec<u8> {
    record(
        4,
        &[&[id, 0, schema, 0, 2, 0, 0, 0][..], b"/a", &[3, 0, 0, 0], b"cdr", &[0; 4]].concat(),
    )
}

fn a_schema(id: u8, name: u8) -> Vec<u8> {
    record(3, &[&[id, 0, 1, 0, 0, 0, name][..], &[0; 8]].concat())
}

fn a_message(channel: u8) -> Vec<u8> {
    record(5, &[&[channel, 0][..], &[7; 20], b"data"].concat())
}

fn a_chunk(compression: &str, size: u64, records: &[u8]) -> Vec<u8> {
    let mut content = [0; 16].to_vec();
    content.extend(size.to_le_bytes());
    content.extend([0; 4]);
    content.extend((compression.len() as u32).to_le_bytes());
    content.extend(compression.as_bytes());
    content.extend((records.len() as u64).to_le_bytes());
    content.extend(records);
    record(6, &content)
}

#[test]
fn a_file_cut_anywhere_keeps_every_whole_message_and_says_where_it_was_cut() {
    for bytes in ALL.map(sample).into_iter().chain([plain(Compression::None, false)]) {
        let whole = open(&bytes);
        let mut all: Vec<Plain> = (0..100).map(sample::message).collect();
        assert!(read(&whole) == messages());
        let mut before = 0;
        for cut in 0..bytes.len() {
            let recording = match Mcap::open(bytes[..cut].to_vec()) {
                Ok(recording) => recording,
                Err(error) => {
                    assert!(cut < 60, "cut at {cut}: {error}");
                    continue;
                }
            };
            let loss = recording.loss().unwrap();
            assert!(loss.offset <= cut as u64 && !loss.description.is_empty(), "{cut}: {loss:?}");
            let kept = read(&recording);
            assert!(kept.len() >= before, "cut at {cut}: {} < {before}", kept.len());
            before = kept.len();
            let mut expected = all[..kept.len()].to_vec();
            expected.sort_by_key(|(_, time, ..)| *time);
            assert!(kept == expected, "cut at {cut}");
        }
        // What follows the messages can be cut without a loss of one.
        assert_eq!(before, 100);
        all.clear();
    }
}

#[test]
fn an_uncompressed_chunk_that_is_cut_keeps_its_first_messages() {
    let bytes = plain(Compression::None, true);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let chunk = &summary.chunk_indexes[2];
    let kept = |cut: u64| open(&bytes[..cut as usize]).message_count();
    let (start, end) = (chunk.chunk_start_offset, chunk.chunk_start_offset + chunk.chunk_length);
    let (least, most) = (kept(start), kept(end));
    let middle = kept(start + chunk.chunk_length / 2);
    assert!(least < middle && middle < most, "{least} {middle} {most}");
}

/// How many messages the indexes behind a chunk name.
fn counts(bytes: &[u8], chunk: usize) -> usize {
    let length = |at: usize| u64::from_le_bytes(*bytes[at + 1..].first_chunk().unwrap()) as usize;
    let (mut at, mut messages) = (chunk + 9 + length(chunk), 0);
    while bytes[at] == 7 {
        messages += (length(at) - 6) / 16;
        at += 9 + length(at);
    }
    messages
}

#[test]
fn what_is_saved_of_a_chunk_with_a_wrong_checksum_is_none_of_its_messages() {
    for compression in ALL {
        let bytes = plain(compression, true);
        let whole = open(&bytes);
        let chunk = chunks(&bytes).into_iter().find(|at| counts(&bytes, at - 9) > 0).unwrap();
        let damaged = with(&bytes, chunk + 24, &[1, 2, 3, 4]);
        let old = Mcap::open_scanned(damaged, Limits::default()).unwrap();
        let saved = open(&rewrite(&old, WriterOptions::default()).unwrap());
        let lost = counts(&bytes, chunk - 9) as u64;
        assert_eq!(saved.message_count(), whole.message_count() - lost, "{compression:?}");
        assert_eq!((saved.loss(), saved.connections().len()), (None, 2));
    }
}

#[test]
fn a_wrong_checksum_is_reported_with_where_and_what_it_was() {
    let header = FIRST + 8 + 18;
    for chunked in [true, false] {
        let bytes = plain(Compression::None, chunked);
        let data = bytes.windows(4).position(|each| *each == [31, 62, 93, 124]).unwrap();
        let damaged = with(&bytes, data, &[0]);
        let loss = loss(&damaged);
        assert!(loss.description.starts_with("data of the CRC-32 "), "{loss:?}");
        assert!(loss.offset > header as u64);
        let kept = read(&open(&damaged));
        assert!(kept.iter().all(|each| !chunked || messages().contains(each)), "a wrong message");
        // Outside of chunks no one knows which message is wrong.
        assert_eq!(kept.len() < 100, chunked);
    }
    for compression in [Compression::Lz4, Compression::Zstd] {
        // The chunk's own checksum, where its data is whole.
        let bytes = sample(compression);
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let chunk = summary.chunk_indexes[1].chunk_start_offset as usize;
        let crc = chunk + 9 + 24;
        let damaged = with(&bytes, crc, &[1, 2, 3, 4]);
        let loss = loss(&damaged);
        // The whole data section's was the first to be known.
        assert!(loss.description.starts_with("data of the CRC-32 "), "{loss:?}");
        let at = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        let recording = open(&with(&damaged, at + 9, &[0; 4]));
        assert_eq!(recording.loss(), None);
        let error = recording.timeline(|_| true).unwrap_err();
        let data = chunk + 9 + 28 + 4 + compression.name().len() + 8;
        assert_eq!(error.offset(), Some(data as u64), "{error}");
        assert!(error.to_string().contains("data of the CRC-32 04030201, found "), "{error}");
        // No one knows which of its messages are wrong.
        let scanned = Mcap::open_scanned(damaged, Limits::default()).unwrap();
        let of_chunk: usize = counts(&bytes, chunk);
        assert!(of_chunk > 0);
        assert_eq!(read(&scanned).len(), 100 - of_chunk);
        assert!(scanned.loss().unwrap().bytes > 500, "{:?}", scanned.loss());
    }
    let bytes = sample(Compression::None);
    let summary = with(&bytes, bytes.len() - 12, &[1, 2, 3, 4]);
    assert!(loss(&summary).description.starts_with("data of the CRC-32 04030201"));
    let name = bytes.windows(5).position(|each| each == b"focal").unwrap();
    let recording = open(&with(&bytes, name, b"F"));
    assert_eq!(recording.attachments().count(), 0);
    assert_eq!(recording.message_count(), 100);
    let loss = recording.loss().unwrap();
    assert!(loss.offset < name as u64 && loss.offset > name as u64 - 80, "{loss:?}");
}

#[test]
fn records_that_nobody_knows_are_passed_over_in_and_out_of_chunks() {
    let inside =
        [a_channel(1, 0), record(0x90, &[1; 30]), record(0x20, &[]), a_message(1)].concat();
    let chunk = a_chunk("", inside.len() as u64, &inside);
    let records = [record(0xff, b"ours"), chunk, record(0x7f, &[]), a_message(1)];
    let recording = open(&file(&records));
    assert_eq!(recording.loss(), None);
    let found = read(&recording);
    assert_eq!(found.len(), 2);
    assert!(found.iter().all(|(topic, time, .., data)| {
        topic == "/a" && *time == 0x0707_0707_0707_0707 && data == b"data"
    }));
}

#[test]
fn fields_behind_those_that_are_known_are_passed_over() {
    let longer = |mut bytes: Vec<u8>| {
        bytes.extend([9; 7]);
        let length = (bytes.len() as u64 - 9).to_le_bytes();
        with(&bytes, 1, &length)
    };
    let bytes = file(&[longer(a_schema(1, b's')), longer(a_channel(1, 1)), a_message(1)]);
    let recording = open(&bytes);
    assert_eq!((recording.loss(), recording.message_count()), (None, 1));
    assert_eq!(recording.connections()[0].datatype, "s");
}

/// Records, the byte and the sentence of the loss, and how many messages are kept.
type Contradiction = (Vec<Vec<u8>>, usize, &'static str, usize);

fn are_reported(contradictions: Vec<Contradiction>) {
    for (records, offset, expected, kept) in contradictions {
        let recording = open(&file(&records));
        let loss = recording.loss().unwrap();
        let expected = (offset as u64, expected);
        assert_eq!((loss.offset, loss.description.as_str()), expected);
        assert_eq!(read(&recording).len(), kept, "{expected:?}");
    }
}

#[test]
fn declarations_that_are_missing_late_or_contradict_each_other_are_reported() {
    let (channel, message, schema) = (a_channel(1, 0), a_message(1), a_schema(1, b'x'));
    let behind = FIRST + channel.len();
    let unknown = "a message of a declared channel, found 1";
    let other = "a message of a declared channel, found 2";
    let late = "channel 1 declared before its first message";
    let no_schema = "a declared schema of channel 1, found 3";
    let two_channels = "channel 1 as it was declared before";
    let two_schemas = "schema 1 as it was declared before";
    let schemas = vec![schema.clone(), a_schema(1, b'y'), channel.clone(), message.clone()];
    are_reported(vec![
        (vec![message.clone()], FIRST, unknown, 0),
        (vec![message.clone(), channel.clone()], FIRST, late, 1),
        (vec![channel.clone(), a_message(2), message.clone()], behind, other, 1),
        (vec![a_channel(1, 3), message.clone()], FIRST, no_schema, 1),
        (vec![channel, a_channel(1, 1), message], behind, two_channels, 1),
        (schemas, FIRST + schema.len(), two_schemas, 1),
    ]);
}

#[test]
fn records_that_are_too_short_or_out_of_place_are_reported_and_the_rest_is_kept() {
    let (channel, message) = (a_channel(1, 0), a_message(1));
    let behind = FIRST + channel.len();
    let between = |record: Vec<u8>| vec![channel.clone(), record, message.clone()];
    let header = "a record of the data section, found opcode 1";
    let short_schema = vec![record(3, &[]), channel.clone(), message.clone()];
    let metadata = "9 bytes of a metadata record's name, found 0";
    are_reported(vec![
        (between(record(5, &[1, 0])), behind + 1, "a message of at least 22 bytes, found 2", 1),
        (between(record(0, &[])), behind, "a record's opcode, found 0", 0),
        (short_schema, FIRST + 9, "2 bytes of a schema's number, found 0", 1),
        (between(record(1, &[0; 8])), behind, header, 1),
        (between(record(12, &[9, 0, 0, 0])), behind + 13, metadata, 1),
    ]);
}

#[test]
fn chunks_that_nobody_can_read_are_reported_and_the_rest_is_kept() {
    let (channel, message) = (a_channel(1, 0), a_message(1));
    let behind = FIRST + channel.len();
    let between = |record: Vec<u8>| vec![channel.clone(), record, message.clone()];
    let inside = [record(9, &[0; 40]), message.clone()].concat();
    let odd = vec![channel.clone(), a_chunk("", inside.len() as u64, &inside)];
    let in_chunk = "a schema, a channel or a message in a chunk, found opcode 9";
    let compression = "the compression lz4, zstd or none (\"\"), found \"bz2\"";
    let large = "a chunk of less than 4 GiB, found 4294967296";
    let short = "8 bytes of a chunk's last time, found 2";
    let cut = |length: usize| {
        let inside = [&message[..], &message[..length]].concat();
        vec![channel.clone(), a_chunk("", inside.len() as u64, &inside), message.clone()]
    };
    let second = behind + 49 + message.len();
    are_reported(vec![
        (cut(20), second + 1, "26 bytes of a record (opcode 5), found 11", 2),
        (cut(4), second, "a record of at least 9 bytes, found 4", 2),
        (between(a_chunk("bz2", 3, b"abc")), behind + 9 + 28, compression, 1),
        (between(a_chunk("zstd", 1 << 32, b"abc")), behind + 9 + 16, large, 1),
        (odd, behind + 49, in_chunk, 1),
        (between(record(6, &[0; 10])), behind + 9 + 8, short, 1),
    ]);
}

/// Where the contents of the chunks lie.
fn chunks(bytes: &[u8]) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 < bytes.len() {
        if bytes[at] == 6 {
            found.push(at + 9);
        }
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    found
}

#[test]
fn messages_outside_of_the_times_that_their_chunk_states_are_reported() {
    for compression in ALL {
        let form = Form { compression, chunked: true, summary: true, index: true, crc: false };
        let whole = theirs(form);
        let last_of = |at: usize| u64::from_le_bytes(whole[at + 8..at + 16].try_into().unwrap());
        // The first chunk has declarations alone.
        let chunk = chunks(&whole).into_iter().find(|at| last_of(*at) > 0).unwrap();
        let last = last_of(chunk);
        let short = with(&whole, chunk + 8, &(last - 1).to_le_bytes());
        let found = Mcap::open_scanned(short.clone(), Limits::default()).unwrap();
        let loss = found.loss().unwrap().clone();
        assert_eq!((loss.offset, loss.messages), (chunk as u64 - 9, Some(0)));
        assert!(loss.description.contains(&format!("to {} ns in a chunk", last - 1)), "{loss:?}");
        // A writer that states no times is believed.
        let none = with(&whole, chunk, &[0; 16]);
        assert!(Mcap::open_scanned(none, Limits::default()).unwrap().loss().is_none());
    }
}

#[test]
fn the_channels_of_a_type_share_its_definition() {
    let schema = |id: u8| {
        record(3, &[&[id, 0][..], b"\x01\0\0\0X\x07\0\0\0ros2msg\x06\0\0\0int8 x"].concat())
    };
    let records = [vec![schema(1)], (1..=3).map(|id| a_channel(id, 1)).collect()].concat();
    let found = Mcap::open(file(&records)).unwrap();
    let [first, rest @ ..] = found.connections() else { panic!("none") };
    assert_eq!((&*first.definition, rest.len()), ("int8 x", 2));
    let same = |each: &bagpipe_mcap::Connection| {
        std::sync::Arc::ptr_eq(&each.definition, &first.definition)
    };
    assert!(rest.iter().all(same));
}

#[test]
fn what_is_no_mcap_file_is_refused_by_its_first_bytes() {
    for (bytes, expected) in [
        (
            &b"#ROSBAG V2.0\n"[..],
            "byte 0: expected the 8 bytes that MCAP files begin with, found \"#ROSBAG \"",
        ),
        (b"", "byte 0: expected the 8 bytes that MCAP files begin with, found \"\""),
        (b"\x89MCAP0\r\n", "byte 8: expected a record of at least 9 bytes, found 0"),
        (
            b"\x89MCAP0\r\n\x02\0\0\0\0\0\0\0\0",
            "byte 8: expected a Header record (opcode 1), found opcode 2",
        ),
    ] {
        assert_eq!(Mcap::open(bytes.to_vec()).unwrap_err().to_string(), expected);
    }
}

#[test]
fn a_chunk_that_grows_without_end_is_refused_before_it_is_made() {
    for compression in [Compression::Lz4, Compression::Zstd] {
        let mut writer = McapWriter::new(WriterOptions::with_compression(compression));
        let id = writer.add_connection(&connection("/a"));
        writer.write(id, 1, &vec![0; 30 << 20]).unwrap();
        let bytes = writer.finish().unwrap();
        assert!(bytes.len() < 200_000, "{} bytes", bytes.len());
        // The same without a summary is read when it is opened.
        let end = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        for (bytes, indexed) in [(bytes.clone(), true), (bytes[..end].to_vec(), false)] {
            let opened = Mcap::open_limited(bytes.clone(), LIMITS);
            let error = match opened {
                Ok(recording) if indexed => recording.timeline(|_| true).unwrap_err(),
                other => other.unwrap_err(),
            };
            let McapError::MemoryLimit { needed, allowed, .. } = error else { panic!("{error}") };
            assert!(needed > 30 << 20 && allowed == 1 << 20);
            let enough = Limits { decompressed_bytes: needed };
            let recording = Mcap::open_limited(bytes, enough).unwrap();
            assert_eq!(recording.timeline(|_| true).unwrap().len(), 1);
        }
    }
}

#[test]
fn an_index_that_hides_messages_is_not_believed() {
    let bytes = sample(Compression::Zstd);
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let chunk = &summary.chunk_indexes[0];
    let index = *chunk.message_index_offsets.values().next().unwrap() as usize;
    // The index behind the first chunk names the other channel.
    let channel = bytes[index + 9];
    let other = with(&bytes, index + 9, &[3 - channel]);
    let at = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    let recording = open(&with(&other, at + 9, &[0; 4]));
    assert_eq!(recording.loss(), None);
    let error = recording.timeline(|_| true).unwrap_err();
    let found = error.to_string();
    let begins = format!("byte {}: expected ", chunk.chunk_start_offset);
    assert!(found.starts_with(&begins), "{found}");
    assert!(found.contains(" in this chunk, as its message index has them, found "), "{found}");
    assert_eq!(recording.pass(|_| true, |_| {}).unwrap_err().to_string(), found);
    // By the statistics some are missing then, and all chunks are read.
    let recording = open(&with(&with(&bytes, index, &[0x99]), at + 9, &[0; 4]));
    assert!(read(&recording) == messages());
}

/// xorshift: the same damages for the same seed.
struct Random(u64);

impl Random {
    fn below(&mut self, end: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % end.max(1) as u64) as usize
    }
}

/// Eight messages in three chunks.
fn small(compression: Compression) -> Vec<u8> {
    let options = WriterOptions::with_compression(compression);
    let mut writer = McapWriter::new(WriterOptions { chunk_threshold: 300, ..options });
    let ids = ["/a", "/b"].map(|topic| writer.add_connection(&connection(topic)));
    for number in 0..8u64 {
        writer.write(ids[number as usize % 2], number, &[number as u8; 70]).unwrap();
    }
    writer.finish().unwrap()
}

#[test]
fn a_hundred_thousand_damages_give_an_answer() {
    let mut random = Random(0x9e37_79b9_7f4a_7c15);
    let samples = ALL.map(small);
    let (mut refused, mut reported, mut unreadable) = (0, 0, 0);
    for _ in 0..100_000 {
        let mut bytes = samples[random.below(3)].clone();
        for _ in 0..=random.below(3) {
            let at = random.below(bytes.len());
            match random.below(4) {
                0 => bytes[at] = random.below(256) as u8,
                1 => bytes[at] ^= 1 << random.below(8),
                2 => bytes.truncate(at.max(1)),
                _ => {
                    let value = [0, 1, u64::MAX, 1 << 32, bytes.len() as u64][random.below(5)];
                    let room = (bytes.len() - at).min(8);
                    bytes[at..at + room].copy_from_slice(&value.to_le_bytes()[..room]);
                }
            }
        }
        let Ok(recording) = Mcap::open_limited(bytes, LIMITS) else {
            refused += 1;
            continue;
        };
        reported += u32::from(recording.loss().is_some());
        match recording.timeline(|_| true) {
            Ok(timeline) => assert_eq!(timeline.len() as u64, recording.message_count()),
            Err(_) => unreadable += 1,
        }
        recording.attachments().for_each(drop);
    }
    assert!(refused > 1_000 && reported > 50_000 && unreadable < 5_000);
}
