//! Folders that tests make, as rosbag2 would: by SQLite itself, and by our own writer of MCAP.
#![allow(dead_code)] // each test file uses its own part

use std::path::Path;

use bagpipe_mcap::{Channel, Mcap, McapWriter, Schema, Stamp, WriterOptions};
use rusqlite::Connection;

pub const QOS: &str = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2";
pub const LATCHED: &str = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 1";
/// 60 messages in turn on /a, /b and the latched /map.
pub const MESSAGES: u64 = 60;
pub const TOPICS: [&str; 3] = ["/a", "/b", "/map"];

/// A message as tests compare it: topic, type, quality of service, time and data.
pub type Plain = (String, String, String, u64, Vec<u8>);

pub fn qos(topic: &str) -> &'static str {
    if topic == "/map" { LATCHED } else { QOS }
}

/// The message of that number: each second one came before the first.
pub fn message(number: u64) -> Plain {
    let topic = TOPICS[number as usize % 3];
    let data = (0..40 + number).map(|byte| (byte * 31 + number * 7) as u8).collect();
    let time = 1_700_000_000_000_000_000 + (number ^ 1) * 1_000_000;
    (topic.to_owned(), "std_msgs/msg/String".to_owned(), qos(topic).to_owned(), time, data)
}

/// Those messages by time.
pub fn messages(numbers: std::ops::Range<u64>) -> Vec<Plain> {
    let mut all: Vec<Plain> = numbers.map(message).collect();
    all.sort_by_key(|each| each.3);
    all
}

/// The tables as distributions of ROS 2 made them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    Foxy,
    Humble,
    Jazzy,
}

pub const FORMS: [Form; 3] = [Form::Foxy, Form::Humble, Form::Jazzy];

const FOXY: &str = "
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,
  serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,
  timestamp INTEGER NOT NULL, data BLOB NOT NULL);
CREATE INDEX timestamp_idx ON messages (timestamp ASC);";
const HUMBLE: &str = "
CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);
CREATE TABLE metadata(id INTEGER PRIMARY KEY, metadata_version INTEGER NOT NULL,
  metadata TEXT NOT NULL);
INSERT INTO schema VALUES (3, 'humble');";
const JAZZY: &str = "
ALTER TABLE topics ADD COLUMN type_description_hash TEXT NOT NULL DEFAULT '';
CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,
  encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,
  type_description_hash TEXT NOT NULL);
INSERT INTO message_definitions VALUES
  (1, 'std_msgs/msg/String', 'ros2msg', 'string data\n', 'RIHS01_00');";

/// A file of SQLite with these messages, each changed by `packed` on its way.
pub fn database(
    path: &Path,
    form: Form,
    numbers: std::ops::Range<u64>,
    packed: impl Fn(&[u8]) -> Vec<u8>,
) {
    let file = Connection::open(path).unwrap();
    file.execute_batch(FOXY).unwrap();
    if form != Form::Foxy {
        file.execute_batch(HUMBLE).unwrap();
    }
    if form == Form::Jazzy {
        file.execute_batch(JAZZY).unwrap();
    }
    for (id, topic) in TOPICS.iter().enumerate() {
        file.execute(
            "INSERT INTO topics (id, name, type, serialization_format, offered_qos_profiles)
             VALUES (?1, ?2, 'std_msgs/msg/String', 'cdr', ?3)",
            (id as i64 + 7, topic, qos(topic)),
        )
        .unwrap();
    }
    for number in numbers {
        let (_, _, _, time, data) = message(number);
        file.execute(
            "INSERT INTO messages (topic_id, timestamp, data) VALUES (?1, ?2, ?3)",
            (number as i64 % 3 + 7, time as i64, packed(&data)),
        )
        .unwrap();
    }
}

