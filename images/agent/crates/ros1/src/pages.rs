//! A small web server for pages that are asked for again and again, such as metrics: GET alone,
//! one request for each connection, everything bounded. Whoever sends garbage, sends slowly or
//! opens many connections takes a few threads for a few seconds, and nothing else.

use std::io::{Error, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use crate::RosError;
use crate::http::{self, Head};
use crate::listener::Listener;

/// The largest head of a request, in bytes; Prometheus' has some hundred.
const MAX_HEAD: usize = 8 << 10;
/// The time of a connection from its first byte to its last.
const PATIENCE: Duration = Duration::from_secs(5);
/// Connections that are served at once; more wait in the kernel's backlog.
const MAX_SERVED: usize = 8;

/// A page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Page {
    /// Its media type.
    pub content_type: &'static str,
    /// Its text.
    pub text: String,
}

/// Serves pages until it is dropped.
pub struct Pages {
    listener: Listener,
}

impl Pages {
    /// Listens on `address`, whose port 0 means a free one. `page` gets a path, without what
    /// follows a question mark, and is called on a thread of its own.
    ///
    /// # Errors
    /// The address can't be had.
    pub fn serve(
        name: &str,
        address: SocketAddr,
        page: impl Fn(&str) -> Option<Page> + Send + Sync + 'static,
    ) -> Result<Pages, RosError> {
        let listener = Listener::start(name, address, MAX_SERVED, move |connection| {
            let stream = &connection.stream;
            answer(Hurried { stream, until: Instant::now() + PATIENCE }, &page);
        })?;
        Ok(Pages { listener })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.listener.address()
    }
}

/// The head of a connection's one request.
pub(crate) fn read(stream: &mut impl Read) -> Result<Option<Head>, String> {
    http::read_head(stream, &mut Vec::new(), MAX_HEAD)
}

fn answer(mut stream: Hurried<'_>, page: &impl Fn(&str) -> Option<Page>) {
    const PLAIN: &str = "text/plain; charset=utf-8";
    let (status, content_type, text) = match read(&mut stream) {
        Ok(None) => return,
        Err(why) => ("400 Bad Request", PLAIN, format!("{why}\n")),
        Ok(Some(head)) if head.method != "GET" => {
            ("405 Method Not Allowed", PLAIN, "pages are read with GET\n".to_owned())
        }
        Ok(Some(head)) => match page(head.path.split('?').next().unwrap_or_default()) {
            Some(Page { content_type, text }) => ("200 OK", content_type, text),
            None => ("404 Not Found", PLAIN, "there is no such page here\n".to_owned()),
        },
    };
    // The peer may be gone; the connection ends either way.
    let _peer_gone = http::respond(&mut stream, status, content_type, &text, false);
}

/// A connection that must be over at some time, however little it moves at once.
struct Hurried<'c> {
    stream: &'c TcpStream,
    until: Instant,
}

impl Hurried<'_> {
    fn left(&self) -> std::io::Result<Duration> {
        let left = self.until.saturating_duration_since(Instant::now());
        if left.is_zero() { Err(Error::from(ErrorKind::TimedOut)) } else { Ok(left) }
    }
}

impl Read for Hurried<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(bytes)
    }
}

impl Write for Hurried<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pages() -> Pages {
        Pages::serve("pages", (std::net::Ipv4Addr::LOCALHOST, 0).into(), |path| {
            (path == "/here")
                .then(|| Page { content_type: "text/plain", text: "a page\n".to_owned() })
        })
        .unwrap()
    }

    fn response(pages: &Pages, request: &[u8]) -> String {
        let mut stream = TcpStream::connect(pages.address()).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(request).unwrap();
        stream.shutdown(std::net::Shutdown::Write).unwrap();
        let mut answer = Vec::new();
        // A server that closes on more than it wants to read resets the connection.
        let _reset = stream.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    #[test]
    fn only_a_get_request_for_the_page_is_answered_with_it() {
        let pages = pages();
        let found = response(&pages, b"GET /here?x=1 HTTP/1.1\r\nHost: a\r\n\r\n");
        assert!(found.starts_with("HTTP/1.1 200 OK\r\n"), "{found}");
        assert!(found.contains("Content-length: 7\r\nConnection: close\r\n"), "{found}");
        assert!(found.ends_with("\r\n\r\na page\n"), "{found}");
        for (request, status) in [
            (&b"GET /there HTTP/1.1\r\n\r\n"[..], "404 "),
            (&b"POST /here HTTP/1.1\r\nContent-Length: 9\r\n\r\n"[..], "405 "),
            (&b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n"[..], "400 "),
        ] {
            let answer = response(&pages, request);
            assert!(answer.starts_with(&format!("HTTP/1.1 {status}")), "{answer}");
        }
        assert_eq!(response(&pages, b""), "");
    }

    #[test]
    fn a_head_is_read_up_to_its_bound_and_no_further() {
        let endless = std::io::repeat(b'x');
        let mut stream = (&b"GET /here HTTP/1.1\r\nX: "[..]).chain(endless).take(1 << 30);
        let Err(error) = read(&mut stream) else { panic!("it was read") };
        assert_eq!(error, "the head of a request may have 8192 bytes");
        assert!((1 << 30) - stream.limit() <= (8 << 10) + (16 << 10) + 23);
    }

    #[test]
    fn slow_and_silent_peers_hold_a_page_up_for_some_seconds_only() {
        let pages = pages();
        let slow: Vec<TcpStream> = (0..MAX_SERVED)
            .map(|_| {
                let mut stream = TcpStream::connect(pages.address()).unwrap();
                stream.write_all(b"GET /here HT").unwrap();
                stream
            })
            .collect();
        let begun = Instant::now();
        let found = response(&pages, b"GET /here HTTP/1.1\r\n\r\n");
        assert!(found.ends_with("a page\n"), "{found}");
        assert!(begun.elapsed() < 4 * PATIENCE, "{:?}", begun.elapsed());
        drop(slow);
    }
}
