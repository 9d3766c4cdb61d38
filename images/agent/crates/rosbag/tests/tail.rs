//! A bag's tail read from bytes: what `Bag` finds as well, and never a panic.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use bagpipe_log::{Index, Reason, Refusal};
use bagpipe_rosbag::tail::{
    Head, chunk_compression, chunk_length, connection_fields, index_times, parse_head, parse_tail,
    split_record,
};
use bagpipe_rosbag::{Bag, Compression, MemoryChunkedFile};
use proptest::prelude::*;
use sample::sample;

const ALL: [Compression; 3] = [Compression::None, Compression::Bz2, Compression::Lz4];

fn read(bytes: &[u8]) -> Result<(Head, Index), Refusal> {
    let head = parse_head(bytes, bytes.len() as u64)?;
    let tail = parse_tail(&bytes[head.index_position as usize..], &head)?;
    Ok((head, tail))
}

#[test]
fn it_is_what_the_bag_says() {
    for compression in ALL {
        let bytes = sample(compression);
        let (head, tail) = read(&bytes).unwrap();
        let bag = Bag::open(MemoryChunkedFile::new(bytes.clone())).unwrap();
        for (span, chunk) in tail.chunks.iter().zip(bag.chunks()) {
            assert_eq!(span.offset, chunk.position);
            assert_eq!((span.start_time, span.end_time), (chunk.start, chunk.end));
            assert_eq!(span.counts, chunk.counts);
            let record = &bytes[span.offset as usize..span.end as usize];
            assert_eq!(chunk_compression(record, span.offset).unwrap(), compression.name());
            let length = chunk_length(record, span.offset).unwrap().unwrap();
            let behind = chunk.data_position + u64::from(chunk.data_length);
            assert_eq!(span.offset + length, behind);
            let times = index_times(&record[length as usize..], behind).unwrap();
            let found: Vec<_> = times.iter().map(|(id, all)| (*id, all.len() as u32)).collect();
            assert_eq!(found, chunk.counts);
            assert!(times.iter().flat_map(|(_, all)| all).all(|at| *at <= chunk.end));
        }
        assert_eq!((head.connections, head.chunks as usize), (2, bag.chunks().len()));
        let records = tail.connections.iter().map(|each| (each.offset, each.length));
        assert_eq!(tail.declarations, records.collect::<Vec<_>>());
        assert_eq!(tail.chunks.last().unwrap().end, head.index_position);
        for (publisher, connection) in tail.connections.iter().zip(bag.connections()) {
            assert_eq!((publisher.id, &publisher.topic), (connection.id, &connection.topic));
            assert_eq!(publisher.datatype, connection.datatype);
            assert_eq!(Some(&publisher.caller_id), connection.caller_id.as_ref());
            assert_eq!(publisher.in_force, connection.in_force());
            let begin = publisher.offset as usize;
            let record = &bytes[begin..begin + publisher.length as usize];
            let fields = connection_fields(record, publisher.offset).unwrap();
            assert!(fields.contains(&(b"md5sum", connection.md5sum.as_bytes())));
        }
    }
}

fn record(fields: &[&[u8]], data: &[u8]) -> Vec<u8> {
    let sized = |bytes: &[u8]| [&(bytes.len() as u32).to_le_bytes(), bytes].concat();
    let header = fields.iter().map(|field| sized(field)).collect::<Vec<_>>().concat();
    [sized(&header), sized(data)].concat()
}

#[test]
fn of_fields_and_counts_of_one_name_the_last_one_counts() {
    let pair = |id: u32, count: u32| [id.to_le_bytes(), count.to_le_bytes()].concat();
    let data = [pair(3, 1), pair(2, 5), pair(3, 4)].concat();
    let fields: [&[u8]; 7] = [
        b"op=\x07",
        b"op=\x06",
        b"chunk_pos=\x0d\0\0\0\0\0\0\0",
        b"count=\x09\0\0\0",
        b"count=\x03\0\0\0",
        b"start_time=\x01\0\0\0\x02\0\0\0",
        b"end_time=\x03\0\0\0\0\0\0\0",
    ];
    let head = Head { index_position: 100, connections: 0, chunks: 1 };
    let tail = parse_tail(&record(&fields, &data), &head).unwrap();
    assert_eq!(tail.chunks[0].counts, [(3, 4), (2, 5)]);
    assert_eq!((tail.chunks[0].start_time, tail.chunks[0].end), (1_000_000_002, 100));
}

#[test]
fn a_refusal_has_a_reason_and_names_the_byte() {
    let refusal = split_record(&[9, 0, 0, 0, 1], 0, 40).unwrap_err();
    assert_eq!(refusal.reason.name(), "BagCut");
    let sentence = "the bag is cut: the record at byte 40 needs 9 bytes, 1 are left";
    assert_eq!(refusal.to_string(), sentence);
    assert_eq!(split_record(&[], usize::MAX, u64::MAX).unwrap_err().reason, Reason::Cut);
    let nameless = connection_fields(&record(&[b"op=\x07"], &[1, 0, 0, 0, b'x']), 7).unwrap_err();
    assert_eq!(nameless.reason, Reason::Unreadable);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]
    #[test]
    fn damage_is_a_refusal_and_never_a_panic(
        places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5),
        whole in any::<bool>(),
        cut in any::<prop::sample::Index>(),
    ) {
        let mut bytes = sample(Compression::None);
        let (head, tail) = read(&bytes).unwrap();
        let records = &tail.chunks[0];
        let wanted = (0..60).chain(records.end as usize - 200..records.end as usize);
        let wanted: Vec<_> = wanted.chain(head.index_position as usize..bytes.len()).collect();
        for (place, value) in places {
            bytes[wanted[place.index(wanted.len())]] = value;
        }
        if !whole {
            bytes.truncate(cut.index(bytes.len() + 1));
        }
        if let Ok((head, tail)) = read(&bytes) {
            let inside = |end: u64| end <= head.index_position;
            prop_assert!(tail.chunks.iter().all(|span| span.offset < span.end && inside(span.end)));
        }
        for at in [0, 13, records.offset as usize, records.end as usize - 200] {
            let part = bytes.get(at..).unwrap_or_default();
            let _ = chunk_compression(part, at as u64);
            let _ = chunk_length(part, at as u64);
            let _ = index_times(part, at as u64);
            let _ = connection_fields(part, at as u64);
        }
    }
}
