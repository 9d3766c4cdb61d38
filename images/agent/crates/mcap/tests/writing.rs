//! What is written is what is read, within the budget, with the same bytes each time.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use std::error::Error;
use std::io;

use bagpipe_log::{Recording, RecordingError, RecordingFormat};
use bagpipe_mcap::{Compression, Connection, Mcap, McapError, McapWriter, WriterOptions};
use proptest::prelude::*;
use sample::{ALL, ATTACHMENT, connection, metadata};

fn options(compression: Compression, chunk_threshold: usize) -> WriterOptions {
    WriterOptions { chunk_threshold, ..WriterOptions::with_compression(compression) }
}

type Plain = (String, u64, Vec<u8>);

fn read(bytes: Vec<u8>) -> Vec<Plain> {
    let recording = Mcap::open(bytes).unwrap();
    assert_eq!(recording.loss(), None);
    let recording: &dyn Recording = &recording;
    let timeline = recording.timeline(&|_| true).unwrap();
    let topic = |id| recording.connections().iter().find(|each| each.id == id).unwrap();
    let messages = (0..timeline.len()).filter_map(|at| timeline.get(at));
    let plain = |each: bagpipe_mcap::Message<'_>| {
        (topic(each.connection).topic.clone(), each.time, each.data.to_vec())
    };
    messages.map(plain).collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn a_recording_reads_back_in_time_order(
        messages in prop::collection::vec(
            (0usize..4, any::<u64>(), prop::collection::vec(any::<u8>(), 0..300)), 0..120),
        threshold in 1usize..4000,
        which in 0usize..3,
    ) {
        let mut writer = McapWriter::new(options(ALL[which], threshold));
        let topics = ["/a", "/b", "/latched", "/d"];
        let ids = topics.map(|topic| writer.add_connection(&connection(topic)));
        let mut expected: Vec<Plain> = Vec::new();
        for (at, time, data) in &messages {
            writer.write(ids[*at], *time, data).unwrap();
            expected.push((topics[*at].to_owned(), *time, data.clone()));
        }
        expected.sort_by_key(|(_, time, _)| *time);
        prop_assert_eq!(&read(writer.finish().unwrap()), &expected);
    }
}

/// Messages and all else that a recording may hold, so many of them.
fn fill(writer: &mut McapWriter, steps: u64) {
    let mut other = connection("/c");
    other.definition = format!("{}int8 more\n", other.definition).into();
    let ids = [connection("/a"), connection("/b"), other].map(|each| writer.add_connection(&each));
    for step in 0..steps {
        match step {
            7 => writer.attach(&ATTACHMENT).unwrap(),
            9 => writer.describe(&metadata()).unwrap(),
            _ => writer.write(ids[step as usize / 3 % 3], step, &[1; 90][..step as usize]).unwrap(),
        }
    }
}

#[test]
fn the_high_water_is_what_the_recording_finished_then_would_have_had() {
    for steps in 0..60 {
        let mut writer = McapWriter::new(options(Compression::None, 500));
        fill(&mut writer, steps);
        let high_water = writer.high_water();
        assert_eq!(writer.finish().unwrap().len() as u64, high_water, "{steps} steps");
    }
}

#[test]
fn a_budget_is_kept_to_the_byte() {
    for compression in ALL {
        let mut writer = McapWriter::new(options(compression, 500));
        fill(&mut writer, 50);
        let needed = writer.high_water();
        let within = |budget| {
            let budget = Some(budget);
            let mut writer =
                McapWriter::new(WriterOptions { byte_budget: budget, ..options(compression, 500) });
            fill(&mut writer, 49);
            let last = writer.write(2, 49, &[1; 90][..49]);
            let messages = writer.messages();
            (last, messages, writer.finish().unwrap())
        };
        let (last, messages, bytes) = within(needed);
        assert!(last.is_ok() && messages == 48, "{compression:?}: {last:?}");
        assert!(bytes.len() as u64 <= needed);
        if compression == Compression::None {
            let (last, messages, bytes) = within(needed - 1);
            let Err(McapError::BudgetExceeded { budget, needed: found }) = last else {
                panic!("{last:?}")
            };
            assert_eq!((budget, found, messages), (needed - 1, needed, 47));
            assert_eq!(read(bytes).len(), 47);
        }
    }
}

