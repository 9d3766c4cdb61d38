//! A bag made of another one's whole messages is sound and holds as many.
#![no_main]

use bagpipe_rosbag::{
    Bag, Limits, MemoryChunkedFile, Window, WriterOptions, check, check_limited, merge,
    reindex_limited, slice,
};
use bagpipe_fuzz::{LIMIT, bag_bound, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = MemoryChunkedFile::new(bytes.to_vec());
    let limits = Limits { decompressed_bytes: LIMIT };
    let bound = bag_bound(bytes.len());
    let checked = bounded(bound, || check_limited(&file, limits));
    let made = bounded(bound, || reindex_limited(file.clone(), WriterOptions::default(), limits));
    let (Ok(checked), Ok(made)) = (checked, made) else {
        return;
    };
    assert_eq!((made.messages, &made.loss), (checked.messages, &checked.loss));
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
