//! Small recordings, by our own writer and by the crate `mcap`, in every form of the format.
#![allow(dead_code)] // each test file uses its own part

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;

use bagpipe_log::{MessageEncoding, SchemaEncoding};
use bagpipe_mcap::{
    Attachment, Compression, Connection, Mcap, McapWriter, Metadata, Stamp, WriterOptions,
};

pub const ALL: [Compression; 3] = [Compression::None, Compression::Lz4, Compression::Zstd];
/// 100 messages in turn on /a and /b.
pub const MESSAGES: u64 = 100;

/// A message as tests compare it: topic, time, when it was published, number, data.
pub type Plain = (String, u64, u64, u32, Vec<u8>);

pub fn connection(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/msg/String".to_owned(),
        definition: "string data\n".into(),
        message_encoding: MessageEncoding::Cdr,
        schema_encoding: SchemaEncoding::Ros2Msg,
        offered_qos: Some("- history: 1\n  durability: 2\n".to_owned()),
        ..Connection::default()
    }
}

/// The message of that number: each second one came before the first, and some were published
/// long ago.
pub fn message(number: u64) -> Plain {
    let topic = ["/a", "/b"][number as usize % 2].to_owned();
    let time = 1_700_000_000_000_000_000 + (number ^ 1) * 1_000_000;
    let published = if number % 10 == 3 { number } else { time - 500_000 };
    let data = (0..50 + number).map(|byte| (byte * 31 + number * 7) as u8).collect();
    (topic, time, published, number as u32, data)
}

/// All messages of the samples by time.
pub fn messages() -> Vec<Plain> {
    let mut all: Vec<Plain> = (0..MESSAGES).map(message).collect();
    all.sort_by_key(|(_, time, ..)| *time);
    all
}

pub const ATTACHMENT: Attachment<'_> = Attachment {
    log_time: 5,
    create_time: 0,
    name: "camera.yaml",
    media_type: "text/yaml",
    data: b"focal: 500\n",
};

pub fn metadata() -> Metadata {
    let entries = BTreeMap::from([("robot".to_owned(), "r2".to_owned())]);
    Metadata { name: "about".to_owned(), entries }
}

/// By our own writer, in some ten chunks, with an attachment and metadata.
pub fn sample(compression: Compression) -> Vec<u8> {
    let profile = "ros2".to_owned();
    let options = WriterOptions { compression, chunk_threshold: 1500, profile, byte_budget: None };
    let mut writer = McapWriter::new(options);
    let ids = ["/a", "/b"].map(|topic| writer.add_connection(&connection(topic)));
    writer.describe(&metadata()).unwrap();
    for number in 0..MESSAGES {
        if number == 50 {
            writer.attach(&ATTACHMENT).unwrap();
        }
        let (_, time, publish_time, sequence, data) = message(number);
        let stamp = Stamp { sequence, publish_time };
        writer.write_stamped(ids[number as usize % 2], time, stamp, &data).unwrap();
    }
    writer.finish().unwrap()
}

/// How the crate `mcap` writes.
#[derive(Debug, Clone, Copy)]
pub struct Form {
    pub compression: Compression,
    pub chunked: bool,
    pub summary: bool,
    pub index: bool,
    pub crc: bool,
}

/// Every one that differs.
pub fn forms() -> Vec<Form> {
    let mut forms = Vec::new();
    for compression in ALL {
        for bits in 0..16u8 {
            let [chunked, summary, index, crc] = [1, 2, 4, 8].map(|bit| bits & bit != 0);
            if chunked || compression == Compression::None {
                forms.push(Form { compression, chunked, summary, index, crc });
            }
        }
    }
    forms
}

/// The sample by the crate `mcap`.
pub fn theirs(form: Form) -> Vec<u8> {
    let Form { compression, chunked, summary, index, crc } = form;
    let compression = match compression {
        Compression::None => None,
        Compression::Lz4 => Some(mcap::Compression::Lz4),
        Compression::Zstd => Some(mcap::Compression::Zstd),
    };
    let options = mcap::WriteOptions::new()
        .compression(compression)
        .profile("ros2")
        .chunk_size(Some(1500))
        .use_chunks(chunked)
        .emit_summary_records(summary)
        .emit_summary_offsets(summary)
        .emit_message_indexes(index)
        .calculate_chunk_crcs(crc)
        .calculate_data_section_crc(crc)
        .calculate_summary_section_crc(crc)
        .calculate_attachment_crcs(crc);
    let mut writer = options.create(Cursor::new(Vec::new())).unwrap();
    let schema = writer.add_schema("std_msgs/msg/String", "ros2msg", b"string data\n").unwrap();
    let qos = "- history: 1\n  durability: 2\n".to_owned();
    let map = BTreeMap::from([("offered_qos_profiles".to_owned(), qos)]);
    let ids = ["/a", "/b"].map(|topic| writer.add_channel(schema, topic, "cdr", &map).unwrap());
    let about = metadata();
    let about = mcap::records::Metadata { name: about.name, metadata: about.entries };
    writer.write_metadata(&about).unwrap();
    for number in 0..MESSAGES {
        if number == 50 {
            let Attachment { log_time, create_time, name, media_type, data } = ATTACHMENT;
            let (name, media_type) = (name.to_owned(), media_type.to_owned());
            let data = Cow::Borrowed(data);
            let file = mcap::Attachment { log_time, create_time, name, media_type, data };
            writer.attach(&file).unwrap();
        }
        let (_, log_time, publish_time, sequence, data) = message(number);
        let channel_id = ids[number as usize % 2];
        let head = mcap::records::MessageHeader { channel_id, sequence, log_time, publish_time };
        writer.write_to_known_channel(&head, &data).unwrap();
    }
    writer.finish().unwrap();
    writer.into_inner().into_inner()
}

/// All messages in order, as the seam and the stamps say.
pub fn read(recording: &Mcap) -> Vec<Plain> {
    let timeline = recording.timeline(|_| true).unwrap();
    let mut found = Vec::new();
    let topic =
        |id: u32| recording.connections().iter().find(|each| each.id == id).unwrap().topic.clone();
    for message in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
        assert_eq!(message.frame[..4], (message.data.len() as u32).to_le_bytes());
        assert_eq!(message.frame[4..], *message.data);
        found.push((topic(message.connection), message.time, 0, 0, message.data.to_vec()));
    }
    for (place, plain) in timeline.into_parts().1.iter().zip(&mut found) {
        let stamp = recording.stamp(place).unwrap();
        (plain.2, plain.3) = (stamp.publish_time, stamp.sequence);
    }
    found
}