/// MCAP of these messages.
pub fn mcap(numbers: std::ops::Range<u64>, packed: impl Fn(&[u8]) -> Vec<u8>) -> Vec<u8> {
    let mut writer =
        McapWriter::new(WriterOptions { profile: "ros2".to_owned(), ..WriterOptions::default() });
    let schema = Schema {
        id: 0,
        name: "std_msgs/msg/String".to_owned(),
        encoding: "ros2msg".to_owned(),
        data: b"string data\n".to_vec(),
    };
    let ids = TOPICS.map(|topic| {
        let metadata = [("offered_qos_profiles".to_owned(), qos(topic).to_owned())];
        let channel = Channel {
            topic: topic.to_owned(),
            message_encoding: "cdr".to_owned(),
            metadata: metadata.into(),
            ..Channel::default()
        };
        writer.add_channel(Some(&schema), &channel)
    });
    for number in numbers {
        let (_, _, _, time, data) = message(number);
        let stamp = Stamp { sequence: 0, publish_time: time };
        writer.write_stamped(ids[number as usize % 3], time, stamp, &packed(&data)).unwrap();
    }
    writer.finish().unwrap()
}

/// The text of a `metadata.yaml`.
pub fn metadata(version: u64, storage: &str, files: &[&str], mode: &str) -> String {
    let format = if mode.is_empty() { "" } else { "zstd" };
    let files: String = files.iter().map(|file| format!("    - {file}\n")).collect();
    let topics: String = TOPICS
        .iter()
        .map(|topic| {
            let qos = if version < 9 {
                format!("{:?}", qos(topic))
            } else {
                format!("\n          {}", qos(topic).replace('\n', "\n          "))
            };
            format!(
                "    - topic_metadata:\n        name: {topic}\n        type: std_msgs/msg/String\n\
                 \x20       serialization_format: cdr\n        offered_qos_profiles: {qos}\n\
                 \x20     message_count: {}\n",
                MESSAGES / 3
            )
        })
        .collect();
    format!(
        "rosbag2_bagfile_information:\n  version: {version}\n  storage_identifier: {storage}\n\
         \x20 duration:\n    nanoseconds: 59000000\n  starting_time:\n\
         \x20   nanoseconds_since_epoch: 1700000000000000000\n  message_count: {MESSAGES}\n\
         \x20 topics_with_message_count:\n{topics}  compression_format: \"{format}\"\n\
         \x20 compression_mode: \"{mode}\"\n  relative_file_paths:\n{files}"
    )
}

pub fn zstd(data: &[u8]) -> Vec<u8> {
    zstd::encode_all(data, 1).unwrap()
}

/// A folder of two files of that storage, compressed in that way (``, `FILE` or `MESSAGE`).
pub fn folder(at: &Path, version: u64, storage: &str, form: Form, mode: &str) {
    let packed = |data: &[u8]| if mode == "MESSAGE" { zstd(data) } else { data.to_vec() };
    let ending = if storage == "mcap" { "mcap" } else { "db3" };
    let mut names = Vec::new();
    for (part, numbers) in [0..20, 20..MESSAGES].into_iter().enumerate() {
        let mut name = format!("drive_{part}.{ending}");
        let path = at.join(&name);
        if storage == "mcap" {
            std::fs::write(&path, mcap(numbers, packed)).unwrap();
        } else {
            database(&path, form, numbers, packed);
        }
        if mode == "FILE" {
            let bytes = std::fs::read(&path).unwrap();
            std::fs::remove_file(&path).unwrap();
            name.push_str(".zstd");
            std::fs::write(at.join(&name), zstd(&bytes)).unwrap();
        }
        names.push(name);
    }
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    std::fs::write(at.join("metadata.yaml"), metadata(version, storage, &names, mode)).unwrap();
}

/// All messages of files in order of time, as the seam gives them.
pub fn read(files: &[Mcap]) -> Vec<Plain> {
    let mut found = Vec::new();
    for file in files {
        assert_eq!(file.loss(), None);
        let timeline = file.timeline(|_| true).unwrap();
        for each in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
            let of = file.connections().iter().find(|of| of.id == each.connection).unwrap();
            let qos = of.offered_qos.clone().unwrap_or_default();
            let (topic, datatype) = (of.topic.clone(), of.datatype.clone());
            found.push((topic, datatype, qos, each.time, each.data.to_vec()));
        }
    }
    found.sort_by_key(|each| each.3);
    found
}
