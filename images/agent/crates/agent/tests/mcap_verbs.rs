//! The verbs over MCAP, and between MCAP and bags.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::process::{Command, Output};

use bagpipe_log::{Connection, MessageEncoding, Recording, SchemaEncoding};
use bagpipe_mcap::{Attachment, Compression, Mcap, McapWriter, WriterOptions};
use bagpipe_rosbag::{Bag, MemoryChunkedFile};

fn agent(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bagpipe-agent")).args(arguments).output().unwrap()
}

fn output_of(arguments: &[&str]) -> String {
    let output = agent(arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn complaint(arguments: &[&str]) -> String {
    let output = agent(arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {output:?}");
    String::from_utf8(output.stderr).unwrap()
}

const QOS: &str = "- history: 3\n  depth: 0\n  durability: 1\n";

/// 50 messages of ROS 2, 10 ms apart from 100 s on, with an attachment.
fn chatter() -> Vec<u8> {
    let compression = Compression::Zstd;
    let mut writer = McapWriter::new(WriterOptions {
        chunk_threshold: 200,
        ..WriterOptions::with_compression(compression)
    });
    let id = writer.add_connection(&Connection {
        topic: "/chatter".to_owned(),
        datatype: "std_msgs/msg/String".to_owned(),
        definition: "string data\n".into(),
        message_encoding: MessageEncoding::Cdr,
        schema_encoding: SchemaEncoding::Ros2Msg,
        offered_qos: Some(QOS.to_owned()),
        ..Connection::default()
    });
    let (name, media_type, data) = ("notes", "text/plain", &b"rain"[..]);
    writer.attach(&Attachment { log_time: 1, create_time: 0, name, media_type, data }).unwrap();
    for number in 0..50u64 {
        writer.write(id, 100_000_000_000 + number * 10_000_000, &[number as u8; 20]).unwrap();
    }
    writer.finish().unwrap()
}

fn folder_with(name: &str, bytes: &[u8]) -> (tempfile::TempDir, impl Fn(&str) -> String + use<>) {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().to_str().unwrap().to_owned();
    let path = move |name: &str| format!("{root}/{name}");
    std::fs::write(path(name), bytes).unwrap();
    (folder, path)
}

/// Connections without their numbers, and all messages.
fn content(recording: &dyn Recording) -> (Vec<Connection>, Vec<(u64, Vec<u8>)>) {
    let timeline = recording.timeline(&|_| true).unwrap();
    let messages = (0..timeline.len()).map(|at| timeline.get(at).unwrap());
    let messages = messages.map(|each| (each.time, each.data.to_vec())).collect();
    let connections = recording.connections().iter();
    (connections.map(|each| Connection { id: 0, ..each.clone() }).collect(), messages)
}

fn mcap(path: &str) -> Mcap {
    mcap_of(std::fs::read(path).unwrap())
}

fn mcap_of(bytes: Vec<u8>) -> Mcap {
    Mcap::open(bytes).unwrap()
}

#[test]
fn info_shows_mcap_and_its_damage() {
    let bytes = chatter();
    let (_folder, path) = folder_with("a.mcap", &bytes);
    let text = output_of(&["info", &path("a.mcap")]);
    for line in [
        "format     MCAP\n",
        "time       100.000000000 to 100.490000000\n",
        "duration   0.490000000 s\n",
        "messages   50\n",
        "beside     1 attachments, 0 metadata records\n",
        "/chatter          50  std_msgs/msg/String  cdr\n",
    ] {
        assert!(text.contains(line), "{line} is not in\n{text}");
    }
    std::fs::write(path("cut.mcap"), &bytes[..2000]).unwrap();
    let text = output_of(&["info", &path("cut.mcap")]);
    assert!(text.contains("messages   33\nbeside     1 attachments, 0 metadata records\ndamaged    at byte 1983: expected 114 bytes"), "{text}");
}

#[test]
fn slices_of_mcap_merge_into_one_that_checks() {
    let (_folder, path) = folder_with("a.mcap", &chatter());
    let (from, early, late, both) =
        (path("a.mcap"), path("early.mcap"), path("late.mcap"), path("both.mcap"));
    let text = output_of(&["slice", &from, "--end", "0.25", "-o", &early]);
    assert_eq!(text, format!("{early}: 25 messages, 0 latched before them\n"));
    let text = output_of(&["slice", &from, "--start", "0.25", "--topic", "/chatter", "-o", &late]);
    assert_eq!(text, format!("{late}: 25 messages, 1 latched before them\n"));
    let text = output_of(&["merge", &late, &early, "--compression", "lz4", "-o", &both]);
    assert_eq!(text, format!("{both}: 51 messages of 2 recordings\n"));
    assert_eq!(output_of(&["check", &both]), format!("{both}: 51 whole messages\n"));
    let (connections, messages) = content(&mcap(&both));
    let (expected, all) = content(&mcap(&from));
    assert_eq!(connections, expected);
    let without_latched: Vec<_> = [&messages[..25], &messages[26..]].concat().into_iter().collect();
    assert_eq!(without_latched, all);
}

#[test]
fn reindex_mends_mcap_that_was_cut() {
    let bytes = chatter();
    let (_folder, path) = folder_with("cut.mcap", &bytes[..bytes.len() / 2]);
    let (cut, whole) = (path("cut.mcap"), path("whole.mcap"));
    let text = complaint(&["check", &cut]);
    assert!(text.contains("whole messages") || text.contains("damaged at byte"), "{text}");
    let text = complaint(&["slice", &cut, "-o", &path("part.mcap")]);
    assert!(text.contains("`bagpipe-agent reindex` saves what is whole"), "{text}");
    let text = output_of(&["reindex", &cut, "-o", &whole]);
    assert!(text.contains("messages\n") && text.contains("damaged at byte"), "{text}");
    output_of(&["check", &whole]);
    let (kept, all) = (content(&mcap(&whole)), content(&Mcap::open(bytes).unwrap()));
    assert_eq!(kept.0, all.0);
    assert!(kept.1.len() > 10 && kept.1[..] == all.1[..kept.1.len()], "{}", kept.1.len());
    assert_eq!(mcap(&whole).attachments().count(), 1);
}

/// Where the records of that opcode lie in front of the summary.
fn records(bytes: &[u8], op: u8) -> Vec<usize> {
    let (mut at, mut found) = (8, Vec::new());
    while bytes[at] != 15 {
        if bytes[at] == op {
            found.push(at);
        }
        at += 9 + u64::from_le_bytes(*bytes[at + 1..].first_chunk().unwrap()) as usize;
    }
    found
}

#[test]
fn check_compares_the_times_of_message_indexes_and_reindex_writes_them_again() {
    let mut bytes = chatter();
    let (chunk, index) = (records(&bytes, 6)[1], records(&bytes, 7)[1]);
    // The second message of the chunk at the time of the first.
    bytes.copy_within(index + 15..index + 23, index + 31);
    // Without the checksum of all data.
    let end = bytes.windows(9).rposition(|head| *head == [15, 4, 0, 0, 0, 0, 0, 0, 0]).unwrap();
    bytes[end + 9..end + 13].fill(0);
    let (_folder, path) = folder_with("a.mcap", &bytes);
    let expected = format!(
        "byte {chunk}: expected messages of /chatter (channel 1) in this chunk at the times that its \
         message index has: write it again with chunks, message indexes and a summary (`bagpipe bag \
         reindex BAG --to NEW`)"
    );
    let (from, part, new) = (path("a.mcap"), path("part.mcap"), path("b.mcap"));
    for arguments in [vec!["check", &from], vec!["slice", &from, "-o", &part]] {
        let text = complaint(&arguments);
        assert!(text.contains("a.mcap: ") && text.contains(&expected), "{text}");
    }
    output_of(&["reindex", &from, "-o", &new]);
    assert_eq!(content(&mcap(&new)), content(&mcap_of(chatter())));
    output_of(&["check", &new]);
}

#[test]
fn bags_become_mcap_and_bags_again() {
    let (_folder, path) = folder_with("a.bag", &worker::chatter(50));
    let (bag, middle, back) = (path("a.bag"), path("a.mcap"), path("back.bag"));
    output_of(&["convert", &bag, "-o", &middle, "--compression", "zstd"]);
    output_of(&["check", &middle]);
    output_of(&["convert", &middle, "-o", &back, "--compression", "lz4"]);
    output_of(&["check", &back]);
    let open =
        |path: &str| Bag::open(MemoryChunkedFile::new(std::fs::read(path).unwrap())).unwrap();
    let (before, between, after) =
        (content(&open(&bag)), content(&mcap(&middle)), content(&open(&back)));
    assert_eq!(before.1.len(), 50);
    assert_eq!(before, between);
    assert_eq!(before, after);
    assert_eq!(mcap(&middle).profile(), "ros1");
}

#[test]
fn mcap_becomes_mcap_of_another_compression_with_all_that_it_has() {
    let (_folder, path) = folder_with("a.mcap", &chatter());
    let (from, to) = (path("a.mcap"), path("b.mcap"));
    let text = output_of(&["convert", &from, "-o", &to, "--compression", "lz4"]);
    assert!(text.starts_with(&format!("{to}: 50 messages, ")), "{text}");
    assert_eq!(content(&mcap(&from)), content(&mcap(&to)));
    let names: Vec<_> = mcap(&to).chunks().into_keys().collect();
    assert_eq!(names, ["lz4"]);
    assert_eq!(mcap(&to).attachments().next().unwrap().data, b"rain");
}

#[test]
fn what_can_not_be_is_refused_with_a_sentence() {
    let (_folder, path) = folder_with("a.mcap", &chatter());
    std::fs::write(path("a.bag"), worker::chatter(5)).unwrap();
    let (from, bag, new) = (path("a.mcap"), path("a.bag"), path("new.bag"));
    let text = complaint(&["convert", &from, "-o", &new]);
    assert!(text.contains("/chatter has messages in cdr, and a bag holds ROS 1's"), "{text}");
    let text = complaint(&["convert", &from, "-o", &path("new.db3")]);
    assert!(text.contains("must end in .bag or .mcap"), "{text}");
    let text = complaint(&["convert", &bag, "-o", &new, "--compression", "zstd"]);
    assert!(text.contains("a bag has no zstd: choose none, lz4 or bz2"), "{text}");
    let text = complaint(&["reindex", &from, "-o", &path("new.mcap"), "--compression", "bz2"]);
    assert!(text.contains("MCAP has no bz2: choose none, lz4 or zstd"), "{text}");
    let text = complaint(&["merge", &from, &bag, "-o", &new]);
    assert!(text.contains("`bagpipe-agent convert` makes them alike first"), "{text}");
    let text = complaint(&["slice", &from, "--topic", "/scan", "-o", &new]);
    assert!(text.contains("a.mcap has no topic /scan"), "{text}");
    let text = complaint(&["info", &from, "--memory-budget", "100"]);
    assert!(text.contains("--memory-budget allows more"), "{text}");
    assert!(!std::path::Path::new(&new).exists());
    let text = complaint(&["slice", &from, "-o", &from]);
    assert!(text.contains("is there already"), "{text}");
}

/// A folder of rosbag2 with the chatter in two files.
fn rosbag2(counted: u64) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let whole = Mcap::open(chatter()).unwrap();
    let middle = 100_200_000_000;
    for (number, (start, end)) in [(0, middle), (middle, u64::MAX)].into_iter().enumerate() {
        let window = bagpipe_log::Window { start, end };
        let latched = bagpipe_mcap::Latched::AS_RECORDED;
        let none = WriterOptions::default();
        let all = std::slice::from_ref(&whole);
        let part = bagpipe_mcap::slice(all, window, latched, |_| true, none).unwrap();
        std::fs::write(folder.path().join(format!("a_{number}.mcap")), part.bytes).unwrap();
    }
    let text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  \
         message_count: {counted}\n  relative_file_paths: [a_0.mcap, a_1.mcap]\n"
    );
    std::fs::write(folder.path().join("metadata.yaml"), text).unwrap();
    folder
}

#[test]
fn a_folder_of_rosbag2_is_one_recording() {
    // The second file has what was latched at its start, as it was recorded before it.
    let folder = rosbag2(51);
    let root = folder.path().to_str().unwrap();
    let path = |name: &str| format!("{root}/{name}");
    let text = output_of(&["info", root]);
    assert!(text.contains("format     rosbag2 (version 5), 2 files of MCAP\n"), "{text}");
    assert!(text.contains("messages   51\n"), "{text}");
    for from in [root, &path("metadata.yaml")] {
        assert_eq!(output_of(&["check", from]), format!("{from}: 51 whole messages\n"));
    }
    let text =
        output_of(&["slice", root, "--start", "0.1", "--end", "0.3", "-o", &path("part.mcap")]);
    assert_eq!(text, format!("{}: 21 messages, 1 latched before them\n", path("part.mcap")));
    output_of(&["convert", root, "-o", &path("one.mcap"), "--compression", "lz4"]);
    output_of(&["reindex", root, "-o", &path("two.mcap")]);
    let (one, two) = (content(&mcap(&path("one.mcap"))), content(&mcap(&path("two.mcap"))));
    assert_eq!((one.0.len(), one.1.len()), (1, 51));
    assert_eq!(one, two);
}

#[test]
fn check_compares_a_folder_with_its_metadata() {
    let folder = rosbag2(50);
    let text = complaint(&["check", folder.path().to_str().unwrap()]);
    assert!(text.contains("metadata.yaml counts 50 messages, and the files hold 51"), "{text}");
}

#[test]
fn what_is_wrong_in_a_folder_is_refused_with_the_file_s_name() {
    let folder = rosbag2(51);
    let root = folder.path().to_str().unwrap().to_owned();
    std::fs::write(folder.path().join("a_1.mcap"), b"SQLite format 3\0").unwrap();
    let text = complaint(&["info", &root]);
    assert!(text.contains(": a_1.mcap: byte 0: expected the 8 bytes"), "{text}");
    let text = complaint(&["check", &format!("{root}/a_1.mcap")]);
    assert!(text.contains("SQLite can't read it") || text.contains("topics: expected"), "{text}");
    std::fs::remove_file(folder.path().join("metadata.yaml")).unwrap();
    let text = complaint(&["info", &root]);
    assert!(text.contains("metadata.yaml: No such file"), "{text}");
}

/// A frame of zstd around less than 32 bytes, which it holds as they are.
fn frame_of(data: &[u8]) -> Vec<u8> {
    let length = data.len() as u8;
    let head = [0x28, 0xb5, 0x2f, 0xfd, 0x20, length, length << 3 | 1, 0, 0];
    [&head, data].concat()
}

/// The chatter in a folder of rosbag2, each message compressed alone.
fn packed_one_by_one() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let stored = mcap_of(chatter());
    let timeline = stored.timeline(|_| true).unwrap();
    let mut writer = McapWriter::new(WriterOptions {
        chunk_threshold: 200,
        ..WriterOptions::with_compression(Compression::Lz4)
    });
    let id = writer.add_connection(&stored.connections()[0]);
    for message in (0..timeline.len()).map(|at| timeline.get(at).unwrap()) {
        writer.write(id, message.time, &frame_of(message.data)).unwrap();
    }
    std::fs::write(folder.path().join("a_0.mcap"), writer.finish().unwrap()).unwrap();
    let text = "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  \
                message_count: 50\n  compression_format: zstd\n  compression_mode: MESSAGE\n  \
                relative_file_paths: [a_0.mcap]\n";
    std::fs::write(folder.path().join("metadata.yaml"), text).unwrap();
    folder
}

