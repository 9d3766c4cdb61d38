//! The messages of a TCPROS connection: the same ones in pieces of any size.
#![no_main]

use bagpipe_fuzz::{Pieces, bounded};
use bagpipe_ros1::fuzzing::read_messages;
use libfuzzer_sys::fuzz_target;

const MOST: usize = 100_000;

/// The messages as the format's page says, without a buffer.
fn simply(mut bytes: &[u8]) -> (Vec<&[u8]>, bool) {
    let mut messages = Vec::new();
    while let Some((length, rest)) = bytes.split_first_chunk::<4>() {
        let length = u32::from_le_bytes(*length) as usize;
        if length > MOST {
            return (messages, false);
        }
        let Some((data, rest)) = rest.split_at_checked(length) else { break };
        messages.push(data);
        bytes = rest;
    }
    (messages, true)
}

fuzz_target!(|bytes: &[u8]| {
    let Some((size, bytes)) = bytes.split_first() else {
        return;
    };
    let (expected, fine) = simply(bytes);
    let mut stream = Pieces { bytes, size: usize::from(*size).max(1) };
    bounded(2 * bytes.len() + (1 << 20), || {
        let mut next = expected.iter();
        let ended = read_messages(&mut stream, MOST, |data| assert_eq!(next.next(), Some(&data)));
        assert_eq!((ended, next.next()), (fine, None));
    });
});
