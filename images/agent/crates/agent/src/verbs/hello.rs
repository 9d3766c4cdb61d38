//! What the agent reads of a HELLO's case, for the tests that compare both ends of the pipe.

use std::io::{Read, Write, stdin, stdout};

use bagpipe_wire::{Decoder, WorkerHello, from_map};
use serde_json::{Value, json};

use crate::case::Case;
use crate::engine;

/// Prints a line of JSON for each HELLO on stdin: the case, or why it is refused.
pub fn hello() -> Result<(), String> {
    let mut bytes = Vec::new();
    stdin().lock().read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    let mut input = &bytes[..];
    while !input.is_empty() {
        let line = case(next(&mut input)?).unwrap_or_else(|refused| json!({"refused": refused}));
        writeln!(stdout().lock(), "{line}").map_err(|error| error.to_string())?;
    }
    Ok(())
}

/// Each HELLO begins a stream of its own.
fn next(input: &mut &[u8]) -> Result<WorkerHello, String> {
    let mut decoder = Decoder::new();
    let frame = decoder.next_frame(input).map_err(|error| error.to_string())?;
    let frame = frame.ok_or("the last frame is not whole")?;
    from_map(frame.payload).map_err(|error| error.to_string())
}

fn case(hello: WorkerHello) -> Result<Value, String> {
    let case = Case::from_value(hello.case)?;
    let engine = engine::chosen(case.engine.as_deref())?;
    let mut read = serde_json::to_value(&case).map_err(|error| error.to_string())?;
    read["engine"] = engine.name.into();
    Ok(json!({"case": read}))
}