#[test]
fn the_same_input_makes_the_same_bytes_in_memory_and_in_a_file() {
    for compression in ALL {
        let make = || {
            let mut writer = McapWriter::new(options(compression, 70_000));
            let id = writer.add_connection(&connection("/a"));
            for number in 0..3_000u32 {
                let data = number.to_le_bytes().repeat(1 + number as usize % 400);
                writer.write(id, u64::from(number), &data).unwrap();
            }
            writer
        };
        let bytes = make().finish().unwrap();
        assert!(make().finish().unwrap() == bytes, "{compression:?}");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("spilled.mcap");
        let mut file = std::fs::File::create_new(&path).unwrap();
        let mut writer = options(compression, 70_000).writer(None);
        let id = writer.add_connection(&connection("/a"));
        for number in 0..3_000u32 {
            let data = number.to_le_bytes().repeat(1 + number as usize % 400);
            writer.write(id, u64::from(number), &data).unwrap();
            if number % 100 == 0 {
                writer.spill(&mut file).unwrap();
            }
        }
        assert_eq!(writer.messages(), 3_000);
        assert_eq!(writer.finish_spilled(&mut file).unwrap(), bytes.len() as u64);
        assert!(std::fs::read(&path).unwrap() == bytes, "{compression:?}");
    }
}

#[test]
fn a_file_that_takes_no_more_is_reported_with_the_offset() {
    let mut writer = McapWriter::new(options(Compression::None, 1_000));
    writer.add_connection(&connection("/a"));
    writer.write(1, 1, &[7; 2_000]).unwrap();
    let error = writer.spill(&mut &mut [0u8; 100][..]).unwrap_err();
    let expected = "the recording cannot be written on from byte 0: ";
    assert!(error.to_string().starts_with(expected), "{error}");
}

#[test]
fn connections_survive_in_ros_1_and_ros_2() {
    let ros1 = Connection {
        topic: "/map".to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        caller_id: Some("/talker".to_owned()),
        latching: true,
        ..Connection::default()
    };
    let latched = Connection {
        offered_qos: Some("- durability: 1\n".to_owned()),
        latching: true,
        ..connection("/tf_static")
    };
    let mut writer = McapWriter::new(WriterOptions::default());
    let expected = [ros1, latched, connection("/a")].map(|each| {
        let id = writer.add_connection(&each);
        Connection { id, ..each }
    });
    writer.add_connection(&connection("/never"));
    for each in &expected {
        writer.write(each.id, 1, b"x").unwrap();
    }
    let recording = Mcap::open(writer.finish().unwrap()).unwrap();
    assert_eq!(recording.connections(), expected);
}

#[test]
fn only_chunks_of_wanted_connections_are_touched() {
    let mut writer = McapWriter::new(options(Compression::Zstd, 1_000));
    let ids = ["/a", "/b"].map(|topic| writer.add_connection(&connection(topic)));
    for number in 0..100u64 {
        writer.write(ids[number as usize / 50], number, &[7; 400]).unwrap();
    }
    let mut bytes = writer.finish().unwrap();
    // In the first chunk, which has /a alone.
    let frame = bytes.windows(4).position(|word| *word == [0x28, 0xb5, 0x2f, 0xfd]).unwrap();
    bytes[frame + 30] ^= 0x55;
    // The whole file's checksum is not that of a reader of a part: without it.
    let at = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    bytes[at + 9..at + 13].fill(0);
    let recording = Mcap::open(bytes).unwrap();
    assert_eq!(recording.loss(), None);
    assert_eq!(recording.timeline(|each| each.topic == "/b").unwrap().len(), 50);
    let error = recording.timeline(|each| each.topic == "/a").unwrap_err();
    assert!(error.to_string().contains("zstd data"), "{error}");
}

