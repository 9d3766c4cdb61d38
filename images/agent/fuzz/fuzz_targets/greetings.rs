//! The MessagePack maps inside the pipe's frames, and the case in the worker's: what is
//! understood is written and understood as the same.
#![no_main]

#[path = "../../crates/agent/src/case/mod.rs"]
#[allow(dead_code)]
mod case;

use bagpipe_fuzz::bounded;
use bagpipe_wire::{Abort, AgentHello, End, FileHeader, Metric, WorkerHello, from_map, to_map};
use libfuzzer_sys::fuzz_target;
use serde::Serialize;
use serde::de::DeserializeOwned;

/// By bytes, because a number that is none does not equal itself.
fn again<T: Serialize + DeserializeOwned>(payload: &[u8]) -> Option<T> {
    // A nil of one byte becomes a value of 32, in a list that grows by doubling; the constant
    // is what serde gives a list in advance.
    let first: T = bounded(128 * payload.len() + (2 << 20), || from_map(payload).ok())?;
    let written = to_map(&first).expect("what was read can be written");
    let second: T = from_map(&written).expect("what we write can be read");
    assert_eq!(to_map(&second).expect("the same"), written);
    Some(first)
}

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, payload)) = bytes.split_first() else {
        return;
    };
    match kind % 6 {
        0 => {
            let Some(hello) = again::<WorkerHello>(payload) else { return };
            if let Ok(case) = case::Case::from_value(hello.case) {
                assert!(!case.stack.command.is_empty());
            }
        }
        1 => drop(again::<AgentHello>(payload)),
        2 => {
            let Some(header) = again::<FileHeader>(payload) else { return };
            for (stream, source, length) in &header.ranges {
                if let Some(end) = stream.checked_add(*length) {
                    // An earlier range may hold the place as well; there is an answer, or none.
                    let _place = header.source_offset(end);
                }
                if *length > 0 && header.ranges.len() == 1 {
                    assert_eq!(header.source_offset(*stream), Some(*source));
                }
            }
        }
        3 => drop(again::<Metric>(payload)),
        4 => drop(again::<End>(payload)),
        _ => drop(again::<Abort>(payload)),
    }
});
