//! Slices and merges: nothing is lost, nothing is doubled, the order stays; and what `check` finds.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use bagpipe_mcap::{
    Connection, Latched, Limits, Mcap, McapWriter, Sliced, Stamp, Window, WriterOptions, check,
    merge, slice,
};
use proptest::prelude::*;
use sample::{ALL, ATTACHMENT, Form, Plain, connection, forms, metadata, read, sample, theirs};

fn open(bytes: &[u8]) -> Mcap {
    Mcap::open(bytes.to_vec()).unwrap()
}

fn options(chunk_threshold: usize) -> WriterOptions {
    WriterOptions { chunk_threshold, profile: "ros2".to_owned(), ..WriterOptions::default() }
}

/// As rosbag2 records a topic of transient-local publishers, and a volatile one.
fn latched(topic: &str) -> Connection {
    let profiles = match topic {
        "/deep" => {
            "- history: keep_last\n  depth: 2\n  durability: transient_local\n- durability: 2\n  \
             depth: 9\n- history: 3\n  depth: 0\n  durability: 1\n"
        }
        _ => "- history: 3\n  durability: 1\n",
    };
    let datatype = if topic == "/tf_static" { "tf2_msgs/msg/TFMessage" } else { "room_msgs/Map" };
    Connection {
        offered_qos: Some(profiles.to_owned()),
        latching: true,
        datatype: datatype.to_owned(),
        ..connection(topic)
    }
}

/// Two plain topics, and latched ones with how many of their messages are in force.
fn topics() -> [Connection; 5] {
    [connection("/a"), connection("/b"), latched("/map"), latched("/tf_static"), latched("/deep")]
}

const IN_FORCE: [(&str, usize); 3] = [("/map", 1), ("/tf_static", 100), ("/deep", 3)];

/// What a subscriber that joins at that time would get, of messages by time.
fn in_force(all: &[Plain], at: u64) -> Vec<Plain> {
    let mut wanted = Vec::new();
    for (topic, most) in IN_FORCE {
        let before = |each: &&(usize, &Plain)| each.1.0 == topic && each.1.1 < at;
        let found: Vec<_> = all.iter().enumerate().filter(|each| before(&each)).collect();
        wanted.extend_from_slice(&found[found.len().saturating_sub(most)..]);
    }
    wanted.sort_by_key(|(number, _)| *number);
    wanted.into_iter().map(|(_, each)| each.clone()).collect()
}

/// Messages of (topic, time), each with data and a number of its own.
fn written(messages: &[(usize, u64)], chunk_threshold: usize) -> Vec<u8> {
    let mut writer = McapWriter::new(options(chunk_threshold));
    let ids = topics().map(|each| writer.add_connection(&each));
    for (number, (topic, time)) in messages.iter().enumerate() {
        let stamp = Stamp { sequence: number as u32, publish_time: time / 2 };
        writer.write_stamped(ids[*topic], *time, stamp, &[number as u8; 40]).unwrap();
    }
    writer.finish().unwrap()
}

fn cut(files: &[Mcap], start: u64, end: u64, latched: Latched<'_>) -> Sliced {
    slice(files, Window { start, end }, latched, |_| true, options(500)).unwrap()
}

