//! The pipe's frames, in pieces of any length.
#![no_main]

use bagpipe_pipe::Decoder;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((length, bytes)) = bytes.split_first() else {
        return;
    };
    let mut decoder = Decoder::new();
    for mut piece in bytes.chunks(usize::from(*length).max(1)) {
        while !piece.is_empty() {
            match decoder.next_frame(&mut piece) {
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(_) => return,
            }
        }
    }
    let _ = decoder.finish();
});
