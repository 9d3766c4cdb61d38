//! An index read from a head, a footer and a summary: what a reader of the whole file finds as
//! well, refusals where it is not all there, and never a panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::io::Cursor;

use bagpipe_log::{Index, Reason, Refusal};
use bagpipe_mcap::Mcap;
use bagpipe_mcap::tail::{FOOTER_BYTES, index_times, parse_footer, parse_head, parse_summary};
use mcap::records::MessageHeader;
use mcap::{Compression, MessageStream, WriteOptions, Writer};
use proptest::prelude::*;

/// DataEnd and Footer, which say nothing, and the magic: what a planner puts behind chunks.
const END: &[u8] = b"\x0f\x04\0\0\0\0\0\0\0\0\0\0\0\
    \x02\x14\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\x89MCAP0\r\n";
const DEFINITION: &[u8] = b"string data\n";

/// 60 messages on /a, 20 on the latching /b and none on /c, in chunks of some 400 bytes.
fn sample(options: WriteOptions) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = Writer::with_options(&mut bytes, options.chunk_size(Some(400))).unwrap();
    let schema = writer.add_schema("std_msgs/String", "ros1msg", DEFINITION).unwrap();
    let latching = BTreeMap::from([
        ("latching".to_owned(), "1".to_owned()),
        ("callerid".to_owned(), "/talker".to_owned()),
    ]);
    let a = writer.add_channel(schema, "/a", "ros1", &BTreeMap::new()).unwrap();
    let b = writer.add_channel(schema, "/b", "ros1", &latching).unwrap();
    writer.add_channel(schema, "/c", "ros1", &BTreeMap::new()).unwrap();
    for number in 0..80_u64 {
        let channel_id = if number % 4 == 3 { b } else { a };
        let (log_time, publish_time) = (1_000 + number * 10, 900 + number * 10);
        let header = MessageHeader { channel_id, sequence: 0, log_time, publish_time };
        writer.write_to_known_channel(&header, &[number as u8; 20]).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes.into_inner()
}

/// Of a recording whose summary has no CRC-32, so that what else is wrong with it shows.
fn unchecked() -> WriteOptions {
    WriteOptions::new().calculate_summary_section_crc(false)
}

fn read(bytes: &[u8]) -> Result<Index, Refusal> {
    let size = bytes.len() as u64;
    let head_end = parse_head(bytes)?;
    let last = bytes.len().saturating_sub(FOOTER_BYTES as usize);
    let (begin, end) = parse_footer(&bytes[last..], size)?;
    parse_summary(&bytes[begin as usize..end as usize], begin, head_end, &bytes[last..])
}

fn refusal(bytes: &[u8]) -> (Reason, String) {
    let refused = read(bytes).unwrap_err();
    (refused.reason, refused.sentence)
}

#[test]
fn it_is_what_a_reader_of_all_of_it_finds() {
    for compression in [None, Some(Compression::Lz4), Some(Compression::Zstd)] {
        let name = compression.map_or("none", |each| match each {
            Compression::Lz4 => "lz4",
            _ => "zstd",
        });
        let bytes = sample(WriteOptions::new().compression(compression));
        let index = read(&bytes).unwrap();
        let all: Vec<_> =
            MessageStream::new(&bytes).unwrap().collect::<Result<Vec<_>, _>>().unwrap();
        let mut met = 0;
        for chunk in &index.chunks {
            assert_eq!(chunk.compression.as_deref(), Some(name));
            let begin = chunk.index.unwrap();
            let times = index_times(&bytes[begin as usize..chunk.end as usize], begin).unwrap();
            let counts = times.iter().map(|(channel, times)| (*channel, times.len() as u32));
            assert_eq!(counts.collect::<BTreeMap<_, _>>(), chunk.counts.iter().copied().collect());
            let mut times: Vec<u64> = times.into_iter().flat_map(|(_, times)| times).collect();
            times.sort_unstable();
            assert_eq!((times[0], *times.last().unwrap()), (chunk.start_time, chunk.end_time));
            let of_reader: Vec<u64> =
                all[met..met + times.len()].iter().map(|message| message.log_time).collect();
            assert_eq!(times, of_reader);
            met += times.len();
        }
        assert_eq!((met, index.chunks.len() > 4), (80, true));
        let topics: Vec<_> = index.connections.iter().map(|each| each.topic.as_str()).collect();
        assert_eq!(topics, ["/a", "/b", "/c"]);
        let b = &index.connections[1];
        assert_eq!((b.in_force, b.caller_id.as_str()), (1, "/talker"));
        assert_eq!(b.datatype, "std_msgs/String");
    }
}

