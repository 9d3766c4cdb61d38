//! The worker's side of the pipe, as Spark's Python has it, and an agent to talk to.
#![allow(dead_code, unused_imports, clippy::unwrap_used, clippy::expect_used)]

pub mod bags;
pub mod exec;
#[path = "../../../rosbag/tests/needed/mod.rs"]
pub mod needed;
#[path = "../../../ros1/tests/graph/ports.rs"]
mod ports;

use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

use bagpipe_rosbag::{BagWriter, Connection, WriterOptions};
use bagpipe_wire::{
    Abort, AgentHello, Duplex, End, FileHeader, FrameType, Leftovers, Next, OwnedFrame, PipeError,
    WorkerHello, fifo, from_map, to_map,
};
pub use needed::without_ros;
pub use ports::free_ports;
use rmpv::Value;

/// A rospy node that answers every /chatter with an /echo.
pub const ECHO: &str = r#"exec /usr/bin/python3 -u -c '
import rospy, sys, os
from std_msgs.msg import String
rospy.init_node("echo")
out = rospy.Publisher("/echo", String, queue_size=1000)
rospy.Subscriber("/chatter", String, lambda m: out.publish("echo of " + m.data), queue_size=1000)
print("gain is", rospy.get_param("/echo/gain", None), file=sys.stderr)
rospy.spin()
'"#;

pub const SESSION: &str = "0123456789abcdef0123456789abcdef";

/// What no test should need, however slow the machine is.
pub const LONG: Duration = Duration::from_secs(300);

pub fn soon() -> Instant {
    Instant::now() + LONG
}

pub fn never() -> bool {
    false
}

/// Waits for a condition, looking at it often.
pub fn until(what: &str, limit: Duration, mut condition: impl FnMut() -> bool) -> Duration {
    let begun = Instant::now();
    while !condition() {
        assert!(begun.elapsed() < limit, "{what}: not within {limit:?}");
        std::thread::park_timeout(Duration::from_millis(2));
    }
    begun.elapsed()
}

/// A running `bagpipe-agent serve`, ended when dropped.
pub struct Agent {
    pub folder: tempfile::TempDir,
    pub process: Child,
    pub ready_after: Duration,
    /// In the environment of everything that its cases start.
    pub mark: String,
    /// Of the first slot.
    pub master_port: u16,
    number: Cell<u32>,
}

impl Agent {
    pub fn start(slots: u32) -> Self {
        Self::start_with(slots, &[], |_| {})
    }

