//! The pipe's frames, in pieces of any length: what is decoded encodes to the same bytes.
#![no_main]

use bagpipe_fuzz::bounded;
use bagpipe_wire::{Decoder, Encoder};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((length, bytes)) = bytes.split_first() else {
        return;
    };
    bounded(8 * bytes.len() + 4096, || {
        let (mut decoder, mut encoder) = (Decoder::new(), Encoder::new());
        let mut again = Vec::new();
        for mut piece in bytes.chunks(usize::from(*length).max(1)) {
            while !piece.is_empty() {
                match decoder.next_frame(&mut piece) {
                    Ok(Some(frame)) => {
                        let header = encoder.header(frame.kind, frame.payload).expect("a frame");
                        again.extend_from_slice(&header);
                        again.extend_from_slice(frame.payload);
                    }
                    Ok(None) => break,
                    Err(_) => {
                        assert!(bytes.starts_with(&again));
                        return;
                    }
                }
            }
        }
        assert!(bytes.starts_with(&again));
        assert_eq!(decoder.check_end(encoder.end()), Ok(()));
        assert_eq!(decoder.finish().is_ok(), again.len() == bytes.len());
    });
});
