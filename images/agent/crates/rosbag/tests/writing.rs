//! What is written is what is read, within the budget, and Debian's rosbag agrees.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod needed;

use std::path::Path;
use std::process::Command;

use bagpipe_rosbag::{
    Bag, BagError, BagWriter, Compression, Connection, MemoryChunkedFile, WriterOptions,
};
use needed::without_ros;
use proptest::prelude::*;

const ALL: [Compression; 3] = [Compression::None, Compression::Bz2, Compression::Lz4];

fn connection(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        caller_id: Some("/talker".to_owned()),
        latching: topic == "/latched",
        ..Connection::default()
    }
}

fn options(compression: Compression, chunk_threshold: usize) -> WriterOptions {
    WriterOptions { compression, chunk_threshold, byte_budget: None }
}

type Plain = (String, u64, Vec<u8>);

fn read(bytes: Vec<u8>, indexed: bool) -> Vec<Plain> {
    let file = MemoryChunkedFile::new(bytes);
    let bag = if indexed { Bag::open(file) } else { Bag::open_unindexed(file) }.unwrap();
    assert!(bag.loss().is_none(), "{:?}", bag.loss());
    let timeline = bag.timeline(|_| true).unwrap();
    let plain = |message: bagpipe_rosbag::Message<'_>| {
        let topic = bag.connection(message.connection).unwrap().topic.clone();
        (topic, message.time, message.data.to_vec())
    };
    timeline.iter().map(plain).collect()
}

#[test]
fn a_bag_that_goes_into_a_file_chunk_by_chunk_is_the_one_that_is_made_in_memory() {
    for compression in ALL {
        let [mut kept, mut spilled] =
            [(); 2].map(|()| BagWriter::new(options(compression, 10_000)));
        let mut file = tempfile::tempfile().unwrap();
        for writer in [&mut kept, &mut spilled] {
            writer.add_connection(&connection("/a"));
            writer.add_connection(&connection("/b"));
        }
        for number in 0..500u32 {
            let data = number.to_le_bytes().repeat(1 + number as usize % 60);
            kept.write(number % 2, u64::from(number) * 1_000, &data).unwrap();
            spilled.write(number % 2, u64::from(number) * 1_000, &data).unwrap();
            spilled.spill(&mut file).unwrap();
        }
        let (most, expected) = (kept.high_water(), kept.finish().unwrap());
        assert_eq!(spilled.high_water(), most);
        let length = spilled.finish_spilled(&mut file).unwrap();
        let mut found = Vec::new();
        std::io::Seek::rewind(&mut file).unwrap();
        std::io::Read::read_to_end(&mut file, &mut found).unwrap();
        assert_eq!((length, found), (expected.len() as u64, expected));
    }
}

#[test]
fn a_file_that_takes_no_more_is_reported_with_the_offset() {
    let mut writer = BagWriter::new(options(Compression::None, 1_000));
    writer.add_connection(&connection("/a"));
    writer.write(0, 1, &[7; 2_000]).unwrap();
    let mut full = &mut [0u8; 100][..];
    let error = writer.spill(&mut full).unwrap_err();
    assert!(error.to_string().starts_with("the bag cannot be written on from byte 0: "), "{error}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn a_bag_reads_back_in_time_order(
        messages in prop::collection::vec(
            (0u32..4, 0u64..40_000_000_000, prop::collection::vec(any::<u8>(), 0..300)), 0..120),
        threshold in 1usize..4000,
        which in 0usize..3,
    ) {
        let mut writer = BagWriter::new(options(ALL[which], threshold));
        for topic in ["/a", "/b", "/latched", "/d"] {
            writer.add_connection(&connection(topic));
        }
        let mut expected: Vec<Plain> = Vec::new();
        for (id, time, data) in &messages {
            writer.write(*id, *time, data).unwrap();
            let topic = ["/a", "/b", "/latched", "/d"][*id as usize];
            expected.push((topic.to_owned(), *time, data.clone()));
        }
        expected.sort_by_key(|(_, time, _)| *time);
        let high_water = writer.high_water();
        let bytes = writer.finish().unwrap();
        if ALL[which] == Compression::None {
            prop_assert!(bytes.len() as u64 <= high_water, "{} > {high_water}", bytes.len());
        }
        prop_assert_eq!(&read(bytes.clone(), true), &expected);
        prop_assert_eq!(&read(bytes, false), &expected);
    }
}

