//! One session: HELLO, the bag, the case, and its answer.

use std::cell::RefCell;
use std::fs::File;
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use bagpipe_wire::{
    Abort, AgentHello, Duplex, FileHeader, FrameType, MAX_PAYLOAD, Next, PROTOCOL, PipeError,
    WorkerHello, fifo, from_map, to_map,
};
use rmpv::Value;

use crate::case::failure::Failure;
use crate::case::{Case, seconds};
use crate::engine;
use crate::engine::on_disk::OnDisk;
use crate::engine::task::{Answer, Recording, Task};
use crate::metrics::SlotFigures;
use crate::serve::layout::SlotFolder;
use crate::serve::watchdog::Watchdog;
use crate::stack::processes::Children;

/// A worker that opened the pipe writes HELLO at once.
const HELLO: Duration = Duration::from_secs(10);
/// A worker opens its reading end before it writes.
const OPEN: Duration = Duration::from_secs(2);
/// How long the worker may leave an answer's frame unread.
const ANSWER: Duration = Duration::from_secs(30);
/// How long a worker may go on writing after a session that broke off.
const CLOSE: Duration = Duration::from_secs(30);
/// What the watchdog allows beyond all other deadlines.
const GRACE: Duration = Duration::from_secs(15);

/// A slot's lasting state.
pub struct Slot<'a> {
    pub number: u32,
    pub port: u16,
    pub memory_budget: u64,
    /// Where bags lie that are not to lie in memory.
    pub on_disk: Option<OnDisk>,
    pub folder: SlotFolder,
    pub stop: &'a AtomicBool,
    pub figures: Arc<SlotFigures>,
    pub children: RefCell<Children>,
}