#[test]
fn what_no_message_can_be_is_refused() {
    let mut writer = McapWriter::new(WriterOptions::default());
    for unknown in [0, 1, 7] {
        let error = writer.write(unknown, 1, b"x").unwrap_err();
        assert!(matches!(error, McapError::UnknownConnection(id) if id == unknown), "{error}");
    }
    let mut last = 0;
    for _ in 0..=u32::from(u16::MAX) {
        last = writer.add_connection(&connection("/a"));
    }
    writer.write(last - 1, 1, b"x").unwrap();
    let error = writer.write(last, 1, b"x").unwrap_err();
    assert_eq!(error.to_string(), "channel 65536 is one too many: an MCAP file can name 65535");
    assert_eq!(read(writer.finish().unwrap()).len(), 1);
}

/// One of each, from 0; `None` behind the last.
fn error(number: usize) -> Option<McapError> {
    let source = || io::Error::other("the disk is gone");
    Some(match number {
        0 => McapError::BudgetExceeded { budget: 3, needed: 4 },
        1 => McapError::NotMcap { found: "\"#ROSBAG\"".to_owned() },
        2 => McapError::Damaged { offset: 7, expected: "a record".to_owned() },
        3 => McapError::MemoryLimit { offset: 7, needed: 9, allowed: 8 },
        4 => McapError::Unwritten { offset: 7, source: source() },
        5 => McapError::UnknownConnection(3),
        6 => McapError::TooManyChannels(70_000),
        7 => McapError::MessageTooLong(1 << 32),
        8 => McapError::Compress(source()),
        _ => return None,
    })
}

#[test]
fn an_error_keeps_its_sentence_and_its_source_and_what_must_be_kept_apart_is() {
    for number in 0.. {
        let Some(own) = error(number) else { break };
        let given = RecordingError::from(error(number).unwrap());
        assert_eq!(given.to_string(), own.to_string());
        let source = |error: &dyn Error| error.source().map(ToString::to_string);
        assert_eq!(source(&given), source(&own), "{own}");
        let kept_apart = match given {
            RecordingError::OverBudget(_) => number == 0,
            RecordingError::Unreadable(_) => (1..=3).contains(&number),
            RecordingError::Unwritten(_) => (4..=8).contains(&number),
        };
        assert!(kept_apart, "{own}");
    }
}

const READS: &str = r#"
import sys
from mcap.reader import NonSeekingReader, SeekingReader
for kind in SeekingReader, NonSeekingReader:
    with open(sys.argv[1], "rb") as file:
        reader = kind(file, validate_crcs=True)
        found = [
            (channel.topic, schema.name, schema.encoding, schema.data, message.log_time,
             message.publish_time, message.sequence, len(message.data), sum(message.data))
            for schema, channel, message in reader.iter_messages()
        ]
    with open(sys.argv[1], "rb") as file:
        reader = kind(file, validate_crcs=True)
        attachments = [(each.name, each.data) for each in reader.iter_attachments()]
    with open(sys.argv[1], "rb") as file:
        reader = kind(file, validate_crcs=True)
        metadata = [(each.name, each.metadata) for each in reader.iter_metadata()]
    assert attachments == [("camera.yaml", b"focal: 500\n")], attachments
    assert metadata == [("about", {"robot": "r2"})], metadata
    assert {row[1:4] for row in found} == {("std_msgs/msg/String", "ros2msg", b"string data\n")}
    print([(row[0], *row[4:]) for row in found])
"#;

/// The Python of the checkout, or of `BAGPIPE_PYTHON`.
fn python() -> std::path::PathBuf {
    let ours =
        || std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../.venv/bin/python");
    let path = std::env::var_os("BAGPIPE_PYTHON").map_or_else(ours, Into::into);
    assert!(path.exists(), "{} is missing: `make set-up` installs it", path.display());
    path
}

#[test]
fn the_original_s_python_reads_what_we_write_and_every_checksum() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ours.mcap");
    for compression in ALL {
        std::fs::write(&path, sample::sample(compression)).unwrap();
        let mut command = std::process::Command::new(python());
        let done = command.args(["-c", READS]).arg(&path).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let rows = sample::messages().into_iter().map(|(topic, time, publish, number, data)| {
            let sum: u64 = data.iter().copied().map(u64::from).sum();
            format!("('{topic}', {time}, {publish}, {number}, {}, {sum})", data.len())
        });
        let line = format!("[{}]\n", rows.collect::<Vec<_>>().join(", "));
        assert_eq!(String::from_utf8(done.stdout).unwrap(), line.repeat(2), "{compression:?}");
    }
}
