//! Slices, merges and new indexes: nothing is lost, nothing is doubled, the order stays.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod needed;

use std::process::Command;

use bagpipe_rosbag::{
    Bag, BagWriter, Compression, Connection, DiskChunkedFile, MemoryChunkedFile, Window,
    WriterOptions, check, merge, reindex, slice,
};
use needed::without_ros;
use proptest::prelude::*;

const ALL: [Compression; 3] = [Compression::None, Compression::Bz2, Compression::Lz4];
const TOPICS: [&str; 4] = ["/a", "/b", "/map", "/d"];

fn connection(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        caller_id: Some("/talker".to_owned()),
        latching: topic == "/map",
        ..Connection::default()
    }
}

fn options(compression: Compression, chunk_threshold: usize) -> WriterOptions {
    WriterOptions { compression, chunk_threshold, byte_budget: None }
}

type Plain = (String, u64, Vec<u8>);

fn open(bytes: &[u8]) -> Bag<MemoryChunkedFile> {
    Bag::open(MemoryChunkedFile::new(bytes.to_vec())).unwrap()
}

/// All messages, by the index and by a scan, which must agree.
fn read(bytes: &[u8]) -> Vec<Plain> {
    let scanned = Bag::open_unindexed(MemoryChunkedFile::new(bytes.to_vec())).unwrap();
    let (indexed, scanned) = (plain(&open(bytes)), plain(&scanned));
    assert_eq!(indexed, scanned);
    let checked = check(&MemoryChunkedFile::new(bytes.to_vec())).unwrap();
    assert!(checked.sound(), "{checked:?}");
    indexed
}

fn plain(bag: &Bag<MemoryChunkedFile>) -> Vec<Plain> {
    assert!(bag.loss().is_none(), "{:?}", bag.loss());
    let timeline = bag.timeline(|_| true).unwrap();
    let topic = |id| bag.connection(id).unwrap().topic.clone();
    timeline.iter().map(|each| (topic(each.connection), each.time, each.data.to_vec())).collect()
}

fn written(messages: &[(usize, u64, Vec<u8>)], options: WriterOptions) -> Vec<u8> {
    let mut writer = BagWriter::new(options);
    let ids = TOPICS.map(|topic| writer.add_connection(&connection(topic)));
    for (topic, time, data) in messages {
        writer.write(ids[*topic], *time, data).unwrap();
    }
    writer.finish().unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn slices_merge_back_into_the_same_sequence(
        messages in prop::collection::vec(
            (0usize..4, 0u64..1000, prop::collection::vec(any::<u8>(), 0..200)), 1..150),
        sorted in any::<bool>(),
        threshold in 1usize..4000,
        (from, to) in (0usize..3, 0usize..3),
        mut cuts in prop::collection::vec(0u64..1000, 0..5),
    ) {
        let mut messages = messages;
        if sorted {
            messages.sort_by_key(|(_, time, _)| *time);
        }
        let bytes = written(&messages, options(ALL[from], threshold));
        let bag = open(&bytes);
        let expected = plain(&bag);
        cuts.sort_unstable();
        let starts = std::iter::once(0).chain(cuts.iter().copied());
        let ends = cuts.iter().copied().chain([u64::MAX]);
        let mut parts = Vec::new();
        for (start, end) in starts.zip(ends) {
            let made = slice(&bag, Window { start, end }, |_| true, options(ALL[to], 500)).unwrap();
            let found = read(&made.bytes);
            let inside: Vec<Plain> =
                expected.iter().filter(|each| (start..end).contains(&each.1)).cloned().collect();
            // The latched message in force comes first, stamped with the window's start.
            let before = expected.iter().rfind(|each| each.0 == "/map" && each.1 < start);
            prop_assert_eq!(made.latched, u64::from(before.is_some()));
            if let Some(latched) = before {
                prop_assert_eq!(&found[0], &(latched.0.clone(), start, latched.2.clone()));
            }
            prop_assert_eq!(made.messages as usize, inside.len());
            prop_assert_eq!(&found[made.latched as usize..], &inside[..]);
            // Without the latched copies, for the sequence to come back as it was.
            let no_copies = slice(&bag, Window { start, end }, |each| !each.latching, options(ALL[to], 500)).unwrap();
            parts.push(open(&no_copies.bytes));
        }
        let merged = read(&merge(&parts, options(ALL[to], 700)).unwrap());
        let expected: Vec<Plain> = expected.into_iter().filter(|each| each.0 != "/map").collect();
        prop_assert_eq!(merged, expected);
    }

    #[test]
    fn a_lost_index_is_made_again(
        messages in prop::collection::vec(
            (0usize..4, 0u64..1000, prop::collection::vec(any::<u8>(), 0..200)), 1..150),
        threshold in 1usize..4000,
        which in 0usize..3,
        cut in any::<prop::sample::Index>(),
    ) {
        let bytes = written(&messages, options(ALL[which], threshold));
        let whole = reindex(MemoryChunkedFile::new(bytes.clone()), options(ALL[which], 500)).unwrap();
        prop_assert!(whole.loss.is_none());
        prop_assert_eq!(whole.whole_chunks, open(&bytes).chunks().len());
        prop_assert_eq!(read(&whole.bytes), read(&bytes));
        let cut = 4109 + cut.index(bytes.len() - 4109);
        let part = MemoryChunkedFile::new(bytes[..cut].to_vec());
        let kept = Bag::open_unindexed(part.clone()).unwrap().message_count();
        let saved = reindex(part, options(Compression::None, 500)).unwrap();
        prop_assert_eq!(saved.messages, kept);
        let all = read(&bytes);
        let mut left = all.iter();
        let mut sorted = read(&saved.bytes);
        sorted.retain(|each| !left.any(|other| other == each));
        prop_assert!(sorted.is_empty(), "not in the original, or not in its order: {:?}", sorted);
    }
}

