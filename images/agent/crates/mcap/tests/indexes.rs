//! Message indexes, by which cases are planned, and what they say of their chunks' messages.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use bagpipe_mcap::{Compression, Limits, Mcap, check};
use sample::{ALL, Form, sample, theirs};

fn record(op: u8, content: &[u8]) -> Vec<u8> {
    [&[op][..], &(content.len() as u64).to_le_bytes(), content].concat()
}

fn a_channel(id: u8, topic: &[u8; 2]) -> Vec<u8> {
    record(4, &[&[id, 0, 0, 0, 2, 0, 0, 0][..], topic, &[3, 0, 0, 0], b"cdr", &[0; 4]].concat())
}

fn a_message(channel: u8, time: u64) -> Vec<u8> {
    let time = time.to_le_bytes();
    record(5, &[&[channel, 0, 0, 0, 0, 0][..], &time, &time, b"data"].concat())
}

fn a_chunk(messages: &[(u8, u64)]) -> Vec<u8> {
    let records = messages.iter().flat_map(|(channel, time)| a_message(*channel, *time));
    let records: Vec<u8> = records.collect();
    let times = || messages.iter().map(|(_, time)| *time);
    let stated = [times().min().unwrap(), times().max().unwrap()].map(u64::to_le_bytes).concat();
    let length = (records.len() as u64).to_le_bytes();
    record(6, &[&stated[..], &length, &[0; 8], &length, &records].concat())
}

fn an_index(channel: u8, times: &[u64]) -> Vec<u8> {
    let entries = times.iter().flat_map(|time| [time.to_le_bytes(), [0; 8]].concat());
    let entries: Vec<u8> = entries.collect();
    record(7, &[&[channel, 0][..], &(entries.len() as u32).to_le_bytes(), &entries].concat())
}

/// Two channels, a chunk with their messages, and these indexes behind it.
fn part(indexes: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"\x89MCAP0\r\n".to_vec();
    bytes.extend([record(1, &[0; 8]), a_channel(1, b"/a"), a_channel(2, b"/b")].concat());
    bytes.extend(a_chunk(&[(1, 10), (2, 11), (1, 12), (1, 14), (2, 19)]));
    bytes.extend(indexes.concat());
    bytes.extend([record(15, &[0; 4]), record(2, &[0; 20])].concat());
    bytes.extend(b"\x89MCAP0\r\n");
    bytes
}

/// Where the chunk of such a part lies.
fn chunk() -> u64 {
    (8 + 17 + 2 * a_channel(1, b"/a").len()) as u64
}

#[test]
fn a_message_index_with_just_its_chunk_s_messages_is_sound_in_any_order() {
    let b = an_index(2, &[11, 19]);
    for indexes in [
        vec![],
        vec![an_index(1, &[10, 12, 14]), b.clone()],
        vec![b.clone(), an_index(1, &[14, 10, 12])],
        // Of a channel without a message, and a channel's in two records.
        vec![an_index(1, &[12]), b, an_index(1, &[10, 14]), an_index(3, &[])],
    ] {
        let found = Mcap::open(part(&indexes)).unwrap();
        assert_eq!((found.loss(), found.message_count()), (None, 5));
    }
}

#[test]
fn a_message_index_with_other_messages_than_its_chunk_is_reported_with_its_topic() {
    let (a, b) = (an_index(1, &[10, 12, 14]), an_index(2, &[11, 19]));
    let times = |of: &str| {
        format!("messages of {of} in this chunk at the times that its message index has: ")
    };
    let count = |of: &str, named: u64, found: u64| {
        format!(
            "{named} messages of {of} in this chunk, as its message index has them, found {found}: "
        )
    };
    let (of_a, of_b) = ("/a (channel 1)", "/b (channel 2)");
    for (indexes, begins) in [
        (vec![an_index(1, &[10, 10, 10]), b.clone()], times(of_a)),
        // What one time has too much another has too little.
        (vec![an_index(1, &[10, 11, 15]), b.clone()], times(of_a)),
        (vec![a.clone(), an_index(2, &[11, 18])], times(of_b)),
        (vec![a.clone(), an_index(2, &[11])], count(of_b, 1, 2)),
        (vec![a.clone()], count(of_b, 0, 2)),
        (vec![a, b, an_index(7, &[13])], count("channel 7", 1, 0)),
    ] {
        let bytes = part(&indexes);
        let found = Mcap::open(bytes.clone()).unwrap();
        let loss = found.loss().unwrap();
        assert_eq!((loss.offset, loss.bytes, loss.messages), (chunk(), 0, Some(0)));
        assert!(loss.description.starts_with(&begins), "{}", loss.description);
        assert!(loss.description.contains("bagpipe bag reindex"), "{}", loss.description);
        assert_eq!(found.message_count(), 5);
        assert!(!check(bytes, Limits::default()).unwrap().sound());
    }
}

/// Where message indexes lie, with as many entries as that.
fn indexes(bytes: &[u8], least: usize) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 < bytes.len() {
        let length = u64::from_le_bytes(*bytes[at + 1..].first_chunk().unwrap()) as usize;
        if bytes[at] == 7 && length >= 6 + 16 * least {
            found.push(at);
        }
        at += 9 + length;
    }
    found
}

#[test]
fn what_writers_write_is_sound_until_a_time_of_an_index_is_another() {
    let form =
        |compression| Form { compression, chunked: true, summary: true, index: true, crc: false };
    let by_them = ALL.map(|each| theirs(form(each)));
    for (bytes, compression) in ALL.map(sample).into_iter().chain(by_them).zip(ALL.repeat(2)) {
        // Without the checksum of all data, which would be the first to be wrong.
        let end = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
        let mut bytes = bytes;
        bytes[end + 9..end + 13].fill(0);
        assert!(check(bytes.clone(), Limits::default()).unwrap().sound());
        // The second entry has the time of the first.
        let index = indexes(&bytes, 2)[0];
        bytes.copy_within(index + 15..index + 23, index + 31);
        let found = check(bytes.clone(), Limits::default()).unwrap();
        let loss = found.loss.unwrap();
        assert!(loss.description.starts_with("messages of /"), "{loss:?}");
        assert_eq!((found.messages, loss.messages), (100, Some(0)));
        let opened = Mcap::open(bytes).unwrap();
        if compression == Compression::None {
            assert_eq!(opened.loss(), Some(&loss));
        } else {
            // What is still compressed is compared when it is read.
            let error = opened.timeline(|_| true).unwrap_err().to_string();
            assert_eq!(error, format!("byte {}: expected {}", loss.offset, loss.description));
        }
    }
}
