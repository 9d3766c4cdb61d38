//! The requests in a stream to our slave API, and to our pages: the same ones in pieces of any
//! size.
#![no_main]

use bagpipe_fuzz::{Pieces, bounded};
use bagpipe_ros1::fuzzing::{read_page_request, read_requests};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some((size, bytes)) = bytes.split_first() else {
        return;
    };
    // Bytes that are no UTF-8 take three each as text.
    let bound = 16 * bytes.len() + (64 << 10);
    let (whole, _) = bounded(bound, || read_requests(&mut &bytes[..]));
    let mut stream = Pieces { bytes, size: usize::from(*size).max(1) };
    let (pieces, _) = bounded(bound, || read_requests(&mut stream));
    assert_eq!(pieces, whole);
    let whole = bounded(bound, || read_page_request(&mut &bytes[..]));
    let mut stream = Pieces { bytes, size: usize::from(*size).max(1) };
    let pieces = bounded(bound, || read_page_request(&mut stream));
    assert_eq!(pieces, whole);
});
