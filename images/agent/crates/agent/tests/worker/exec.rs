//! A case of the exec engine, and programs for it.

use std::path::Path;

use bagpipe_wire::{
    Abort, Duplex, Encoder, End, FileHeader, FrameType, MAX_PAYLOAD, OwnedFrame, from_map, to_map,
};
use rmpv::Value;

use super::{Agent, at, map, receive, send};

/// What a case gave back.
#[derive(Default)]
pub struct Given {
    pub files: Vec<(String, Vec<u8>)>,
    pub bytes: u64,
    pub metrics: usize,
    pub result: Option<Value>,
    pub abort: Option<Abort>,
    /// Keep the bytes, or only count them.
    pub counted_only: bool,
}

impl Given {
    /// Takes a frame; `true` when it was the last one.
    pub fn take(&mut self, frame: &OwnedFrame, link: &Duplex) -> bool {
        match frame.kind {
            kind @ (FrameType::Hello | FrameType::Step | FrameType::Answer) => {
                panic!("{} from the agent", kind.name())
            }
            FrameType::Metric => self.metrics += 1,
            FrameType::File => {
                let header: Value = from_map(&frame.payload).unwrap();
                self.files.push((at(&header, "name").as_str().unwrap().to_owned(), Vec::new()));
            }
            FrameType::Data => {
                self.bytes += frame.payload.len() as u64;
                if !self.counted_only {
                    self.files.last_mut().unwrap().1.extend_from_slice(&frame.payload);
                }
            }
            FrameType::Result => {
                self.result = Some(rmpv::decode::read_value(&mut &frame.payload[..]).unwrap());
            }
            FrameType::End => {
                let end: End = from_map(&frame.payload).unwrap();
                let (files, digest) = (self.files.len() as u64, link.decoder().digest());
                assert_eq!(end, End { files, bytes: self.bytes, digest });
                return true;
            }
            FrameType::Abort => {
                self.abort = Some(from_map(&frame.payload).unwrap());
                return true;
            }
        }
        false
    }

    /// Sends a file and takes what comes meanwhile: a worker that only wrote would meet an
    /// agent that waits for it to read.
    pub fn feed<'a>(
        mut self,
        link: &mut Duplex,
        size: usize,
        pieces: impl Iterator<Item = &'a [u8]>,
    ) -> Self {
        let header = FileHeader { name: "in".to_owned(), size: size as u64, ranges: vec![] };
        send(link, FrameType::File, &to_map(&header).unwrap());
        for piece in pieces {
            send(link, FrameType::Data, piece);
            while let Some(frame) = link.glance().unwrap() {
                if self.take(&frame, link) {
                    return self;
                }
            }
        }
        let end = link.encoder().end();
        send(link, FrameType::End, &to_map(&end).unwrap());
        self.rest(link)
    }

    pub fn rest(mut self, link: &mut Duplex) -> Self {
        loop {
            let frame = receive(link);
            if self.take(&frame, link) {
                return self;
            }
        }
    }

    pub fn number(&self, path: &str) -> u64 {
        at(self.result.as_ref().expect("a RESULT"), path).as_u64().expect(path)
    }
}

pub fn exec_case(agent: &Agent, script: &str, deadlines: &[(&str, f64)]) -> Value {
    let Value::Map(mut case) = agent.case(script, deadlines) else { panic!("a case is a map") };
    case.push(("engine".into(), "exec".into()));
    Value::Map(case)
}

/// A whole session with one input file.
pub fn run(agent: &Agent, script: &str, deadlines: &[(&str, f64)], input: &[u8]) -> Given {
    let mut link = agent.greet(0, exec_case(agent, script, deadlines));
    Given::default().feed(&mut link, input.len(), input.chunks(MAX_PAYLOAD))
}

pub fn refusal(agent: &Agent, script: &str) -> Abort {
    run(agent, script, &[], b"input").abort.expect("ABORT")
}

/// What a program sends.
pub type Frames = Vec<(FrameType, Vec<u8>)>;

pub fn file(name: &str, size: u64) -> (FrameType, Vec<u8>) {
    let header = FileHeader { name: name.to_owned(), size, ranges: vec![] };
    (FrameType::File, to_map(&header).unwrap())
}

pub fn data(bytes: &[u8]) -> (FrameType, Vec<u8>) {
    (FrameType::Data, bytes.to_vec())
}

pub fn said(entries: &[(&str, Value)]) -> (FrameType, Vec<u8>) {
    (FrameType::Result, to_map(&map(entries)).unwrap())
}

/// A program that reads its input and answers with these frames and END.
pub fn answering(folder: &Path, name: &str, frames: &[(FrameType, Vec<u8>)]) -> String {
    let mut encoder = Encoder::new();
    let mut stream = Vec::new();
    for (kind, payload) in frames {
        stream.extend_from_slice(&encoder.header(*kind, payload).unwrap());
        stream.extend_from_slice(payload);
    }
    let end = to_map(&encoder.end()).unwrap();
    stream.extend_from_slice(&encoder.header(FrameType::End, &end).unwrap());
    stream.extend_from_slice(&end);
    let path = folder.join(name);
    std::fs::write(&path, stream).unwrap();
    format!("cat >/dev/null; cat {}", path.display())
}
