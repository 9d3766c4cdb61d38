//! A bag made of another one's whole messages is sound and holds as many.
#![no_main]

use bagpipe_bag::{
    Bag, Limits, MemoryChunkedFile, Window, WriterOptions, check, merge, reindex, slice,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = MemoryChunkedFile::new(bytes.to_vec());
    let limits = Limits { decompressed_bytes: 1 << 20 };
    // Larger claims than the limit are no input for the unlimited functions below.
    let Ok(scanned) = Bag::open_unindexed_limited(file.clone(), limits) else {
        return;
    };
    let made = reindex(file, WriterOptions::default()).expect("a bag that scans");
    assert_eq!(made.messages, scanned.message_count());
    let again = MemoryChunkedFile::new(made.bytes);
    let bag = Bag::open(again.clone()).expect("a bag of ours opens");
    assert!(bag.loss().is_none(), "{:?}", bag.loss());
    assert_eq!(bag.message_count(), made.messages);
    assert!(check(&again).expect("a bag of ours").loss.is_none());
    let window = Window { start: 5_000_000, end: 30_000_000 };
    let part = slice(&bag, window, |_| true, WriterOptions::default()).expect("a slice");
    let part = Bag::open(MemoryChunkedFile::new(part.bytes)).expect("a slice opens");
    assert!(part.loss().is_none());
    merge(&[part, bag], WriterOptions::default()).expect("a merge");
});
