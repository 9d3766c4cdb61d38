//! Bags as other recorders leave them.

/// A bag of `count` messages as a recorder that was killed leaves it: no index.
pub fn unindexed(count: u64) -> Vec<u8> {
    let mut bytes = super::chatter(count);
    let field = bytes.windows(10).position(|window| window == b"index_pos=").unwrap() + 10;
    let position = u64::from_le_bytes(bytes[field..field + 8].try_into().unwrap());
    bytes.truncate(position as usize);
    bytes[field..field + 8].fill(0);
    bytes
}

/// A bag of format 1.2 with `count` messages on /chatter, 10 ms apart, without an index.
pub fn old_format(count: u64) -> Vec<u8> {
    let record = |fields: &[(&str, &[u8])], data: &[u8]| {
        let field = |(name, value): &(&str, &[u8])| {
            let length = (name.len() + 1 + value.len()) as u32;
            [&length.to_le_bytes()[..], name.as_bytes(), b"=", value].concat()
        };
        let header: Vec<u8> = fields.iter().flat_map(field).collect();
        let (first, second) = (header.len() as u32, data.len() as u32);
        [&first.to_le_bytes()[..], &header, &second.to_le_bytes(), data].concat()
    };
    let topic: (&str, &[u8]) = ("topic", b"/chatter");
    let datatype: (&str, &[u8]) = ("type", b"std_msgs/String");
    let md5: (&str, &[u8]) = ("md5", b"992ce8a1687cec8c8bd883ec73ca41d1");
    let mut bytes = b"#ROSBAG V1.2\n".to_vec();
    bytes.extend(record(&[("op", &[3]), ("index_pos", &[0; 8])], &[b' '; 4000]));
    let definition = [("op", &[1][..]), topic, datatype, md5, ("def", b"string data\n")];
    bytes.extend(record(&definition, &[]));
    for number in 0..count {
        let nsec = ((number % 100) as u32 * 10_000_000).to_le_bytes();
        let sec = (100 + (number / 100) as u32).to_le_bytes();
        let text = format!("message {number}");
        let data = [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat();
        let fields = [("op", &[2][..]), topic, datatype, md5, ("sec", &sec), ("nsec", &nsec)];
        bytes.extend(record(&fields, &data));
    }
    bytes
}
