//! A bag from the front: what the scan counts is what comes out, in order.
#![no_main]

use bagpipe_rosbag::{Bag, Limits, MemoryChunkedFile};
use bagpipe_fuzz::{LIMIT, bag_bound, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let limits = Limits { decompressed_bytes: LIMIT };
    let file = MemoryChunkedFile::new(bytes.to_vec());
    bounded(bag_bound(bytes.len()), || {
        let Ok(bag) = Bag::open_unindexed_limited(file, limits) else {
            return;
        };
        let timeline = bag.timeline(|_| true).expect("what a scan has kept is readable");
        assert_eq!(timeline.len() as u64, bag.message_count());
        assert!(timeline.iter().is_sorted_by_key(|message| message.time));
        let pass =
            bag.messages(|_| true).map(|each| each.expect("a scan knows each chunk's times"));
        assert!(timeline.iter().eq(pass));
    });
});
