//! Bags of format 1.2, made by hand as its page in the ROS wiki says; rosbag reads the same.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod needed;

use std::process::Command;

use bagpipe_rosbag::{
    Bag, Limits, MemoryChunkedFile, Window, WriterOptions, check, reindex, slice,
};
use needed::without_ros;

type Fields<'a> = &'a [(&'a str, &'a [u8])];

fn record(fields: Fields<'_>, data: &[u8]) -> Vec<u8> {
    let mut header = Vec::new();
    for (name, value) in fields {
        header.extend_from_slice(&((name.len() + 1 + value.len()) as u32).to_le_bytes());
        header.extend_from_slice(&[name.as_bytes(), b"=", value].concat());
    }
    let length = (header.len() as u32).to_le_bytes();
    [&length[..], &header, &(data.len() as u32).to_le_bytes(), data].concat()
}

const MD5: &[u8] = b"992ce8a1687cec8c8bd883ec73ca41d1";

/// `count` strings on /chatter, with the index that rosbag needs.
fn old(count: u32) -> Vec<u8> {
    let header = |index: u64| {
        let index = index.to_le_bytes();
        let fields: [(&str, &[u8]); 2] = [("op", &[3]), ("index_pos", &index)];
        let room = 4096 - record(&fields, &[]).len();
        record(&fields, &vec![b' '; room])
    };
    let mut bytes = [b"#ROSBAG V1.2\n", &header(0)[..]].concat();
    let mut index = Vec::new();
    for number in 0..count {
        let (sec, nsec) = ((100 + number).to_le_bytes(), 500u32.to_le_bytes());
        index.extend_from_slice(&[sec, nsec].concat());
        index.extend_from_slice(&(bytes.len() as u64).to_le_bytes());
        let topic: [(&str, &[u8]); 3] =
            [("topic", b"/chatter"), ("type", b"std_msgs/String"), ("md5", MD5)];
        if number == 0 {
            let fields = [&[("op", &[1][..]), ("def", b"string data\n")], &topic[..]].concat();
            bytes.extend_from_slice(&record(&fields, &[]));
        }
        let stamp: [(&str, &[u8]); 4] =
            [("op", &[2]), ("sec", &sec), ("nsec", &nsec), ("callerid", b"/talker")];
        let text = format!("number {number}");
        let data = [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        bytes.extend_from_slice(&record(&[&stamp[..], &topic[..]].concat(), &data));
    }
    let head = header(bytes.len() as u64);
    bytes[13..13 + 4096].copy_from_slice(&head);
    let fields: [(&str, &[u8]); 5] = [
        ("op", &[4]),
        ("ver", &[0; 4]),
        ("topic", b"/chatter"),
        ("type", b"std_msgs/String"),
        ("count", &count.to_le_bytes()),
    ];
    bytes.extend_from_slice(&record(&fields, &index));
    bytes
}

/// Where the records of the first `count` messages end: before the index, 16 bytes for each.
fn end(count: u32) -> usize {
    let empty_index = old(0).len() - 4109;
    old(count).len() - empty_index - 16 * count as usize
}

#[test]
fn a_bag_of_format_1_2_becomes_one_of_2_0() {
    let bytes = old(30);
    let made = reindex(MemoryChunkedFile::new(bytes.clone()), WriterOptions::default()).unwrap();
    assert_eq!((made.messages, &made.loss), (30, &None));
    let file = MemoryChunkedFile::new(made.bytes);
    assert!(check(&file).unwrap().sound());
    let bag = Bag::open(file).unwrap();
    let only = &bag.connections()[0];
    assert_eq!((&*only.topic, &*only.datatype), ("/chatter", "std_msgs/String"));
    assert_eq!((&*only.definition, only.caller_id.as_deref()), ("string data\n", Some("/talker")));
    let timeline = bag.timeline(|_| true).unwrap();
    let last = timeline.get(29).unwrap();
    assert_eq!((last.time, &last.data[4..]), (129_000_000_500, &b"number 29"[..]));
    // Cut anywhere, what is whole stays.
    for cut in (4109..bytes.len()).step_by(11) {
        let part = MemoryChunkedFile::new(bytes[..cut].to_vec());
        let made = reindex(part, WriterOptions::default()).unwrap();
        let whole = (0..=30).rev().find(|count| end(*count) <= cut).unwrap();
        assert_eq!(made.messages, u64::from(whole), "cut at {cut}");
        let back = Bag::open(MemoryChunkedFile::new(made.bytes)).unwrap();
        assert_eq!(back.message_count(), made.messages);
    }
}

#[test]
fn a_bag_of_format_1_2_is_read_as_it_is() {
    let bytes = old(30);
    let bag = Bag::open(MemoryChunkedFile::new(bytes.clone())).unwrap();
    assert_eq!((bag.format(), bag.message_count(), bag.loss()), ("1.2", 30, None));
    assert_eq!(bag.time_range(), Some((100_000_000_500, 129_000_000_500)));
    let timeline = bag.timeline(|each| each.topic == "/chatter").unwrap();
    let texts: Vec<_> = timeline.iter().map(|each| each.data[4..].to_vec()).collect();
    let expected: Vec<_> = (0..30).map(|number| format!("number {number}").into_bytes()).collect();
    assert_eq!(texts, expected);
    assert_eq!(timeline.get(7).unwrap().frame[..4], 12u32.to_le_bytes());
    let window = Window { start: 110_000_000_500, end: 120_000_000_500 };
    let part = slice(&bag, window, |_| true, WriterOptions::default()).unwrap();
    assert_eq!((part.messages, part.whole_chunks), (10, 0));
    let file = MemoryChunkedFile::new(bytes.clone());
    assert!(check(&file).unwrap().sound());
    // An index that says otherwise is a problem.
    let mut wrong = bytes.clone();
    let at = wrong.windows(6).rposition(|window| window == b"count=").unwrap() + 6;
    wrong[at] = 29;
    let problems = check(&MemoryChunkedFile::new(wrong)).unwrap().problems;
    assert_eq!(problems, ["the index counts 29 messages, and the bag holds 30"]);
    // The messages, and the one definition for their publisher.
    let needed = 10 * (46 + 12) + 20 * (46 + 13) + 8 + 15 + 12;
    let limited =
        |bytes| Bag::open_limited(file.clone(), Limits { decompressed_bytes: bytes }).map(|_| ());
    assert!(limited(needed).is_ok(), "{:?}", limited(needed));
    let error = limited(needed - 1).unwrap_err().to_string();
    assert!(error.ends_with("bytes of memory, and the limit leaves 58"), "{error}");
}

#[test]
fn damage_in_a_bag_of_format_1_2_is_told_in_bytes_and_messages() {
    let mut bytes = old(30);
    // The header length of the record behind the twelfth message.
    let at = end(12);
    bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let length = bytes.len();
    let bag = Bag::open(MemoryChunkedFile::new(bytes.clone())).unwrap();
    let loss = bag.loss().unwrap();
    assert_eq!((bag.message_count(), loss.offset), (12, at as u64));
    // Its index is whole and still says how many there were.
    assert_eq!((loss.bytes, loss.messages), ((length - at) as u64, Some(18)));
    let cut = Bag::open(MemoryChunkedFile::new(bytes[..length - 1].to_vec())).unwrap();
    assert_eq!(cut.loss().unwrap().messages, None);
}

#[test]
fn one_definition_for_many_publishers_takes_no_more_than_allowed() {
    let definition = vec![b'#'; 100_000];
    let topic: (&str, &[u8]) = ("topic", b"/a");
    let mut bytes = b"#ROSBAG V1.2\n".to_vec();
    bytes.extend(record(&[("op", &[3]), ("index_pos", &[0; 8])], &[]));
    let fields = [("op", &[1][..]), topic, ("type", b"a/B"), ("md5", MD5), ("def", &definition)];
    bytes.extend(record(&fields, &[]));
    for number in 0..1000u32 {
        let caller = format!("/{number}");
        let (time, caller) = (number.to_le_bytes(), ("callerid", caller.as_bytes()));
        bytes.extend(record(&[("op", &[2]), topic, ("sec", &time), ("nsec", &time), caller], b"x"));
    }
    let limits = Limits { decompressed_bytes: 16 * bytes.len() as u64 };
    let error = Bag::open_limited(MemoryChunkedFile::new(bytes), limits).unwrap_err();
    assert!(error.to_string().contains("bytes of memory, and the limit leaves"), "{error}");
}

#[test]
fn rosbag_reads_the_same_1_2_bag() {
    if without_ros() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("old.bag");
    std::fs::write(&path, old(30)).unwrap();
    // Its public read_messages fails for 1.2 (an argument too many), its reader does not.
    let program = "import rosbag, sys; b = rosbag.Bag(sys.argv[1]); \
        r = b._reader.read_messages(None, None, None, None, False); \
        print(b.version, [(str(t), m.data) for _, m, t in r][-1])";
    let mut command = Command::new("/usr/bin/python3");
    let done = command.args(["-c", program]).arg(&path).output().unwrap();
    let text = String::from_utf8_lossy(&done.stdout).into_owned();
    assert_eq!(text, "102 ('129000000500', 'number 29')\n", "{done:?}");
}
