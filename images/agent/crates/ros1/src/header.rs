//! The TCPROS connection header: `u32` total, then fields `u32 length, name=value`.
//! Source: <https://wiki.ros.org/ROS/Connection%20Header>; all integers little-endian.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// The largest header accepted, in bytes; message definitions are the bulk of it.
const MAX_HEADER: usize = 16 << 20;

/// The fields of a connection header.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ConnectionHeader(BTreeMap<String, String>);

impl ConnectionHeader {
    /// An empty header.
    pub(crate) fn new() -> Self {
        Self::default()
    }

    /// The header with one more field.
    pub(crate) fn with(mut self, name: &str, value: &str) -> Self {
        self.0.insert(name.to_owned(), value.to_owned());
        self
    }

    /// A field's value; absent fields are `None`.
    pub fn get(&self, name: &str) -> Option<&str> {
        self.0.get(name).map(String::as_str)
    }

    /// A field's value, or the empty text.
    pub fn text(&self, name: &str) -> &str {
        self.get(name).unwrap_or_default()
    }

    /// Whether the publisher latches its last message.
    pub fn latching(&self) -> bool {
        self.get("latching") == Some("1")
    }

    /// The bytes on the wire, with the total length in front.
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut bytes = vec![0; 4];
        for (name, value) in &self.0 {
            let length = (name.len() + 1 + value.len()) as u32;
            bytes.extend_from_slice(&length.to_le_bytes());
            bytes.extend_from_slice(name.as_bytes());
            bytes.push(b'=');
            bytes.extend_from_slice(value.as_bytes());
        }
        let total = (bytes.len() - 4) as u32;
        bytes[..4].copy_from_slice(&total.to_le_bytes());
        bytes
    }

    /// Parses the fields (without the total length).
    pub(crate) fn decode(mut bytes: &[u8]) -> Result<Self, String> {
        let mut fields = BTreeMap::new();
        while !bytes.is_empty() {
            let (length, rest) = bytes
                .split_first_chunk::<4>()
                .ok_or("a field's length is cut off in its connection header")?;
            let length = u32::from_le_bytes(*length) as usize;
            if length > rest.len() {
                return Err(format!(
                    "a field of its connection header claims {length} bytes where {} are left",
                    rest.len()
                ));
            }
            let (field, rest) = rest.split_at(length);
            let text = String::from_utf8_lossy(field);
            let (name, value) = text
                .split_once('=')
                .ok_or("a field of its connection header has no equals sign")?;
            fields.insert(name.to_owned(), value.to_owned());
            bytes = rest;
        }
        Ok(Self(fields))
    }

    /// Reads a header from a blocking stream, all of it within `deadline`: a peer may send it byte by
    /// byte. The stream's read timeout is changed.
    pub(crate) fn receive(stream: &TcpStream, deadline: Duration) -> Result<Self, String> {
        Self::read(&mut Until { stream, end: Instant::now() + deadline })
    }

    /// Reads a header.
    pub(crate) fn read(stream: &mut impl Read) -> Result<Self, String> {
        let mut length = [0; 4];
        stream.read_exact(&mut length).map_err(|e| format!("no connection header came: {e}"))?;
        let length = u32::from_le_bytes(length) as usize;
        if length > MAX_HEADER {
            return Err(format!(
                "its connection header claims {length} bytes; at most {MAX_HEADER} are accepted"
            ));
        }
        let mut bytes = Vec::new();
        let read = stream
            .take(length as u64)
            .read_to_end(&mut bytes)
            .map_err(|e| format!("its connection header broke off: {e}"))?;
        if read != length {
            return Err(format!("its connection header ended after {read} of {length} bytes"));
        }
        Self::decode(&bytes)
    }
}

/// A stream that is read up to a moment.
struct Until<'s> {
    stream: &'s TcpStream,
    end: Instant,
}

impl Read for Until<'_> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(ErrorKind::TimedOut.into());
        }
        self.stream.set_read_timeout(Some(left))?;
        self.stream.read(into)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn a_header_that_comes_byte_by_byte_has_a_deadline_as_a_whole() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let peer = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        let sender = std::thread::spawn(move || {
            let mut stream = listener.accept().unwrap().0;
            stream.write_all(&10_000_u32.to_le_bytes()).unwrap();
            let trickle = |_: &u32| {
                std::thread::sleep(Duration::from_millis(10));
                stream.write_all(&[0]).is_ok()
            };
            (0..10_000).take_while(trickle).count()
        });
        let error = ConnectionHeader::receive(&peer, Duration::from_millis(300)).unwrap_err();
        drop(peer);
        assert!(error.starts_with("its connection header broke off"), "{error}");
        let sent = sender.join().unwrap();
        assert!(sent < 9_000, "{sent} of 10,000 bytes were read");
    }

    #[test]
    fn the_example_of_the_wiki_is_encoded_to_the_byte() {
        let header = ConnectionHeader::new()
            .with("md5sum", "992ce8a1687cec8c8bd883ec73ca41d1")
            .with("topic", "/chatter")
            .with("tcp_nodelay", "0");
        let bytes = header.encode();
        assert_eq!(&bytes[..4], &(bytes.len() as u32 - 4).to_le_bytes());
        assert_eq!(&bytes[4..8], &39u32.to_le_bytes());
        assert_eq!(&bytes[8..15], b"md5sum=");
        assert_eq!(ConnectionHeader::read(&mut bytes.as_slice()).unwrap(), header);
    }

    #[test]
    fn damage_is_a_sentence_and_allocates_nothing_large() {
        let huge = u32::MAX.to_le_bytes();
        assert!(ConnectionHeader::read(&mut huge.as_slice()).unwrap_err().contains("at most"));
        let cut = [9, 0, 0, 0, 200, 0, 0, 0, b'a'];
        let error = ConnectionHeader::read(&mut cut.as_slice()).unwrap_err();
        assert_eq!(error, "its connection header ended after 5 of 9 bytes");
        let error = ConnectionHeader::decode(&cut[4..]).unwrap_err();
        assert!(error.contains("claims 200 bytes where 1 are left"), "{error}");
        assert!(ConnectionHeader::decode(&[1, 0, 0, 0, b'a']).unwrap_err().contains("equals"));
    }

    #[test]
    fn a_definition_may_contain_equals_signs_and_newlines() {
        let header = ConnectionHeader::new().with("message_definition", "int8 A=1\nint8 b");
        let bytes = header.encode();
        let read = ConnectionHeader::read(&mut bytes.as_slice()).unwrap();
        assert_eq!(read.text("message_definition"), "int8 A=1\nint8 b");
        assert!(!read.latching());
    }
}