    pub fn start_with(slots: u32, options: &[&str], more: impl Fn(&mut Command)) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let shared = folder.path();
        let begun = Instant::now();
        let master_port = free_ports(slots as u16);
        let mut command = Command::new("/bin/sh");
        // A strict umask, to see that the pipes' modes do not depend on it.
        command
            .args(["-c", "umask 077; exec \"$0\" \"$@\"", env!("CARGO_BIN_EXE_bagpipe-agent")])
            .args(["serve", "--slots", &slots.to_string()])
            .args(["--master-port", &master_port.to_string()])
            .arg("--shared")
            .arg(shared)
            .args(options)
            .stdin(Stdio::null());
        more(&mut command);
        let process = command.spawn().unwrap();
        await_ready(shared);
        let ready_after = begun.elapsed();
        let mark = format!("bagpipe-test-{}", shared.file_name().unwrap().to_str().unwrap());
        Self { folder, process, ready_after, mark, master_port, number: Cell::new(0) }
    }

    pub fn slot(&self, number: u32) -> PathBuf {
        self.folder.path().join("slots").join(number.to_string())
    }

    /// Opens a session's pipes in the order of the protocol.
    pub fn open(&self, slot: u32) -> Duplex {
        let input = fifo::open_reader(&self.slot(slot).join("from-agent")).unwrap();
        let path = self.slot(slot).join("to-agent");
        let output = fifo::open_writer(&path, soon(), &never).unwrap().expect("the agent listens");
        let mut link = Duplex::new(input);
        link.set_output(output);
        link
    }

    /// Opens a session and greets; returns after the agent's HELLO.
    pub fn greet(&self, slot: u32, case: Value) -> Duplex {
        self.number.set(self.number.get() + 1);
        let session = format!("{:032x}", self.number.get());
        let mut link = self.open(slot);
        hello(&mut link, &session, case);
        self.await_hello(slot, &mut link, &session);
        link
    }

    /// As the protocol says: throws away what is there before the agent's HELLO of this
    /// session, the end of an earlier one included.
    pub fn await_hello(&self, slot: u32, link: &mut Duplex, session: &str) {
        let open = || fifo::open_reader(&self.slot(slot).join("from-agent")).unwrap();
        let mut input = open();
        let limit = soon();
        while Instant::now() < limit {
            let readiness = fifo::await_bytes(&input, Duration::from_secs(10)).unwrap();
            let next = match readiness {
                fifo::Readiness::Bytes => Leftovers::new(input).skip(limit, &never).unwrap(),
                _ => Next::Reopen(input),
            };
            input = match next {
                Next::Reopen(old) => {
                    let new = open();
                    drop(old);
                    new
                }
                Next::Session(mut found) => {
                    let answer: AgentHello = from_map(&receive(&mut found).payload).unwrap();
                    if answer.session == session {
                        assert_eq!(answer.protocol, 1);
                        assert!(answer.pipe_bytes >= 4096);
                        link.adopt_input(found);
                        return;
                    }
                    match found.into_leftovers().skip(limit, &never).unwrap() {
                        Next::Reopen(old) => old,
                        Next::Session(_) => panic!("two HELLOs of other sessions in a row"),
                    }
                }
            };
        }
        panic!("the agent did not answer HELLO");
    }

    /// A whole session.
    pub fn run(&self, slot: u32, case: Value, bag: &[u8]) -> Answer {
        let mut link = self.greet(slot, case);
        feed(&mut link, bag);
        answer(&mut link)
    }

    /// Processes that a case of this agent started and that still run.
    pub fn left(&self) -> Vec<i32> {
        let mark = self.mark.as_bytes();
        let entries = std::fs::read_dir("/proc").unwrap().flatten();
        let pids = entries.filter_map(|entry| entry.file_name().to_str()?.parse::<i32>().ok());
        pids.filter(|pid| {
            std::fs::read(format!("/proc/{pid}/environ"))
                .is_ok_and(|environ| environ.windows(mark.len()).any(|window| window == mark))
        })
        .collect()
    }

    /// The agent's own processes for slots.
    pub fn slot_processes(&self) -> Vec<u32> {
        let folder = std::fs::read_dir(self.folder.path().join("slots")).unwrap().flatten();
        folder
            .filter_map(|slot| std::fs::read_to_string(slot.path().join("listening")).ok())
            .filter_map(|pid| pid.parse().ok())
            .collect()
    }

    /// Asks it to end, and returns how it did.
    pub fn terminate(&mut self) -> ExitStatus {
        let pid = rustix::process::Pid::from_child(&self.process);
        rustix::process::kill_process(pid, rustix::process::Signal::TERM).unwrap();
        let mut status = None;
        until("serve ended", LONG, || {
            status = self.process.try_wait().unwrap();
            status.is_some()
        });
        status.unwrap()
    }

    /// A case whose stack is `sh -c script`.
    pub fn case(&self, script: &str, deadlines: &[(&str, f64)]) -> Value {
        self.case_with(script, deadlines, vec![])
    }

    /// The same with the image's own rosmaster.
    pub fn case_with_rosmaster(&self, script: &str) -> Value {
        let mut case = self.case(script, &[]);
        let entries = |value: &mut Value| match value {
            Value::Map(entries) => std::mem::take(entries),
            _ => Vec::new(),
        };
        let mut all = entries(&mut case);
        let stack = all.iter_mut().find(|(key, _)| key.as_str() == Some("stack")).unwrap();
        let mut members = entries(&mut stack.1);
        members.push(("master".into(), "image".into()));
        stack.1 = Value::Map(members);
        Value::Map(all)
    }

    pub fn case_with(
        &self,
        script: &str,
        deadlines: &[(&str, f64)],
        parameters: Vec<(Value, Value)>,
    ) -> Value {
        // A node of Python takes as long to start, to answer and to end as the machine is slow.
        let patient = [("start", 100.0), ("subscribe", 100.0), ("drain", 60.0), ("stop", 60.0)];
        let patient = patient.iter().filter(|one| !deadlines.iter().any(|set| set.0 == one.0));
        let deadlines: Vec<_> =
            deadlines.iter().chain(patient).map(|(name, value)| (*name, (*value).into())).collect();
        map(&[
            ("id", "case-1".into()),
            ("job", "test/test".into()),
            ("window", window(0, u64::MAX)),
            ("topics", Value::Array(vec!["/chatter".into()])),
            (
                "stack",
                map(&[
                    ("command", strings(&["/bin/sh", "-c", script])),
                    ("environment", map(&[("BAGPIPE_MARK", self.mark.as_str().into())])),
                    ("parameters", Value::Map(parameters)),
                    ("remap", map(&[])),
                ]),
            ),
            ("playback", map(&[("mode", "max".into()), ("rate", 1.0.into())])),
            ("record", map(&[("topics", strings(&["/echo.*"]))])),
            ("deadlines", map(&deadlines)),
        ])
    }
}