impl Slot<'_> {
    /// Runs one session, and returns what comes next when the slot is free.
    pub fn session(&self, mut link: Duplex, pipe_bytes: usize) -> Result<Next, String> {
        link.count_data(Arc::clone(&self.figures.received_bytes));
        let link = RefCell::new(link);
        let mut session = String::new();
        let ended = self.answer(&link, pipe_bytes, &mut session);
        self.figures.end(&ended);
        let mut link = link.into_inner();
        match ended {
            Ok(()) => {}
            Err(Failure::Silent(why)) => eprintln!("[slot {}] {why}", self.number),
            Err(Failure::Abort(mut abort)) => {
                abort.session = session;
                eprintln!("[slot {}] {}: {}", self.number, abort.reason, abort.message);
                if let Err(error) = self.abort(&mut link, &abort) {
                    eprintln!(
                        "[slot {}] and it cannot be reported to the worker: {error}",
                        self.number
                    );
                }
            }
        }
        link.into_leftovers()
            .skip(Instant::now() + CLOSE, &|| self.stopping())
            .map_err(|error| format!("{}: {error}", self.folder.requests().display()))
    }

    fn answer(
        &self,
        link: &RefCell<Duplex>,
        pipe_bytes: usize,
        session: &mut String,
    ) -> Result<(), Failure> {
        let (hello, begun) = self.receive_hello(&mut link.borrow_mut(), session)?;
        self.figures.begin(pipe_bytes as u64);
        self.open_output(&mut link.borrow_mut())?;
        let answer = AgentHello {
            session: hello.session,
            protocol: PROTOCOL,
            software: concat!("bagpipe-agent ", env!("CARGO_PKG_VERSION")).to_owned(),
            pipe_bytes: pipe_bytes as u64,
        };
        self.send(&mut link.borrow_mut(), FrameType::Hello, &map(&answer)?)?;
        let case = Case::from_value(hello.case.clone()).map_err(Failure::protocol)?;
        let engine = engine::chosen(case.engine.as_deref()).map_err(Failure::protocol)?;
        let deadline = begun + seconds(case.deadlines.case);
        let beyond = GRACE + seconds(case.deadlines.stop);
        let answer = {
            let _watchdog = Watchdog::start(self.number, deadline, beyond);
            (engine.run)(&self.task(link, &case, (session, hello.case), deadline))?
        };
        self.send_answer(&mut link.borrow_mut(), &case, answer)
    }

    fn task<'a>(
        &'a self,
        link: &'a RefCell<Duplex>,
        case: &'a Case,
        (session, described): (&'a str, Value),
        deadline: Instant,
    ) -> Task<'a> {
        Task {
            case,
            described,
            session,
            link,
            deadline,
            stop: self.stop,
            slot: self.number,
            port: self.port,
            memory_budget: self.memory_budget,
            on_disk: self.on_disk.as_ref(),
            folder: self.folder.path(),
            meter: &self.figures.meter,
            children: &self.children,
        }
    }

    fn receive_hello(
        &self,
        link: &mut Duplex,
        known: &mut String,
    ) -> Result<(WorkerHello, Instant), Failure> {
        let begun = Instant::now();
        let frame = match link.receive(begun + HELLO, &|| self.stopping()) {
            Err(PipeError::Deadline(_)) => {
                return Err(Failure::Silent(format!("no HELLO came within {HELLO:?}")));
            }
            other => other?,
        };
        if frame.kind != FrameType::Hello {
            let message = format!("expected HELLO, and {} came", frame.kind.name());
            return Err(Failure::protocol(message));
        }
        let hello: WorkerHello = from_map(&frame.payload)
            .map_err(|error| Failure::protocol(format!("HELLO cannot be understood: {error}")))?;
        known.clone_from(&hello.session);
        if link.is_superseded()? {
            return Err(Failure::Silent("the worker has begun again".to_owned()));
        }
        let WorkerHello { session, protocol, .. } = &hello;
        if session.len() != 32 || !session.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            let message = format!("a session is 32 hexadecimal digits, and {session:?} came");
            return Err(Failure::protocol(message));
        }
        if *protocol != PROTOCOL {
            let message = format!(
                "this agent speaks protocol {PROTOCOL}, and the worker {protocol}: use images \
                 of the same version"
            );
            return Err(Failure::protocol(message));
        }
        Ok((hello, begun))
    }

    fn send_answer(&self, link: &mut Duplex, case: &Case, answer: Answer) -> Result<(), Failure> {
        if let Some(ledger) = &answer.ledger {
            self.figures.proved(ledger);
        }
        self.send(link, FrameType::Result, &answer.result)?;
        if let Some(recording) = answer.recording {
            self.send_recording(link, case, recording)?;
        }
        let end = link.encoder().end();
        self.send(link, FrameType::End, &map(&end)?)
    }

    fn send_recording(
        &self,
        link: &mut Duplex,
        case: &Case,
        recording: Recording,
    ) -> Result<(), Failure> {
        let name = format!("{}.bag", case.id);
        let size = match &recording {
            Recording::InMemory(bytes) => bytes.len() as u64,
            Recording::OnDisk(_, length) => *length,
        };
        let header = FileHeader { name, size, ranges: Vec::new() };
        self.send(link, FrameType::File, &map(&header)?)?;
        match recording {
            Recording::InMemory(bytes) => {
                for piece in bytes.chunks(MAX_PAYLOAD) {
                    self.send(link, FrameType::Data, piece)?;
                }
                Ok(())
            }
            Recording::OnDisk(file, _) => self.send_file(link, &file),
        }
    }

    fn send_file(&self, link: &mut Duplex, file: &File) -> Result<(), Failure> {
        let mut piece = Vec::with_capacity(MAX_PAYLOAD);
        loop {
            piece.clear();
            let read = file.take(MAX_PAYLOAD as u64).read_to_end(&mut piece);
            read.map_err(|error| Failure::new("Internal", format!("the recording: {error}")))?;
            if piece.is_empty() {
                return Ok(());
            }
            self.send(link, FrameType::Data, &piece)?;
        }
    }

    fn send(&self, link: &mut Duplex, kind: FrameType, payload: &[u8]) -> Result<(), Failure> {
        let deadline = Instant::now() + ANSWER;
        match link.send(kind, payload, deadline, &|| self.stopping()) {
            Ok(()) => Ok(()),
            Err(PipeError::Deadline(_)) => {
                let kind = kind.name();
                Err(Failure::Silent(format!("the worker left {kind} unread for {ANSWER:?}")))
            }
            Err(error) => Err(error.into()),
        }
    }

    fn open_output(&self, link: &mut Duplex) -> Result<(), Failure> {
        let path = self.folder.answers();
        let opened = fifo::open_writer(&path, Instant::now() + OPEN, &|| self.stopping());
        match opened {
            Ok(Some(pipe)) => {
                fifo::grow(&pipe);
                link.set_output(pipe);
                Ok(())
            }
            Ok(None) => Err(Failure::Silent("the worker does not read the answer".to_owned())),
            Err(error) => Err(Failure::Silent(format!("{}: {error}", path.display()))),
        }
    }

    fn abort(&self, link: &mut Duplex, abort: &Abort) -> Result<(), String> {
        let reason_of = |failure| match failure {
            Failure::Silent(why) => why,
            Failure::Abort(abort) => abort.message,
        };
        if !link.has_output() {
            self.open_output(link).map_err(reason_of)?;
        }
        let payload = map(abort).map_err(reason_of)?;
        self.send(link, FrameType::Abort, &payload).map_err(reason_of)
    }

    fn stopping(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

fn map(value: &impl serde::Serialize) -> Result<Vec<u8>, Failure> {
    to_map(value).map_err(|error| Failure::new("Internal", error.to_string()))
}
