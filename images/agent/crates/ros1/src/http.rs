//! The little of HTTP/1.1 that an XML-RPC server of a ROS node needs: POST with a
//! Content-Length, answers with a Content-Length, connections that stay open. [`crate::Pages`]
//! reads its requests with the same code.
//! The heads are parsed by `httparse`; roscpp, rospy, rosmaster and ureq are its clients.

use std::io::{Read, Write};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use crate::listener::Connection;

/// The largest request accepted, in bytes: a publisherUpdate with 1,000 URIs is 60 KB.
const MAX_REQUEST: usize = 16 << 20;
/// Its head alone; it is parsed again with every piece that comes.
const MAX_HEAD: usize = 64 << 10;
const MAX_FIELDS: usize = 64;
const XML: &str = "text/xml";
/// An idle connection is closed after this time; roscpp keeps one per node.
const IDLE: Duration = Duration::from_secs(60);

/// Bytes of large requests and answers that all connections of a server hold together.
const MOST_HELD: usize = 128 << 20;

/// What a server's connections hold of [`MOST_HELD`].
#[derive(Default)]
pub(crate) struct Room(AtomicUsize);

/// A part of it.
#[derive(Debug)]
struct Held<'r>(&'r AtomicUsize, usize);

impl Room {
    /// `None` where there is none for a request or an answer of so many bytes. Small ones always have
    /// some: connections have a bound.
    fn take(&self, bytes: usize) -> Option<Held<'_>> {
        let bytes = if bytes > MAX_HEAD { bytes } else { 0 };
        let with = |held: usize| Some(held + bytes).filter(|held| *held <= MOST_HELD);
        let taken = self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, with);
        taken.is_ok().then_some(Held(&self.0, bytes))
    }
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(self.1, Ordering::Relaxed);
    }
}

/// Serves one connection: `answer` gets the body of each POST and returns the XML.
pub(crate) fn serve(connection: &Connection, room: &Room, answer: impl Fn(&str) -> String) {
    let mut stream = &connection.stream;
    let ready = stream.set_nodelay(true).and_then(|()| stream.set_read_timeout(Some(IDLE)));
    if ready.and_then(|()| stream.set_write_timeout(Some(IDLE))).is_err() {
        return;
    }
    let mut buffer = Vec::new();
    loop {
        connection.is_quiet(true);
        let request = read_request(&mut stream, &mut buffer, room);
        connection.is_quiet(false);
        let written = match request {
            Ok(Some(Request { body, keep_alive, held })) => {
                let xml = answer(&body);
                drop((body, held));
                let Some(_held) = room.take(xml.len()) else { return };
                let wrote = respond(&mut stream, "200 OK", XML, &xml, keep_alive);
                wrote.is_ok() && keep_alive
            }
            Ok(None) => false,
            Err(why) => {
                // The peer may already be gone; the connection ends either way.
                let _peer_gone = respond(&mut stream, "400 Bad Request", XML, &why, false);
                false
            }
        };
        if !written {
            return;
        }
    }
}

#[derive(Debug)]
pub(crate) struct Request<'r> {
    pub(crate) body: String,
    keep_alive: bool,
    held: Held<'r>,
}

/// What a request begins with.
pub(crate) struct Head {
    pub(crate) method: String,
    pub(crate) path: String,
    length: Option<usize>,
    body_start: usize,
    keep_alive: bool,
}

/// The next request, or `None` when the connection has ended or idled out.
pub(crate) fn read_request<'r>(
    stream: &mut impl Read,
    buffer: &mut Vec<u8>,
    room: &'r Room,
) -> Result<Option<Request<'r>>, String> {
    let Some(head) = read_head(stream, buffer, MAX_HEAD)? else { return Ok(None) };
    if head.method != "POST" {
        return Err("XML-RPC is called with POST".to_owned());
    }
    let length = head.length.filter(|length| *length <= MAX_REQUEST);
    let length =
        length.ok_or_else(|| format!("a Content-Length of at most {MAX_REQUEST} is needed"))?;
    // As it comes, and as text.
    let held =
        room.take(2 * length).ok_or("too much is asked of this server at once; try again")?;
    let end = head.body_start + length;
    while buffer.len() < end {
        if !fill(stream, buffer)? {
            return Ok(None);
        }
    }
    let body = String::from_utf8_lossy(&buffer[head.body_start..end]).into_owned();
    buffer.drain(..end);
    buffer.shrink_to(MAX_HEAD);
    Ok(Some(Request { body, keep_alive: head.keep_alive, held }))
}

/// The head of the next request, or `None` when the connection has ended or idled out. `buffer`
/// never holds more than `limit` bytes and one read.
pub(crate) fn read_head(
    stream: &mut impl Read,
    buffer: &mut Vec<u8>,
    limit: usize,
) -> Result<Option<Head>, String> {
    loop {
        let head = parse_head(buffer)?;
        if head.as_ref().map_or(buffer.len(), |head| head.body_start) > limit {
            return Err(format!("the head of a request may have {limit} bytes"));
        }
        if head.is_some() {
            return Ok(head);
        }
        if !fill(stream, buffer)? {
            return Ok(None);
        }
    }
}

