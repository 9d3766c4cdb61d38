//! A small bag whose chunks are to be damaged.

use bagpipe_rosbag::{BagWriter, Compression, Connection, WriterOptions};

/// 100 messages in turn on /a and /b, in some ten chunks.
pub fn sample(compression: Compression) -> Vec<u8> {
    let options = WriterOptions { compression, chunk_threshold: 1500, byte_budget: None };
    let mut writer = BagWriter::new(options);
    for topic in ["/a", "/b"] {
        writer.add_connection(&Connection {
            topic: topic.to_owned(),
            datatype: "std_msgs/String".to_owned(),
            md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".into(),
            caller_id: Some("/talker".to_owned()),
            latching: topic == "/b",
            ..Connection::default()
        });
    }
    for number in 0..100u64 {
        let data: Vec<u8> = (0..50 + number).map(|byte| (byte * 31 + number * 7) as u8).collect();
        writer.write((number % 2) as u32, number * 1_000_000, &data).unwrap();
    }
    writer.finish().unwrap()
}