impl Drop for Agent {
    fn drop(&mut self) {
        if matches!(self.process.try_wait(), Ok(None)) {
            self.terminate();
        }
    }
}

/// What came after the agent's HELLO.
#[derive(Debug)]
pub enum Answer {
    Result { result: Value, bag: Vec<u8>, metrics: usize },
    Abort(Abort),
    Gone(String),
}

impl Answer {
    pub fn abort(self) -> Abort {
        match self {
            Self::Abort(abort) => abort,
            other => panic!("expected ABORT, and got {other:?}"),
        }
    }

    pub fn result(self) -> (Value, Vec<u8>) {
        match self {
            Self::Result { result, bag, .. } => (result, bag),
            other => panic!("expected RESULT, and got {other:?}"),
        }
    }
}

/// SIGTERM ends an agent, and all that its case, which `hangs`, started. Given time, serve has to kill
/// nothing, as the slot kills what goes on too long; given none, it kills the slot.
pub fn sigterm_ends(hangs: impl Fn(&Agent) -> Duplex) {
    for (patience, code) in [("300000", 0), ("10", 1)] {
        let mut agent = Agent::start_with(1, &["--patience-ms", patience], |_| {});
        let link = hangs(&agent);
        assert_eq!(agent.terminate().code(), Some(code), "{patience}");
        assert_eq!(agent.left(), []);
        drop(link);
    }
}

/// Looks into a map: `at(&result, "ledger.sent")`.
pub fn at<'a>(value: &'a Value, path: &str) -> &'a Value {
    path.split('.').fold(value, |value, key| match value {
        Value::Array(items) => &items[key.parse::<usize>().unwrap()],
        Value::Map(entries) => {
            &entries.iter().find(|(name, _)| name.as_str() == Some(key)).expect(key).1
        }
        other => panic!("{key} of {other}"),
    })
}

pub fn map(entries: &[(&str, Value)]) -> Value {
    Value::Map(entries.iter().map(|(key, value)| ((*key).into(), value.clone())).collect())
}

pub fn strings(items: &[&str]) -> Value {
    Value::Array(items.iter().map(|item| (*item).into()).collect())
}

pub fn window(start: u64, end: u64) -> Value {
    map(&[("lead_in_start", start.into()), ("start", start.into()), ("end", end.into())])
}

