//! Small bags.
#![allow(dead_code)] // each test file uses its own part

use bagpipe_rosbag::{Bag, BagWriter, Compression, Connection, MemoryChunkedFile, WriterOptions};

/// How the agent records.
pub fn in_lz4() -> WriterOptions {
    WriterOptions::with_compression(Compression::Lz4)
}

/// A std_msgs/String connection.
pub fn words(topic: &str, caller_id: &str, latching: bool) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        caller_id: Some(caller_id.to_owned()),
        latching,
        ..Connection::default()
    }
}

/// A bag of strings: connections, then (connection, milliseconds, text).
pub fn bag_of_words(
    connections: &[Connection],
    messages: &[(usize, u64, &str)],
) -> Bag<MemoryChunkedFile> {
    let mut writer = BagWriter::new(WriterOptions::default());
    let ids: Vec<u32> = connections.iter().map(|c| writer.add_connection(c)).collect();
    for (connection, milliseconds, text) in messages {
        let data = [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        writer.write(ids[*connection], milliseconds * 1_000_000, &data).unwrap();
    }
    Bag::open(MemoryChunkedFile::new(writer.finish().unwrap())).unwrap()
}

/// A bag of (connection, data), a millisecond apart.
pub fn bag_of(
    connections: &[Connection],
    messages: impl Iterator<Item = (usize, Vec<u8>)>,
) -> Bag<MemoryChunkedFile> {
    packed(connections, messages, WriterOptions::default())
}

/// The same, in the chunks that are asked for.
pub fn packed(
    connections: &[Connection],
    messages: impl Iterator<Item = (usize, Vec<u8>)>,
    options: WriterOptions,
) -> Bag<MemoryChunkedFile> {
    let mut writer = BagWriter::new(options);
    let ids: Vec<u32> = connections.iter().map(|c| writer.add_connection(c)).collect();
    for (number, (connection, data)) in messages.enumerate() {
        writer.write(ids[connection], 1_000_000 * number as u64, &data).unwrap();
    }
    Bag::open(MemoryChunkedFile::new(writer.finish().unwrap())).unwrap()
}
