//! TCPROS connection headers: what is understood is sent and understood as the same.
#![no_main]

use bagpipe_fuzz::bounded;
use bagpipe_ros1::fuzzing::{read_header, write_same_header};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // A field of six bytes takes two texts and its place in a tree.
    let Ok(header) = bounded(64 * bytes.len() + 4096, || read_header(bytes)) else {
        return;
    };
    assert_eq!(read_header(&write_same_header(&header)), Ok(header));
});