fn sound(bytes: &[u8]) -> u64 {
    let found = check(bytes.to_vec(), Limits::default()).unwrap();
    assert!(found.sound(), "{found:?}");
    found.messages
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn slices_of_a_recording_are_the_recording(
        messages in prop::collection::vec((0..5usize, 0..1000u64), 1..60),
        mut edges in prop::collection::vec(1..1000u64, 0..4),
        threshold in 40..2000usize,
    ) {
        let whole = open(&written(&messages, threshold));
        let all = read(&whole);
        edges.extend([0, u64::MAX]);
        edges.sort_unstable();
        edges.dedup();
        let files = [whole];
        let mut parts: Vec<Plain> = Vec::new();
        for pair in edges.windows(2) {
            let made = cut(&files, pair[0], pair[1], Latched::AT_START);
            sound(&made.bytes);
            let found = read(&open(&made.bytes));
            let (first, rest) = found.split_at(made.latched as usize);
            let mut expected = in_force(&all, pair[0]);
            expected.iter_mut().for_each(|each| each.1 = pair[0]);
            prop_assert_eq!(first, expected);
            prop_assert_eq!(rest.len() as u64, made.messages);
            parts.extend_from_slice(rest);
        }
        prop_assert_eq!(parts, all);
    }

    #[test]
    fn files_that_follow_each_other_are_cut_as_one(
        messages in prop::collection::vec((0..5usize, 0..1000u64), 2..60),
        split in 0..60usize,
        start in 1..1000u64,
    ) {
        let mut ordered = messages;
        ordered.sort_by_key(|(_, time)| *time);
        let whole = open(&written(&ordered, 300));
        // The numbers of messages count on, and the channels of the second file are others.
        let (first, second) = ordered.split_at(split.min(ordered.len()));
        let mut writer = McapWriter::new(options(300));
        let mut ids = topics();
        ids.reverse();
        let ids = ids.map(|each| writer.add_connection(&each));
        for (number, (topic, time)) in second.iter().enumerate() {
            let number = number + first.len();
            let stamp = Stamp { sequence: number as u32, publish_time: time / 2 };
            writer.write_stamped(ids[4 - topic], *time, stamp, &[number as u8; 40]).unwrap();
        }
        let files = [open(&written(first, 300)), open(&writer.finish().unwrap())];
        let joined = open(&merge(&files, options(300)).unwrap());
        prop_assert_eq!(read(&joined), read(&whole));
        let topics = joined.connections().iter().map(|each| &each.topic);
        prop_assert_eq!(topics.collect::<std::collections::BTreeSet<_>>().len(),
                        joined.connections().len());
        for latched in [Latched::AT_START, Latched::AS_RECORDED] {
            let (of_files, of_one) =
                (cut(&files, start, 900, latched), cut(std::slice::from_ref(&whole), start, 900, latched));
            prop_assert_eq!(read(&open(&of_files.bytes)), read(&open(&of_one.bytes)));
            prop_assert_eq!(of_files.latched, of_one.latched);
        }
    }
}

#[test]
fn a_slice_has_only_the_topics_that_are_asked_for_and_nothing_about_the_whole() {
    for compression in ALL {
        let file = open(&sample(compression));
        let all = read(&file);
        let asked = |each: &Connection| each.topic == "/b";
        let window = Window { start: all[20].1, end: all[70].1 };
        let made = slice(&[file], window, Latched::AT_START, asked, options(900)).unwrap();
        let part = open(&made.bytes);
        let expected: Vec<Plain> =
            all[20..70].iter().filter(|each| each.0 == "/b").cloned().collect();
        assert_eq!((made.messages, made.latched), (25, 0));
        assert!(read(&part) == expected);
        assert_eq!(part.connections().len(), 1);
        assert_eq!((part.metadata().len(), part.attachments().count()), (0, 0));
        assert_eq!(part.profile(), "ros2");
    }
}

#[test]
fn a_message_at_the_last_time_that_there_is_belongs_to_the_whole() {
    let file = open(&written(&[(0, 5), (1, u64::MAX)], 40));
    assert_eq!(read(&file).len(), 2);
    assert_eq!(read(&open(&merge(&[file], options(40)).unwrap())).len(), 2);
}

#[test]
fn a_merge_keeps_what_stands_beside_the_messages() {
    let one = open(&sample(ALL[1]));
    let merged = open(&merge(&[&one, &one], options(1000)).unwrap());
    assert_eq!(merged.message_count(), 200);
    assert_eq!(merged.connections().len(), 2);
    assert_eq!(merged.metadata(), [metadata(), metadata()]);
    assert_eq!(merged.attachments().collect::<Vec<_>>(), [ATTACHMENT, ATTACHMENT]);
    assert_eq!(merged.profile(), "ros2");
}

#[test]
fn what_rosbag2_wrote_about_a_folder_is_untrue_of_a_merge() {
    let mut writer = McapWriter::new(options(1000));
    let about = bagpipe_mcap::Metadata { name: "rosbag2".to_owned(), ..metadata() };
    writer.describe(&about).unwrap();
    let file = open(&writer.finish().unwrap());
    let count = |files: &[&Mcap]| open(&merge(files, options(9)).unwrap()).metadata().len();
    assert_eq!((count(&[&file]), count(&[&file, &file])), (1, 0));
}

#[test]
fn two_publishers_that_look_alike_stay_two() {
    let mut writer = McapWriter::new(options(1000));
    let ids = [0, 1].map(|_| writer.add_connection(&connection("/a")));
    for (time, id) in [(1, ids[0]), (2, ids[1])] {
        writer.write(id, time, b"data").unwrap();
    }
    let file = open(&writer.finish().unwrap());
    assert_eq!(open(&merge(&[&file, &file], options(9)).unwrap()).connections().len(), 2);
}

#[test]
fn every_form_of_a_sound_file_checks() {
    for form in forms() {
        assert_eq!(sound(&theirs(form)), 100, "{form:?}");
    }
    for compression in ALL {
        assert_eq!(sound(&sample(compression)), 100);
    }
}

/// Where the fields of the records of that kind begin.
fn records(bytes: &[u8], kind: u8) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while at + 9 < bytes.len() {
        if bytes[at] == kind {
            found.push(at + 9);
        }
        at += 9 + u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize;
    }
    found
}

