//! A bag by its index: any bytes give an answer, within the limit.
#![no_main]

use bagpipe_rosbag::{Bag, Limits, MemoryChunkedFile};
use bagpipe_fuzz::{LIMIT, bag_bound, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = MemoryChunkedFile::new(bytes.to_vec());
    bounded(bag_bound(bytes.len()), || {
        let Ok(bag) = Bag::open_limited(file, Limits { decompressed_bytes: LIMIT }) else {
            return;
        };
        let pass: Result<Vec<_>, _> = bag.messages(|_| true).collect();
        if let Ok(timeline) = bag.timeline(|_| true) {
            if let Ok(pass) = pass {
                assert!(timeline.iter().eq(pass));
            }
            for message in &timeline {
                assert_eq!(message.frame.len(), message.data.len() + 4);
                assert!(bag.connection(message.connection).is_some());
            }
        }
    });
});