/// 2,000 messages of 1 KB on two topics with a latched map at the start.
fn drive(compression: Compression) -> Vec<u8> {
    let text = |text: String| [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
    let mut messages = vec![(2, 1_000_000_000, text("map".to_owned()))];
    for number in 0..2000u64 {
        let time = 1_000_000_000 + number * 10_000_000;
        let body = text(format!("{number} {}", "z".repeat(1000)));
        messages.push(((number % 2) as usize, time, body));
    }
    written(&messages, options(compression, 64 * 1024))
}

const MIDDLE: Window = Window { start: 6_000_000_000, end: 16_000_000_000 };

#[test]
fn whole_chunks_are_carried_and_never_uncompressed() {
    for compression in ALL {
        let bag = open(&drive(compression));
        let made = slice(&bag, MIDDLE, |_| true, options(compression, 64 * 1024)).unwrap();
        // 1,000 messages lie in 17 chunks; the first is cut, and the last.
        assert_eq!((made.messages, made.latched), (1000, 1), "{compression:?}");
        assert!(made.whole_chunks >= 14, "{compression:?}: {}", made.whole_chunks);
        assert_eq!(read(&made.bytes)[0].0, "/map");
        let of_a =
            slice(&bag, MIDDLE, |each| each.topic == "/a", options(compression, 1000)).unwrap();
        assert_eq!((of_a.messages, of_a.latched, of_a.whole_chunks), (500, 0, 0));
    }
}

#[test]
fn debians_rosbag_reads_slices_merges_and_new_indexes() {
    if without_ros() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ours.bag");
    for compression in ALL {
        let bytes = drive(compression);
        let part = slice(&open(&bytes), MIDDLE, |_| true, WriterOptions::default()).unwrap();
        let parts = [open(&part.bytes), open(&bytes)];
        let both = merge(&parts, options(compression, 64 * 1024)).unwrap();
        assert_eq!(open(&both).connections().len(), 3);
        let unindexed = MemoryChunkedFile::new(bytes[..bytes.len() - 300].to_vec());
        let again = reindex(unindexed, WriterOptions::default()).unwrap();
        for (bytes, count) in [(part.bytes, 1001), (both, 3002), (again.bytes, 2001)] {
            std::fs::write(&path, bytes).unwrap();
            let disk = DiskChunkedFile::open(&path).unwrap();
            assert!(check(&disk).unwrap().sound());
            let done = Command::new("rosbag").arg("check").arg(&path).output().unwrap();
            assert!(done.status.success(), "{done:?}");
            let info = Command::new("rosbag").arg("info").arg(&path).output().unwrap();
            let info = String::from_utf8(info.stdout).unwrap();
            let line = info.lines().find(|line| line.starts_with("messages:")).unwrap();
            assert_eq!(line.split_whitespace().last(), Some(&*count.to_string()), "{info}");
            let reads = "import rosbag, sys; b = rosbag.Bag(sys.argv[1]); \
                print(sum(1 for t, m, s in b.read_messages() if m.data))";
            let read =
                Command::new("/usr/bin/python3").args(["-c", reads]).arg(&path).output().unwrap();
            assert_eq!(String::from_utf8_lossy(&read.stdout).trim(), count.to_string(), "{read:?}");
        }
    }
}

#[test]
fn check_names_what_contradicts_itself() {
    let mut bytes = drive(Compression::None);
    // The bag ends in the count of the last connection of the last chunk.
    let at = bytes.len() - 4;
    bytes[at] ^= 1;
    let checked = check(&MemoryChunkedFile::new(bytes)).unwrap();
    assert!(checked.loss.is_none());
    assert_eq!(checked.problems.len(), 1, "{checked:?}");
    assert!(checked.problems[0].starts_with("the index counts "), "{checked:?}");
}

#[test]
fn two_types_of_one_topic_are_named() {
    let mut writer = BagWriter::new(WriterOptions::default());
    let first = writer.add_connection(&connection("/a"));
    let other = Connection { datatype: "std_msgs/Int8".to_owned(), ..connection("/a") };
    let second = writer.add_connection(&other);
    writer.write(first, 1, b"1").unwrap();
    writer.write(second, 2, b"2").unwrap();
    let checked = check(&MemoryChunkedFile::new(writer.finish().unwrap())).unwrap();
    let md5 = "992ce8a1687cec8c8bd883ec73ca41d1";
    let expected = format!("topic /a is std_msgs/String ({md5}) and std_msgs/Int8 ({md5})");
    assert_eq!(checked.problems, [expected]);
}

#[test]
fn lost_messages_are_counted_where_an_index_record_counts_them() {
    let mut bytes = drive(Compression::Lz4);
    let bag = open(&bytes);
    let (chunk, whole) = (bag.chunks()[3].clone(), bag.message_count());
    for byte in &mut bytes[chunk.data_position as usize + 30..][..20] {
        *byte ^= 0x55;
    }
    let damaged = Bag::open_unindexed(MemoryChunkedFile::new(bytes.clone())).unwrap();
    let lost = whole - damaged.message_count();
    assert!(lost > 0);
    assert_eq!(damaged.loss().unwrap().messages, Some(lost));
    // Behind a cut nothing counts.
    let cut = bytes[..chunk.data_position as usize + 100].to_vec();
    let cut = Bag::open_unindexed(MemoryChunkedFile::new(cut)).unwrap();
    assert_eq!(cut.loss().unwrap().messages, None);
}

#[test]
fn a_chunk_that_came_out_whole_from_damaged_bytes_is_not_carried_as_it_is() {
    let bytes = drive(Compression::Bz2);
    let bag = open(&bytes);
    let chunk = bag.chunks().last().unwrap().clone();
    // Only bzip2's closing checksum is cut off.
    let cut = bytes[..(chunk.data_position + u64::from(chunk.data_length) - 4) as usize].to_vec();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cut.bag");
    std::fs::write(&path, &cut).unwrap();
    let from_disk = reindex(DiskChunkedFile::open(&path).unwrap(), WriterOptions::default());
    let from_memory = reindex(MemoryChunkedFile::new(cut), WriterOptions::default()).unwrap();
    assert_eq!(read(&from_memory.bytes), read(&bytes));
    assert_eq!(from_memory.whole_chunks, bag.chunks().len() - 1);
    assert_eq!(from_disk.unwrap().bytes, from_memory.bytes);
}

#[test]
fn a_window_touches_only_chunks_near_it_and_places_name_the_bytes() {
    let messages: Vec<_> = (0..100u8).map(|each| (0, u64::from(each), vec![each; 100])).collect();
    for compression in ALL {
        let bag = open(&written(&messages, options(compression, 1000)));
        let near = Window { start: 40, end: 50 };
        let timeline = bag.timeline_near(near, |_| true).unwrap();
        let inside = timeline.between(near.start, near.end);
        assert!(inside.len() == 10 && timeline.len() < 30, "{} of {inside:?}", timeline.len());
        let places = timeline.into_places();
        for (place, time) in places[inside].iter().zip(40u8..) {
            assert_eq!((place.time, place.connection), (u64::from(time), 0));
            let chunk = bag.chunk_data(place.chunk as usize).unwrap().unwrap();
            let frame = &chunk[place.start as usize..place.end as usize];
            assert_eq!((&frame[..4], &frame[4..]), (&[100, 0, 0, 0][..], &[time; 100][..]));
        }
        assert!(bag.chunk_data(bag.chunks().len()).is_none());
    }
}
