//! One pass through a bag gives what its timeline gives, or says why it cannot.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use bagpipe_rosbag::{
    Bag, BagError, BagWriter, Compression, Connection, DiskChunkedFile, MemoryChunkedFile, Message,
    WriterOptions,
};
use proptest::prelude::*;

const TOPICS: [&str; 3] = ["/a", "/b", "/c"];

/// A bag of (topic, time) with the message's number as data, in chunks of about `threshold`.
fn written(messages: &[(usize, u64)], threshold: usize, compression: Compression) -> Vec<u8> {
    let options = WriterOptions { compression, chunk_threshold: threshold, byte_budget: None };
    let mut writer = BagWriter::new(options);
    let ids = TOPICS.map(|topic| {
        writer.add_connection(&Connection { topic: topic.to_owned(), ..Connection::default() })
    });
    for (number, (topic, time)) in messages.iter().enumerate() {
        writer.write(ids[*topic], *time, &(number as u32).to_le_bytes()).unwrap();
    }
    writer.finish().unwrap()
}

fn numbers<'a>(messages: impl Iterator<Item = Message<'a>>) -> Vec<u32> {
    messages.map(|each| u32::from_le_bytes(each.data.try_into().unwrap())).collect()
}

fn open(bytes: Vec<u8>) -> Bag<MemoryChunkedFile> {
    Bag::open(MemoryChunkedFile::new(bytes)).unwrap()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn one_pass_is_the_timeline(
        // Few different times: many are equal, and most go back now and then.
        messages in prop::collection::vec((0usize..3, 0u64..60), 0..300),
        sorted in any::<bool>(),
        threshold in 1usize..2000,
        which in 0usize..3,
        left_out in 0usize..4,
    ) {
        let mut messages = messages;
        if sorted {
            messages.sort_by_key(|(_, time)| *time);
        }
        let compression = [Compression::None, Compression::Bz2, Compression::Lz4][which];
        let bytes = written(&messages, threshold, compression);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("some.bag");
        std::fs::write(&path, &bytes).unwrap();
        let keep = |each: &Connection| TOPICS.get(left_out) != Some(&each.topic.as_str());
        let bag = open(bytes);
        let expected = numbers(bag.timeline(keep).unwrap().iter());
        prop_assert_eq!(&numbers(bag.messages(keep).map(Result::unwrap)), &expected);
        let disk = Bag::open(DiskChunkedFile::open(&path).unwrap()).unwrap();
        prop_assert_eq!(&numbers(disk.messages(keep).map(Result::unwrap)), &expected);
    }
}

#[test]
fn chunks_that_overlap_are_ordered_together() {
    // The first chunk also declares the connection; the others have two messages, and 20 and
    // 30 lie between 10 and 40.
    let times = [5, 10, 40, 20, 30, 40, 50];
    let bytes = written(&times.map(|time| (0, time)), 90, Compression::None);
    let bag = open(bytes);
    assert_eq!(bag.chunks().len(), 4);
    assert_eq!(numbers(bag.messages(|_| true).map(Result::unwrap)), [0, 1, 3, 4, 2, 5, 6]);
}

#[test]
fn an_index_that_says_a_wrong_time_is_an_error_with_its_place() {
    let times: Vec<(usize, u64)> = (0..6).map(|each| (0, each * 10)).collect();
    let bytes = written(&times, 90, Compression::None);
    let position = open(bytes.clone()).chunks()[2].position;
    // Chunks of 0, of 10 and 20, of 30 and 40, of 50: in the third, 40 becomes 5.
    let at = bytes.windows(17).position(|window| {
        window[..9] == *b"\x0d\0\0\0time=" && window[13..] == 40u32.to_le_bytes()
    });
    let mut wrong = bytes;
    wrong[at.unwrap() + 13] = 5;
    let bag = open(wrong);
    // The timeline looks at every message first, and puts it where it belongs.
    assert_eq!(numbers(bag.timeline(|_| true).unwrap().iter()), [0, 4, 1, 2, 3, 5]);
    let mut pass = bag.messages(|_| true);
    let before: Vec<u64> = pass.by_ref().take(3).map(|each| each.unwrap().time).collect();
    assert_eq!(before, [0, 10, 20]);
    let error = pass.next().unwrap().unwrap_err();
    assert!(matches!(&error, BagError::Damaged { offset, .. } if *offset == position), "{error}");
    assert!(error.to_string().contains("found one at 5 ns"), "{error}");
    assert!(pass.next().is_none());
}

#[test]
fn damage_ends_the_pass_after_what_is_whole() {
    let times: Vec<(usize, u64)> = (0..6).map(|each| (0, each * 10)).collect();
    let mut bytes = written(&times, 90, Compression::None);
    let data = open(bytes.clone()).chunks()[1].data_position as usize;
    bytes[data] = 0xff;
    let bag = open(bytes);
    let mut pass = bag.messages(|_| true);
    assert_eq!(pass.by_ref().take(1).filter(Result::is_ok).count(), 1);
    let error = pass.next().unwrap().unwrap_err();
    assert_eq!(error.offset(), Some(data as u64), "{error}");
    assert!(pass.next().is_none());
}
