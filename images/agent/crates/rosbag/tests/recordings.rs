//! Bags to who knows no format: the same bytes, messages and sentences.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests

use std::error::Error;
use std::io;

use bagpipe_log::{Recording, RecordingError, RecordingFormat, RecordingWriter};
use bagpipe_rosbag::{
    Bag, BagError, BagWriter, Compression, Connection, MemoryChunkedFile, WriterOptions,
};

fn connection(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/String".to_owned(),
        ..Connection::default()
    }
}

fn in_lz4() -> WriterOptions {
    WriterOptions::with_compression(Compression::Lz4)
}

/// Messages of two topics, of which each second one came before the first.
fn fill(writer: &mut dyn RecordingWriter) {
    let ids = ["/a", "/b"].map(|topic| writer.add_connection(&connection(topic)));
    for number in 0..200_u64 {
        let data = [number as u8; 9_000];
        writer.write(ids[number as usize % 2], 1_000 + (number ^ 1), &data).unwrap();
    }
}

#[test]
fn what_is_written_without_knowing_the_format_is_the_writer_s_own_bag() {
    let mut own = BagWriter::new(WriterOptions { byte_budget: Some(1 << 30), ..in_lz4() });
    fill(&mut own);
    let mut writer = in_lz4().writer(Some(1 << 30));
    fill(writer.as_mut());
    assert_eq!(writer.messages(), own.messages());
    let bag = own.finish().unwrap();
    assert_eq!(writer.finish().unwrap(), bag);

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("spilled.bag");
    let mut file = std::fs::File::create_new(&path).unwrap();
    let mut writer = in_lz4().writer(None);
    fill(writer.as_mut());
    writer.spill(&mut file).unwrap();
    assert_eq!(writer.finish_spilled(&mut file).unwrap(), bag.len() as u64);
    assert_eq!(std::fs::read(&path).unwrap(), bag);
}

#[test]
fn the_high_water_is_the_writer_s_own() {
    let mut own = BagWriter::new(WriterOptions::default());
    let mut writer = WriterOptions::default().writer(None);
    fill(&mut own);
    fill(writer.as_mut());
    assert_eq!(writer.high_water(), own.high_water());
}

#[test]
fn what_is_read_without_knowing_the_format_is_the_bag_s_own_timeline() {
    let mut writer = in_lz4().writer(None);
    fill(writer.as_mut());
    let bag = Bag::open(MemoryChunkedFile::new(writer.finish().unwrap())).unwrap();
    let recording: &dyn Recording = &bag;
    assert_eq!(recording.connections(), bag.connections());
    let of_b = |each: &Connection| each.topic == "/b";
    let (own, read) = (bag.timeline(of_b).unwrap(), recording.timeline(&of_b).unwrap());
    assert_eq!(read.len(), 100);
    assert!(own.iter().eq((0..read.len()).filter_map(|index| read.get(index))));
    assert!(own.iter().is_sorted_by_key(|message| message.time));
}

#[test]
fn the_budget_that_is_asked_for_holds_and_not_the_options_own() {
    let options = WriterOptions { byte_budget: Some(10_000), ..WriterOptions::default() };
    for (budget, fits) in [(Some(5_000), false), (Some(30_000), true), (None, true)] {
        let mut writer = options.writer(budget);
        let id = writer.add_connection(&connection("/a"));
        match writer.write(id, 1, &[0; 20_000]) {
            Err(RecordingError::OverBudget(_)) => assert!(!fits),
            written => assert!(fits && written.is_ok(), "{written:?}"),
        }
    }
}

/// One of each, from 0; `None` behind the last.
fn error(number: usize) -> Option<BagError> {
    let source = || io::Error::other("the disk is gone");
    Some(match number {
        0 => BagError::BudgetExceeded { budget: 3, needed: 4 },
        1 => BagError::Io { offset: 7, length: 9, source: source() },
        2 => BagError::NotABag { found: "\"MCAP\"".to_owned() },
        3 => BagError::Encrypted { encryptor: "aes".to_owned() },
        4 => BagError::Damaged { offset: 7, expected: "a record".to_owned() },
        5 => BagError::MemoryLimit { offset: 7, needed: 9, allowed: 8 },
        6 => BagError::Unwritten { offset: 7, source: source() },
        7 => BagError::UnknownConnection(3),
        8 => BagError::MessageTooLong(1 << 32),
        9 => BagError::Compress(source()),
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
            RecordingError::Unreadable(_) => (1..=5).contains(&number),
            RecordingError::Unwritten(_) => (6..=9).contains(&number),
        };
        assert!(kept_apart, "{own}");
    }
}
