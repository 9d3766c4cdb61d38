//! XML-RPC calls and answers: what is understood is written and understood as the same.
#![no_main]

use bagpipe_fuzz::bounded;
use bagpipe_ros1::fuzzing::{read_answer, read_call, write_answer, write_call};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((kind, bytes)) = bytes.split_first() else {
        return;
    };
    let xml = String::from_utf8_lossy(bytes);
    // A value of 16 bytes (`<value><i4>1</i4>`) takes its place in two trees of values.
    let bound = 128 * xml.len() + (64 << 10);
    // Compared as text, because a number that is none does not equal itself.
    if kind % 2 == 0 {
        let Ok((method, params)) = bounded(bound, || read_call(&xml)) else { return };
        let Ok(written) = write_call(&method, &params) else { return };
        let again = read_call(&written).expect("what we write can be read");
        assert_eq!(format!("{again:?}"), format!("{:?}", (method, params)));
    } else {
        let Ok(value) = bounded(bound, || read_answer(&xml)) else { return };
        let Ok(written) = write_answer(&value) else { return };
        let again = read_answer(&written).expect("what we write can be read");
        assert_eq!(format!("{again:?}"), format!("{value:?}"));
    }
});