#[test]
fn its_declarations_and_any_chunk_are_a_recording() {
    let bytes = sample(WriteOptions::new().compression(Some(Compression::Zstd)));
    let index = read(&bytes).unwrap();
    assert_eq!(index.declarations[0].0, 0);
    let cut = |(offset, length): (u64, u64)| &bytes[offset as usize..(offset + length) as usize];
    let declared: Vec<u8> =
        index.declarations.iter().flat_map(|range| cut(*range)).copied().collect();
    for chunk in &index.chunks {
        let mut part = declared.clone();
        part.extend_from_slice(&bytes[chunk.offset as usize..chunk.end as usize]);
        part.extend_from_slice(END);
        let stream = MessageStream::new(&part).unwrap();
        let found = stream.collect::<Result<Vec<_>, _>>().unwrap();
        let ours = Mcap::open(part.clone()).unwrap();
        assert_eq!((ours.message_count(), ours.loss()), (found.len() as u64, None));
        let expected: u32 = chunk.counts.iter().map(|(_, count)| count).sum();
        assert_eq!(found.len() as u32, expected);
    }
}

#[test]
fn what_planning_lacks_is_refused_with_its_place() {
    let whole = sample(WriteOptions::new());
    let (reason, sentence) = refusal(&whole[..whole.len() - 1]);
    assert_eq!(reason, Reason::Cut);
    assert!(sentence.contains("no footer at byte"), "{sentence}");
    assert_eq!(refusal(&whole[..9]).0, Reason::Cut);
    for (options, words) in [
        (WriteOptions::new().emit_summary_records(false), "has no summary"),
        (WriteOptions::new().use_chunks(false), "places of 0 messages"),
        (WriteOptions::new().emit_message_indexes(false), "places of 0 messages"),
        (WriteOptions::new().emit_message_indexes(false).emit_statistics(false), "of 0 messages"),
        (WriteOptions::new().repeat_channels(false), "does not declare channel"),
        (WriteOptions::new().repeat_schemas(false), "does not declare channel"),
    ] {
        let (reason, sentence) = refusal(&sample(options));
        assert_eq!(reason, Reason::NotIndexed, "{sentence}");
        assert!(sentence.contains(words), "{sentence}");
    }
    let mut bytes = Cursor::new(Vec::new());
    Writer::new(&mut bytes).unwrap().finish().unwrap();
    assert_eq!(refusal(&bytes.into_inner()).0, Reason::Empty);
}

#[test]
fn without_statistics_the_indexes_themselves_count() {
    let index = read(&sample(WriteOptions::new().emit_statistics(false))).unwrap();
    let counts = index.chunks.iter().flat_map(|chunk| &chunk.counts).map(|(_, count)| count);
    assert_eq!(counts.sum::<u32>(), 80);
    assert!(!index.counted);
    assert!(read(&sample(WriteOptions::new())).unwrap().counted);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2_000))]
    #[test]
    fn damage_is_a_refusal_and_never_a_panic(
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let mut bytes = sample(unchecked());
        let summary = bytes.len() - 1_500;
        for (place, value) in places {
            let at = summary + place.index(1_500);
            bytes[at] = value;
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        if let Ok(index) = read(&bytes) {
            for chunk in index.chunks {
                let begin = chunk.index.unwrap();
                prop_assert!(chunk.offset <= begin && begin <= chunk.end);
                prop_assert!(chunk.end <= bytes.len() as u64);
                let _found = index_times(&bytes[begin as usize..chunk.end as usize], begin);
            }
        }
    }
}

/// With the `nth` record of the summary that has this opcode made an unknown one.
fn without(mut bytes: Vec<u8>, op: u8, nth: usize) -> Vec<u8> {
    let last = bytes.len() - FOOTER_BYTES as usize;
    let (begin, end) = parse_footer(&bytes[last..], bytes.len() as u64).unwrap();
    let (mut at, mut met) = (begin as usize, 0);
    while at < end as usize {
        if bytes[at] == op {
            if met == nth {
                bytes[at] = 0x80;
                return bytes;
            }
            met += 1;
        }
        at += 9 + u64::from_le_bytes(*bytes[at + 1..].first_chunk().unwrap()) as usize;
    }
    panic!("no record {nth} of opcode {op}");
}