#[test]
fn connections_survive() {
    let mut writer = BagWriter::new(WriterOptions::default());
    let id = writer.add_connection(&connection("/latched"));
    writer.add_connection(&connection("/never"));
    writer.write(id, 1, b"x").unwrap();
    let bag = Bag::open(MemoryChunkedFile::new(writer.finish().unwrap())).unwrap();
    assert_eq!(bag.connections(), [Connection { id, ..connection("/latched") }]);
}

#[test]
fn an_empty_bag_is_valid() {
    let bytes = BagWriter::new(WriterOptions::default()).finish().unwrap();
    assert_eq!(bytes.len(), 13 + 4096);
    assert!(read(bytes, true).is_empty());
}

#[test]
fn the_budget_holds_and_the_bag_before_it_is_kept() {
    for compression in ALL {
        let budget = 100_000;
        let mut writer = BagWriter::new(WriterOptions {
            byte_budget: Some(budget),
            ..options(compression, 8 * 1024)
        });
        let id = writer.add_connection(&connection("/a"));
        let mut random: u32 = 1;
        let mut written = 0;
        let error = loop {
            // Incompressible, so that the finished size is near what was counted.
            let data: Vec<u8> = std::iter::repeat_with(|| {
                random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (random >> 24) as u8
            })
            .take(1000)
            .collect();
            match writer.write(id, written, &data) {
                Ok(()) => written += 1,
                Err(error) => break error,
            }
        };
        assert!(
            matches!(error, BagError::BudgetExceeded { budget: 100_000, needed } if needed > budget)
        );
        assert!(writer.high_water() <= budget);
        let bytes = writer.finish().unwrap();
        assert!(bytes.len() as u64 <= budget + 2048, "{compression:?}: {}", bytes.len());
        let figure = match compression {
            Compression::None => 87,
            Compression::Bz2 => 85,
            Compression::Lz4 => 89,
        };
        assert_eq!(written, figure, "{compression:?}");
        assert_eq!(read(bytes, true).len() as u64, written);
    }
}

#[test]
fn an_unknown_connection_is_an_error() {
    let mut writer = BagWriter::new(WriterOptions::default());
    assert!(matches!(writer.write(3, 0, b""), Err(BagError::UnknownConnection(3))));
}

fn run(program: &str, arguments: &[&str], folder: &Path) -> String {
    let output = Command::new(program).args(arguments).current_dir(folder).output().unwrap();
    let text = format!(
        "{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
    assert!(output.status.success(), "{program} {arguments:?}: {text}");
    text
}

/// std_msgs/String with a text, as the tools can deserialise it.
fn text(number: u64) -> Vec<u8> {
    let body = format!("message number {number} {}", "z".repeat(900));
    [&(body.len() as u32).to_le_bytes(), body.as_bytes()].concat()
}

#[test]
fn debians_rosbag_reads_what_is_written() {
    if without_ros() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for compression in ALL {
        let mut writer = BagWriter::new(options(compression, 64 * 1024));
        let ids = ["/a", "/latched"].map(|topic| writer.add_connection(&connection(topic)));
        for number in 0..3000 {
            let id = ids[(number % 3 == 0) as usize];
            writer.write(id, 1_000_000_000 + number * 10_000_000, &text(number)).unwrap();
        }
        let bytes = writer.finish().unwrap();
        std::fs::write(folder.path().join("ours.bag"), bytes).unwrap();
        let info = run("rosbag", &["info", "ours.bag"], folder.path());
        assert!(
            info.contains("messages:     3000") || info.contains("messages:    3000"),
            "{info}"
        );
        assert!(info.contains("2000 msgs") && info.contains("1000 msgs"), "{info}");
        assert!(info.contains(&format!("{} [45/45 chunks", compression.name())), "{info}");
        let check = run("rosbag", &["check", "ours.bag"], folder.path());
        assert!(check.contains("Bag file does not need any migrations"), "{check}");
        // The tools decompress every chunk and deserialise every message.
        let count = "import rosbag; b = rosbag.Bag('ours.bag'); \
            print(sum(1 for t, m, s in b.read_messages() if m.data.startswith('message number')))";
        assert_eq!(run("/usr/bin/python3", &["-c", count], folder.path()).trim(), "3000");
    }
}

#[test]
fn an_empty_bag_is_read_by_rosbag_info() {
    if without_ros() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let bytes = BagWriter::new(WriterOptions::default()).finish().unwrap();
    std::fs::write(folder.path().join("empty.bag"), bytes).unwrap();
    let info = run("rosbag", &["info", "empty.bag"], folder.path());
    assert!(info.contains("4.0 KB"), "{info}");
}
