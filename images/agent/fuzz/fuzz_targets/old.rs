//! A bag of format 1.2: what is read of it is what its rewriting as 2.0 holds.
#![no_main]

use bagpipe_rosbag::{Bag, Limits, MemoryChunkedFile, WriterOptions, check, reindex_limited};
use bagpipe_fuzz::{LIMIT, bag_bound, bounded};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let file = MemoryChunkedFile::new([b"#ROSBAG V1.2\n", bytes].concat());
    let limits = Limits { decompressed_bytes: LIMIT };
    let bound = bag_bound(bytes.len());
    let read = bounded(bound, || Bag::open_limited(file.clone(), limits));
    let made = bounded(bound, || reindex_limited(file, WriterOptions::default(), limits));
    let Ok(read) = read else {
        return;
    };
    let made = made.expect("what can be read can be written");
    let rewritten = MemoryChunkedFile::new(made.bytes);
    assert!(check(&rewritten).expect("a bag of ours").loss.is_none());
    let rewritten = Bag::open(rewritten).expect("a bag of ours opens");
    let (old, new) = (read.timeline(|_| true).unwrap(), rewritten.timeline(|_| true).unwrap());
    assert_eq!((old.len(), old.len() as u64), (new.len(), read.message_count()));
    for (old, new) in old.iter().zip(&new) {
        assert_eq!((old.time, old.frame), (new.time, new.frame));
        let topic = |bag: &Bag<_>, id| bag.connection(id).unwrap().topic.clone();
        assert_eq!(topic(&read, old.connection), topic(&rewritten, new.connection));
    }
});
