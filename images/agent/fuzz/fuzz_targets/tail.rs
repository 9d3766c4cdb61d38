//! What the planner reads of a bag: any bytes give an answer or a refusal that names a byte, and
//! what the tail names lies in the file.
#![no_main]

use bagpipe_fuzz::bounded;
use bagpipe_log::Index;
use bagpipe_rosbag::tail::{
    Head, chunk_compression, chunk_length, connection_fields, index_times, parse_head, parse_tail,
    split_record,
};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    // A field of 5 bytes takes 32 where it is kept, and a list that grows three times as much.
    bounded(64 * bytes.len() + (1 << 20), || {
        if let Ok(head) = parse_head(bytes, bytes.len() as u64) {
            let begin = head.index_position as usize;
            if let Ok(tail) = parse_tail(&bytes[begin..], &head) {
                check(bytes, &head, &tail);
            }
        }
        let _ = split_record(bytes, 0, u64::MAX);
        let _ = connection_fields(bytes, u64::MAX);
        let _ = index_times(bytes, u64::MAX);
        let _ = (chunk_compression(bytes, 7), chunk_length(bytes, 7));
    });
});

fn check(bytes: &[u8], head: &Head, tail: &Index) {
    assert_eq!(tail.connections.len(), head.connections as usize);
    assert_eq!(tail.chunks.len(), head.chunks as usize);
    for each in &tail.connections {
        let record = &bytes[each.offset as usize..][..each.length as usize];
        connection_fields(record, each.offset).expect("a publisher's record was read before");
    }
    let mut last = head.index_position;
    for chunk in tail.chunks.iter().rev() {
        assert!(chunk.offset < chunk.end && chunk.end == last, "chunks lie side by side");
        last = chunk.offset;
        let span = &bytes[chunk.offset as usize..chunk.end as usize];
        let _ = chunk_compression(span, chunk.offset);
        if let Ok(Some(length)) = chunk_length(span, chunk.offset)
            && let Some(behind) = span.get(length as usize..)
        {
            let times = index_times(behind, chunk.offset + length).unwrap_or_default();
            let messages: usize = times.iter().map(|(_, times)| times.len()).sum();
            assert!(12 * messages <= behind.len(), "an entry has 12 bytes");
        }
    }
}
