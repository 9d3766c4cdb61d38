//! An MCAP file: any bytes give an answer, within the limit, and what is read is what its
//! rewriting holds.
#![no_main]

use bagpipe_fuzz::{LIMIT, bag_bound, bounded};
use bagpipe_mcap::{Limits, Mcap, WriterOptions, rewrite};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = bytes.to_vec();
    bounded(bag_bound(bytes.len()), || {
        let Ok(recording) = Mcap::open_limited(file, Limits { decompressed_bytes: LIMIT }) else {
            return;
        };
        recording.attachments().for_each(drop);
        let mut passed = 0;
        let pass = recording.pass(|_| true, |_| passed += 1);
        let Ok(timeline) = recording.timeline(|_| true) else {
            return;
        };
        assert!(pass.is_err() || passed == timeline.len());
        for message in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
            assert_eq!(message.frame[..4], (message.data.len() as u32).to_le_bytes());
            assert_eq!(message.frame[4..], *message.data);
            assert!(recording.connections().iter().any(|each| each.id == message.connection));
        }
        let again = rewrite(&recording, WriterOptions::default()).expect("what was read");
        let again = Mcap::open(again).expect("what was written");
        assert!(again.loss().is_none(), "{:?}", again.loss());
        assert_eq!(again.message_count(), timeline.len() as u64);
    });
});