#[test]
fn a_chunk_that_the_summary_leaves_out_is_missed_with_statistics_and_without() {
    for statistics in [true, false] {
        let bytes = sample(unchecked().emit_statistics(statistics));
        let chunks = read(&bytes).unwrap().chunks.len();
        for nth in [0, chunks / 2, chunks - 1] {
            let (reason, sentence) = refusal(&without(bytes.clone(), 0x08, nth));
            assert_eq!(reason, Reason::NotIndexed, "{sentence}");
            assert!(sentence.contains("and not of all"), "{sentence}");
        }
    }
}

/// Where the content of the `nth` record of that opcode in the summary lies.
fn content(bytes: &[u8], op: u8, nth: usize) -> usize {
    let last = bytes.len() - FOOTER_BYTES as usize;
    let (begin, end) = parse_footer(&bytes[last..], bytes.len() as u64).unwrap();
    let mut at = begin as usize;
    let mut found = Vec::new();
    while at < end as usize {
        if bytes[at] == op {
            found.push(at + 9);
        }
        at += 9 + u64::from_le_bytes(*bytes[at + 1..].first_chunk().unwrap()) as usize;
    }
    found[nth]
}

#[test]
fn chunk_indexes_that_leave_out_times_of_the_statistics_are_refused() {
    let bytes = sample(unchecked());
    let chunks = read(&bytes).unwrap().chunks.len();
    for (nth, field, time, shown) in
        [(0, 0, 1_001_u64, "from 1001 to 1790"), (chunks - 1, 8, 1_780, "from 1000 to 1780")]
    {
        let mut bytes = bytes.clone();
        let at = content(&bytes, 0x08, nth) + field;
        bytes[at..at + 8].copy_from_slice(&time.to_le_bytes());
        let (reason, sentence) = refusal(&bytes);
        assert_eq!(reason, Reason::Unreadable);
        assert!(sentence.contains("state messages from 1000 to 1790 ns"), "{sentence}");
        assert!(sentence.contains(shown), "{sentence}");
    }
    // Some writers leave the times out.
    let mut silent = bytes;
    let at = content(&silent, 0x0b, 0) + 26;
    assert_eq!(silent[at..at + 8], 1_000_u64.to_le_bytes());
    silent[at..at + 16].fill(0);
    assert!(read(&silent).is_ok());
}

#[test]
fn a_name_of_a_type_that_each_channel_would_have_a_copy_of_is_short() {
    let named = |length: usize| {
        let mut bytes = Cursor::new(Vec::new());
        let mut writer = Writer::new(&mut bytes).unwrap();
        let schema = writer.add_schema(&"x".repeat(length), "ros2msg", DEFINITION).unwrap();
        let channel_id = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, b"x").unwrap();
        writer.finish().unwrap();
        drop(writer);
        bytes.into_inner()
    };
    assert!(read(&named(1024)).is_ok());
    let (reason, sentence) = refusal(&named(1025));
    assert_eq!(reason, Reason::Unreadable);
    assert!(sentence.contains("a schema's name of at most 1024 bytes, found 1025"), "{sentence}");
}

#[test]
fn a_summary_that_was_changed_is_refused() {
    let mut bytes = sample(WriteOptions::new());
    let (begin, _) =
        parse_footer(&bytes[bytes.len() - FOOTER_BYTES as usize..], bytes.len() as u64).unwrap();
    bytes[begin as usize + 15] ^= 1;
    let (reason, sentence) = refusal(&bytes);
    assert_eq!(reason, Reason::Unreadable);
    let words = format!("the summary at byte {begin} does not have the CRC-32");
    assert!(sentence.starts_with(&words), "{sentence}");
}

#[test]
fn message_indexes_of_another_channel_than_the_statistics_count_are_refused() {
    let mut bytes = sample(unchecked());
    let index = read(&bytes).unwrap();
    let first = index.chunks[0].index.unwrap().to_le_bytes();
    let summary = index.chunks.last().unwrap().end as usize;
    let at = summary + bytes[summary..].windows(8).position(|found| found == first).unwrap() - 2;
    assert_eq!(&bytes[at..at + 2], &1u16.to_le_bytes());
    bytes[at] = 3;
    let (reason, sentence) = refusal(&bytes);
    assert_eq!(reason, Reason::Unreadable);
    assert!(sentence.contains("count other messages of a channel"), "{sentence}");
}