#[test]
fn an_index_that_contradicts_the_chunks_is_found() {
    let form = Form { compression: ALL[1], chunked: true, summary: true, index: true, crc: false };
    let whole = theirs(form);
    let problems = |bytes: Vec<u8>| check(bytes, Limits::default()).unwrap().problems;
    // The first chunk has declarations alone.
    let chunk = |nth: usize| records(&whole, 6)[nth] - 9;
    for (nth, field, expected) in [
        (1, 0, "the chunk indexes from 1700000000000000001 to".to_owned()),
        (2, 0, format!("the summary has wrong times for the chunk at byte {}", chunk(2))),
        (1, 16, format!("the message indexes of the chunk at byte {} lie", chunk(1) + 1)),
    ] {
        let mut bytes = whole.clone();
        bytes[records(&whole, 8)[nth] + field] += 1;
        let found = problems(bytes).join("\n");
        assert!(found.contains(&expected), "{found}\n{expected}");
    }
}

#[test]
fn damage_in_a_chunk_is_found_though_the_index_is_whole() {
    let whole = sample(ALL[2]);
    let chunk = records(&whole, 6)[2];
    let mut bytes = whole.clone();
    bytes[chunk + 60] ^= 0xff;
    let found = check(bytes, Limits::default()).unwrap();
    assert!(found.messages < 100 && !found.sound(), "{found:?}");
    let lost = found.loss.unwrap();
    assert!(lost.bytes > 1000, "{lost:?}");
}

#[test]
fn a_topic_of_two_types_is_a_problem() {
    let mut writer = McapWriter::new(options(1000));
    let other = Connection { datatype: "a/msg/B".to_owned(), ..connection("/a") };
    for (time, each) in [(1, connection("/a")), (2, other)] {
        let id = writer.add_connection(&each);
        writer.write(id, time, b"data").unwrap();
    }
    let found = check(writer.finish().unwrap(), Limits::default()).unwrap();
    assert_eq!(found.problems, ["topic /a is std_msgs/msg/String and a/msg/B"]);
    let mut writer = McapWriter::new(options(1000));
    let other = Connection { definition: "int8 data\n".into(), ..connection("/a") };
    for (time, each) in [(1, connection("/a")), (2, other)] {
        let id = writer.add_connection(&each);
        writer.write(id, time, b"data").unwrap();
    }
    let found = check(writer.finish().unwrap(), Limits::default()).unwrap();
    let of = |field: &str| format!("std_msgs/msg/String (field 1 of std_msgs/String: {field})");
    let both = format!("topic /a is {} and {}", of("string data"), of("int8 data"));
    assert_eq!(found.problems, [both]);
}

#[test]
fn of_transforms_whose_publishers_are_not_named_a_hundred_are_in_force() {
    let transforms: Vec<_> = (0..150).map(|time| (3, time)).chain([(2, 3), (2, 4)]).collect();
    let file = open(&written(&transforms, 300));
    let all = read(&file);
    let files = [file];
    let made = cut(&files, 150, 900, Latched::AS_RECORDED);
    let found = read(&open(&made.bytes));
    assert_eq!((made.messages, made.latched, found.len()), (0, 101, 101));
    assert!(found == in_force(&all, 150));
    assert_eq!((found[0].0.as_str(), found[0].1, found[1].1), ("/map", 4, 50));
    let none = |_: &Connection| 0;
    let volatile = Latched { as_recorded: true, in_force: &none };
    assert_eq!(cut(&files, 150, 900, volatile).latched, 0);
    let two = |each: &Connection| if each.topic == "/tf_static" { 2 } else { 0 };
    let fewer = cut(&files, 150, 900, Latched { as_recorded: false, in_force: &two });
    let times: Vec<_> = read(&open(&fewer.bytes)).iter().map(|each| (each.1, each.3)).collect();
    assert_eq!(times, [(150, 148), (150, 149)]);
}

#[test]
fn channels_that_are_alike_are_publishers_of_their_own() {
    let mut writer = McapWriter::new(options(300));
    let ids = [latched("/map"), latched("/map")].map(|each| writer.add_connection(&each));
    for (id, time) in [(0, 1), (0, 2), (1, 3), (1, 4)] {
        writer.write_stamped(ids[id], time, Stamp::default(), &[time as u8]).unwrap();
    }
    let files = [open(&writer.finish().unwrap())];
    let made = cut(&files, 9, 10, Latched::AS_RECORDED);
    let times: Vec<_> = read(&open(&made.bytes)).iter().map(|each| each.1).collect();
    assert_eq!(times, [2, 4]);
}
