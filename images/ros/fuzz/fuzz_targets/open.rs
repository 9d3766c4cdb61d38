//! A bag by its index: any bytes give an answer, within the limit.
#![no_main]

use bagpipe_bag::{Bag, Limits, MemoryChunkedFile};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { decompressed_bytes: 1 << 20 };
    let Ok(bag) = Bag::open_limited(MemoryChunkedFile::new(bytes.to_vec()), limits) else {
        return;
    };
    if let Ok(timeline) = bag.timeline(|_| true) {
        for message in &timeline {
            assert_eq!(message.frame.len(), message.data.len() + 4);
            assert!(bag.connection(message.connection).is_some());
        }
    }
});