pub fn hello(link: &mut Duplex, session: &str, case: Value) {
    let software = "test".to_owned();
    let hello = WorkerHello { session: session.to_owned(), protocol: 1, software, case };
    send(link, FrameType::Hello, &to_map(&hello).unwrap());
}

pub fn send(link: &mut Duplex, kind: FrameType, payload: &[u8]) {
    link.send(kind, payload, soon(), &never).unwrap();
}

pub fn receive(link: &mut Duplex) -> OwnedFrame {
    link.receive(soon(), &never).unwrap()
}

pub fn file_header(size: u64) -> FileHeader {
    FileHeader { name: "user.bag".to_owned(), size, ranges: vec![] }
}

/// FILE, DATA and END.
pub fn feed(link: &mut Duplex, bag: &[u8]) {
    feed_file(link, &file_header(bag.len() as u64), bag);
}

pub fn feed_file(link: &mut Duplex, header: &FileHeader, bag: &[u8]) {
    send(link, FrameType::File, &to_map(header).unwrap());
    for piece in bag.chunks(100_000) {
        send(link, FrameType::Data, piece);
    }
    let end = link.encoder().end();
    send(link, FrameType::End, &to_map(&end).unwrap());
}

/// The first frame, `None` for leftovers. A pipe that nobody has opened for writing looks
/// like one at its end, so it is waited for first.
pub fn first_frame(link: &mut Duplex) -> Option<OwnedFrame> {
    match fifo::await_bytes(link.input(), LONG).unwrap() {
        fifo::Readiness::Bytes => link.receive(soon(), &never).ok(),
        fifo::Readiness::HangUp | fifo::Readiness::Nothing => None,
    }
}

/// Reads to END or ABORT and checks the totals.
pub fn answer(link: &mut Duplex) -> Answer {
    let mut metrics = 0;
    let (mut result, mut bag) = (Value::Nil, Vec::new());
    let limit = soon();
    loop {
        let frame = match link.receive(limit, &never) {
            Ok(frame) => frame,
            Err(error @ PipeError::PeerGone(_)) => return Answer::Gone(error.to_string()),
            Err(error) => panic!("{error}"),
        };
        match frame.kind {
            FrameType::Metric => metrics += 1,
            FrameType::Result => {
                result = rmpv::decode::read_value(&mut &frame.payload[..]).unwrap();
            }
            FrameType::File => {
                let header: FileHeader = from_map(&frame.payload).unwrap();
                assert_eq!(header.name, "case-1.bag");
            }
            FrameType::Data => bag.extend_from_slice(&frame.payload),
            FrameType::End => {
                let end: End = from_map(&frame.payload).unwrap();
                let digest = link.decoder().digest();
                assert_eq!(end, End { files: 1, bytes: bag.len() as u64, digest });
                return Answer::Result { result, bag, metrics };
            }
            FrameType::Abort => return Answer::Abort(from_map(&frame.payload).unwrap()),
            kind @ (FrameType::Hello | FrameType::Step | FrameType::Answer) => {
                panic!("{} before the result", kind.name())
            }
        }
    }
}

/// `count` std_msgs/String on /chatter, 10 ms apart from second 100 on.
pub fn chatter(count: u64) -> Vec<u8> {
    let mut writer = BagWriter::new(WriterOptions::default());
    let id = writer.add_connection(&Connection {
        topic: "/chatter".to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        ..Connection::default()
    });
    for number in 0..count {
        let text = format!("message {number}");
        let data = [&(text.len() as u32).to_le_bytes(), text.as_bytes()].concat();
        writer.write(id, 100_000_000_000 + number * 10_000_000, &data).unwrap();
    }
    writer.finish().unwrap()
}

/// As a container's hook waits, which begins beside `serve`.
fn await_ready(shared: &Path) {
    let status = Command::new(env!("CARGO_BIN_EXE_bagpipe-agent"))
        .args(["ready", "--wait", "60", "--shared"])
        .arg(shared)
        .status();
    assert!(status.unwrap().success());
}
