//! An endpoint over Fast DDS (`tests/ros2/fastdds`) in a process of its own: what it writes and reads.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::OnceLock;
use std::sync::mpsc::{Receiver, channel};
use std::time::Instant;

use crate::standin::{Graph, LONG, number};

/// The program, built by the first who needs it where `make set-up` has not built it.
fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../..");
        let mut command = Command::new("python3");
        command.args(["-m", "tests.ros2_standin", "fastdds"]).current_dir(checkout);
        let made = command.output().unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        Path::new(String::from_utf8(made.stdout).unwrap().trim()).join("fastdds_endpoint")
    })
}

/// What an endpoint reported: its kind's letter, and bytes.
type Frame = (u8, Vec<u8>);

/// An endpoint that runs; dropping it kills it.
pub struct Peer {
    child: Child,
    input: Option<ChildStdin>,
    frames: Receiver<Frame>,
    /// How many it has matched, by what it reported until now; `None` before the first match.
    pub matched: Option<i32>,
    /// How many writers offer less than a reader asks for.
    pub refused: i32,
    /// The messages of a reader.
    pub messages: Vec<Vec<u8>>,
    published: i32,
    acknowledged: Option<bool>,
    /// The number of the last message that a reader has, taken or not.
    newest: Option<u64>,
    looks: usize,
}

impl Peer {
    /// `what` as its usage has it: `read|write TOPIC TYPE DEPTH RELIABILITY DURABILITY`.
    pub fn start(graph: &Graph, what: &str) -> Peer {
        let mut child = Command::new(program())
            .args(what.split(' '))
            .envs(graph.environment())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut output = child.stdout.take().unwrap();
        let (send, frames) = channel();
        std::thread::spawn(move || {
            while let Some(frame) = next_frame(&mut output) {
                if send.send(frame).is_err() {
                    break;
                }
            }
        });
        Peer {
            input: child.stdin.take(),
            child,
            frames,
            matched: None,
            refused: 0,
            messages: Vec::new(),
            published: 0,
            acknowledged: None,
            newest: None,
            looks: 0,
        }
    }

    /// A reader that takes from the first message on.
    pub fn reader(graph: &Graph, what: &str) -> Peer {
        let mut peer = Peer::start(graph, &format!("read {what}"));
        peer.take();
        peer
    }

    pub fn writer(graph: &Graph, what: &str) -> Peer {
        Peer::start(graph, &format!("write {what}"))
    }

    /// A reader takes from here on.
    pub fn take(&mut self) {
        self.send(b'T', &[]);
    }

    /// Waits until this is the last message that a reader has, which it does not take.
    pub fn until_newest(&mut self, number: u64) {
        let late = Instant::now() + LONG;
        while self.newest != Some(number) {
            assert!(Instant::now() < late, "{:?}", self.newest);
            let looks = self.looks;
            self.send(b'L', &[]);
            self.until("a look", |peer| peer.looks > looks);
        }
    }

    /// A writer publishes it.
    pub fn publish(&mut self, bytes: &[u8]) {
        self.send(b'D', bytes);
    }

    /// Waits until all that it published is acknowledged by its reliable readers.
    pub fn acknowledged(&mut self, published: i32) {
        self.send(b'A', &[]);
        self.until("an answer", |peer| peer.acknowledged.is_some());
        assert_eq!((self.published, self.acknowledged.take()), (published, Some(true)));
    }

    fn send(&mut self, kind: u8, bytes: &[u8]) {
        let input = self.input.as_mut().unwrap();
        let length = u32::try_from(bytes.len()).unwrap().to_le_bytes();
        input.write_all(&[&[kind][..], &length, bytes].concat()).unwrap();
    }

    fn note(&mut self, (kind, bytes): Frame) {
        let count = || i32::from_le_bytes(bytes[..].try_into().unwrap());
        match kind {
            b'M' => self.matched = Some(count()),
            b'Q' => self.refused = count(),
            b'P' => self.published = count(),
            b'A' => self.acknowledged = Some(count() == 1),
            b'D' => self.messages.push(bytes),
            b'L' => {
                self.looks += 1;
                self.newest = (!bytes.is_empty()).then(|| number(&bytes)).or(self.newest);
            }
            other => panic!("a frame of kind {other}"),
        }
    }

    /// Waits until it holds of what was reported.
    pub fn until(&mut self, what: &str, mut holds: impl FnMut(&Peer) -> bool) {
        let late = Instant::now() + LONG;
        while !holds(self) {
            let left = late.saturating_duration_since(Instant::now());
            let frame = self.frames.recv_timeout(left);
            let have = (self.messages.len(), self.matched, self.published);
            self.note(frame.unwrap_or_else(|error| panic!("never {what}: {error}, {have:?}")));
        }
    }

    pub fn until_matched(&mut self, count: i32) {
        self.until("a match", |peer| peer.matched == Some(count));
    }

    pub fn until_refused(&mut self) {
        self.until("a writer that offers too little", |peer| peer.refused > 0);
    }

    pub fn until_messages(&mut self, count: usize) {
        self.until("all messages", |peer| peer.messages.len() >= count);
    }

    /// Has it leave its domain, and waits until it has ended: what it reported until then is noted.
    pub fn leave(&mut self) {
        drop(self.input.take());
        assert!(self.child.wait().unwrap().success());
        while let Ok(frame) = self.frames.recv_timeout(LONG) {
            self.note(frame);
        }
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        let _ended_already = self.child.kill();
        let _status = self.child.wait();
    }
}

fn next_frame(from: &mut impl Read) -> Option<Frame> {
    let mut head = [0; 5];
    from.read_exact(&mut head).ok()?;
    let length = u32::from_le_bytes(head[1..].try_into().unwrap());
    let mut bytes = vec![0; length as usize];
    from.read_exact(&mut bytes).ok()?;
    Some((head[0], bytes))
}
