//! A chunk's compressed data: ours and the general decoder agree, and what came out goes in.
#![no_main]

use std::io::Read;

use bagpipe_rosbag::Compression;
use bagpipe_rosbag::fuzzing::{pack, unpack};
use bagpipe_fuzz::bounded;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let Some(([kind, low, high], data)) = bytes.split_first_chunk::<3>() else {
        return;
    };
    let size = u32::from(u16::from_le_bytes([*low, *high]));
    let compression = [Compression::Lz4, Compression::Bz2][usize::from(kind % 2)];
    // The decoders' own tables are the constant: bzip2 takes 3.7 MB.
    let bound = 3 * size as usize + 2 * data.len() + (9 << 20);
    let (made, wrong) = bounded(bound, || unpack(compression, data, size));
    assert!(made.len() <= size as usize + 1, "one byte more shows that there is too much");
    if wrong.is_some() {
        return;
    }
    assert_eq!(made.len(), size as usize);
    if compression == Compression::Lz4 {
        let mut general = Vec::new();
        let decoder = lz4_flex::frame::FrameDecoder::new(data);
        let read = decoder.take(u64::from(size)).read_to_end(&mut general);
        assert!(read.is_ok() && general == made, "the general decoder says otherwise");
    }
    let packed = pack(compression, &made).expect("a chunk of ours");
    assert_eq!(unpack(compression, &packed, size), (made, None));
});
