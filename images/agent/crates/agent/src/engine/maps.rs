//! What the agent's structs make of the maps of the pipe, for the tests that compare both ends.

use std::io::{Read, Write, stdin, stdout};

use bagpipe_wire::{
    Abort, AgentHello, Decoder, Encoder, End, FileHeader, FrameType, Metric, WorkerHello, from_map,
    to_map,
};
use clap::ValueEnum;
use serde::Serialize;
use serde::de::DeserializeOwned;

use crate::engine::exec::ExecOutcome;
use crate::engine::nodes::outcome::Outcome;
use crate::engine::nodes::simulator::{self, Answered};

/// A map of the pipe.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum MapName {
    WorkerHello,
    AgentHello,
    File,
    Metric,
    End,
    Abort,
    Step,
    Answer,
    ReplayResult,
    ProgramResult,
}

/// Reads a stream of frames, and writes one with a frame for each: the map that its struct writes,
/// or an ABORT that says why it is refused.
pub fn maps(of: MapName) -> Result<(), String> {
    let mut bytes = Vec::new();
    stdin().lock().read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    let (mut decoder, mut encoder, mut input) = (Decoder::new(), Encoder::new(), &bytes[..]);
    while let Some(frame) = decoder.next_frame(&mut input).map_err(|error| error.to_string())? {
        let (kind, payload) = match written(of, frame.payload) {
            Ok(payload) => (frame.kind, payload),
            Err(message) => (FrameType::Abort, to_map(&refused(message)).map_err(sentence)?),
        };
        let header = encoder.header(kind, &payload).ok_or("a map is too large for a frame")?;
        stdout().lock().write_all(&[&header[..], &payload].concat()).map_err(sentence)?;
    }
    decoder.finish().map_err(|error| error.to_string())
}

fn written(of: MapName, payload: &[u8]) -> Result<Vec<u8>, String> {
    match of {
        MapName::WorkerHello => again::<WorkerHello>(payload),
        MapName::AgentHello => again::<AgentHello>(payload),
        MapName::File => again::<FileHeader>(payload),
        MapName::Metric => again::<Metric>(payload),
        MapName::End => again::<End>(payload),
        MapName::Abort => again::<Abort>(payload),
        MapName::Step => simulator::step_as_read(payload),
        MapName::Answer => again::<Answered>(payload),
        MapName::ReplayResult => again::<Outcome>(payload),
        MapName::ProgramResult => again::<ExecOutcome>(payload),
    }
}

fn again<T: Serialize + DeserializeOwned>(payload: &[u8]) -> Result<Vec<u8>, String> {
    let map: T = from_map(payload).map_err(sentence)?;
    to_map(&map).map_err(sentence)
}

fn refused(message: String) -> Abort {
    Abort { reason: "Refused".to_owned(), message, ..Abort::default() }
}

fn sentence(error: impl std::error::Error) -> String {
    error.to_string()
}