#[test]
fn mcap_whose_messages_were_compressed_one_by_one_is_read_by_its_folder_alone() {
    let folder = packed_one_by_one();
    let root = folder.path().to_str().unwrap();
    let path = |name: &str| format!("{root}/{name}");
    let (file, new) = (path("a_0.mcap"), path("new.mcap"));
    for arguments in [
        &["info", &file][..],
        &["check", &file],
        &["slice", &file, "--end", "0.1", "-o", &new],
        &["merge", &file, "-o", &new],
        &["convert", &file, "-o", &new],
    ] {
        let text = complaint(arguments);
        assert!(text.contains("the messages of /chatter were compressed one by one"), "{text}");
        assert!(text.contains("name that folder, or make MCAP of it"), "{text}");
        assert!(!std::path::Path::new(&new).exists(), "{arguments:?}");
    }
    output_of(&["convert", root, "-o", &new]);
    assert_eq!(output_of(&["check", &new]), format!("{new}: 50 whole messages\n"));
    assert!(content(&mcap(&new)) == content(&mcap_of(chatter())));
    // A file of the folder is mended alone, and stays one of it.
    output_of(&["reindex", &file, "-o", &path("mended.mcap")]);
    let json = Connection {
        message_encoding: MessageEncoding::Other("json".to_owned()),
        ..Connection::default()
    };
    let mut writer = McapWriter::new(WriterOptions::default());
    let id = writer.add_connection(&json);
    writer.write(id, 1, &frame_of(b"{}")).unwrap();
    std::fs::write(path("json.mcap"), writer.finish().unwrap()).unwrap();
    output_of(&["info", &path("json.mcap")]);
}