fn fill(stream: &mut impl Read, buffer: &mut Vec<u8>) -> Result<bool, String> {
    if buffer.len() > MAX_REQUEST {
        return Err(format!("a request may have {MAX_REQUEST} bytes"));
    }
    let mut bytes = [0; 16384];
    match stream.read(&mut bytes) {
        Ok(0) | Err(_) => Ok(false),
        Ok(read) => {
            buffer.extend_from_slice(&bytes[..read]);
            Ok(true)
        }
    }
}

fn parse_head(buffer: &[u8]) -> Result<Option<Head>, String> {
    let mut fields = [httparse::EMPTY_HEADER; MAX_FIELDS];
    let mut request = httparse::Request::new(&mut fields);
    let status = request.parse(buffer).map_err(|e| format!("this is not HTTP: {e}"))?;
    let httparse::Status::Complete(body_start) = status else {
        return Ok(None);
    };
    let field = |name: &str| {
        let found = request.headers.iter().find(|field| field.name.eq_ignore_ascii_case(name));
        found.and_then(|field| std::str::from_utf8(field.value).ok()).map(str::trim)
    };
    let length = field("content-length").and_then(|text| text.parse().ok());
    let keep_alive = match field("connection") {
        Some(word) if word.eq_ignore_ascii_case("close") => false,
        Some(word) if word.eq_ignore_ascii_case("keep-alive") => true,
        _ => request.version == Some(1),
    };
    let [method, path] = [request.method, request.path].map(|word| word.unwrap_or_default());
    let (method, path) = (method.to_owned(), path.to_owned());
    Ok(Some(Head { method, path, length, body_start, keep_alive }))
}

pub(crate) fn respond(
    stream: &mut impl Write,
    status: &str,
    content_type: &str,
    body: &str,
    keep_alive: bool,
) -> std::io::Result<()> {
    let connection = if keep_alive { "keep-alive" } else { "close" };
    // roscpp's client looks for exactly this spelling of Content-length.
    let head = format!(
        "HTTP/1.1 {status}\r\nServer: bagpipe\r\nContent-Type: {content_type}\r\n\
         Content-length: {}\r\nConnection: {connection}\r\n\r\n",
        body.len()
    );
    if body.len() > MAX_HEAD {
        stream.write_all(head.as_bytes())?;
        return stream.write_all(body.as_bytes());
    }
    stream.write_all(&[head.as_bytes(), body.as_bytes()].concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_requests_in_one_stream_are_separated() {
        let mut stream = &b"POST / HTTP/1.1\r\nContent-length: 3\r\n\r\nabcPOST /RPC2 HTTP/1.0\r\n\
            content-LENGTH:1\r\n\r\nx"[..];
        let (mut buffer, room) = (Vec::new(), Room::default());
        let first = read_request(&mut stream, &mut buffer, &room).unwrap().unwrap();
        assert_eq!((first.body.as_str(), first.keep_alive), ("abc", true));
        let second = read_request(&mut stream, &mut buffer, &room).unwrap().unwrap();
        assert_eq!((second.body.as_str(), second.keep_alive), ("x", false));
        assert!(read_request(&mut stream, &mut buffer, &room).unwrap().is_none());
    }

    #[test]
    fn large_requests_at_once_have_a_bound_and_leave_nothing_behind() {
        let large = MAX_REQUEST;
        let request = || {
            let head = format!("POST / HTTP/1.1\r\nContent-Length: {large}\r\n\r\n");
            std::io::Cursor::new(head.into_bytes()).chain(std::io::repeat(b'x'))
        };
        let (room, mut buffer) = (Room::default(), Vec::new());
        let mut all = Vec::new();
        for _ in 0..MOST_HELD / (2 * large) {
            all.push(read_request(&mut request(), &mut buffer, &room).unwrap().unwrap());
            assert!(buffer.capacity() <= 2 * MAX_HEAD, "{} bytes stay", buffer.capacity());
            buffer.clear();
        }
        let refused = read_request(&mut request(), &mut buffer, &room).unwrap_err();
        assert_eq!(refused, "too much is asked of this server at once; try again");
        all.pop();
        buffer.clear();
        assert!(read_request(&mut request(), &mut buffer, &room).is_ok());
    }

    #[test]
    fn nonsense_is_refused_with_a_sentence() {
        let endless = [b"POST / HTTP/1.1\r\nX: ", &[b'x'; 100_000][..]].concat();
        for (bytes, why) in [
            (&endless[..], "may have 65536 bytes"),
            (&b"GET / HTTP/1.1\r\n\r\n"[..], "POST"),
            (&b"POST / HTTP/1.1\r\nContent-Length: 99999999999\r\n\r\n"[..], "Content-Length"),
            (&b"\x00\x01\x02\r\n\r\n"[..], "not HTTP"),
        ] {
            let mut stream = bytes;
            let error = read_request(&mut stream, &mut Vec::new(), &Room::default()).unwrap_err();
            assert!(error.contains(why), "{error}");
        }
    }
}
