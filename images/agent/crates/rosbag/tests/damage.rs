//! Damaged input: never a panic, never a loss of what lies before the damage.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod sample;

use bagpipe_rosbag::{
    Bag, BagError, BagWriter, Compression, Connection, Limits, MemoryChunkedFile, WriterOptions,
    check_limited, reindex, reindex_limited,
};
use proptest::prelude::*;
use sample::sample;

fn scan(bytes: Vec<u8>) -> Result<Bag<MemoryChunkedFile>, BagError> {
    let limits = Limits { decompressed_bytes: 64 << 20 };
    Bag::open_unindexed_limited(MemoryChunkedFile::new(bytes), limits)
}

fn messages(bag: &Bag<MemoryChunkedFile>) -> Vec<(u64, Vec<u8>)> {
    let timeline = bag.timeline(|_| true).unwrap();
    timeline.iter().map(|message| (message.time, message.data.to_vec())).collect()
}

/// How many messages lie whole before `offset`; of a compressed chunk, none before its end.
fn whole_before(bag: &Bag<MemoryChunkedFile>, offset: u64) -> usize {
    let mut whole = 0;
    let timeline = bag.timeline(|_| true).unwrap();
    let mut frames = timeline.iter();
    let base = match bag.chunks().first() {
        Some(_) => bagpipe_rosbag::ChunkedFile::slice(bag.file(), 0, 1).unwrap().as_ptr() as u64,
        None => return 0,
    };
    for chunk in bag.chunks() {
        for message in frames.by_ref().take(chunk.messages() as usize) {
            let end = match chunk.compression {
                Compression::None => {
                    message.frame.as_ptr() as u64 - base + message.frame.len() as u64
                }
                _ => chunk.data_position + u64::from(chunk.data_length),
            };
            whole += usize::from(end <= offset);
        }
    }
    whole
}

#[test]
fn a_bag_cut_anywhere_keeps_every_whole_message() {
    for compression in [Compression::None, Compression::Bz2, Compression::Lz4] {
        let bytes = sample(compression);
        let intact = scan(bytes.clone()).unwrap();
        let all = messages(&intact);
        assert_eq!(all.len(), 100);
        for cut in (4109..bytes.len()).step_by(7) {
            let whole = whole_before(&intact, cut as u64);
            for indexed in [false, true] {
                let file = MemoryChunkedFile::new(bytes[..cut].to_vec());
                let bag =
                    if indexed { Bag::open(file) } else { Bag::open_unindexed(file) }.unwrap();
                let kept = messages(&bag);
                assert!(
                    kept.len() >= whole,
                    "{compression:?} {indexed} cut at {cut}: {} < {whole}",
                    kept.len()
                );
                assert_eq!(kept[..], all[..kept.len()], "{compression:?} cut at {cut}");
                if kept.len() < 100 && indexed {
                    let loss = bag.loss().unwrap();
                    assert!(loss.bytes > 0 && !loss.description.is_empty(), "{loss:?}");
                    assert!(loss.offset >= 4109, "{loss:?}");
                }
            }
        }
    }
}

#[test]
fn the_loss_of_a_cut_chunk_names_the_cut() {
    let bytes = sample(Compression::None);
    let chunk = scan(bytes.clone()).unwrap().chunks()[1].clone();
    let cut = chunk.data_position + 700;
    let bag = scan(bytes[..cut as usize].to_vec()).unwrap();
    let loss = bag.loss().unwrap();
    assert_eq!(loss.offset, cut);
    assert_eq!(
        loss.description,
        format!("{} bytes of a chunk's data, found the file's end", chunk.size)
    );
    assert_eq!(loss.bytes, u64::from(chunk.size - bag.chunks()[1].usable));
}

#[test]
fn a_damaged_chunk_of_an_indexed_bag_is_an_error_and_a_scan_keeps_the_rest() {
    let mut bytes = sample(Compression::Bz2);
    let intact = scan(bytes.clone()).unwrap();
    let chunk = intact.chunks()[2].clone();
    for byte in &mut bytes[chunk.data_position as usize + 20..][..40] {
        *byte ^= 0x55;
    }
    let indexed = Bag::open(MemoryChunkedFile::new(bytes.clone())).unwrap();
    let error = indexed.timeline(|_| true).unwrap_err();
    assert_eq!(error.offset(), Some(chunk.data_position), "{error}");
    let scanned = scan(bytes).unwrap();
    assert_eq!(scanned.loss().unwrap().offset, chunk.data_position);
    let lost = intact.chunks()[2].messages();
    assert_eq!(scanned.message_count(), 100 - lost);
}

#[test]
fn nothing_is_kept_of_a_chunk_whose_checksum_alone_is_wrong() {
    // Of LZ4 the frame's last bytes, of bzip2 those of the first block, behind its mark.
    for (compression, from_end) in [(Compression::Lz4, true), (Compression::Bz2, false)] {
        let mut bytes = sample(compression);
        let intact = scan(bytes.clone()).unwrap();
        let chunk = intact.chunks()[2].clone();
        let end = (chunk.data_position + u64::from(chunk.data_length)) as usize;
        let at = if from_end { end - 4 } else { chunk.data_position as usize + 10 };
        bytes[at] ^= 0x55;
        let scanned = scan(bytes.clone()).unwrap();
        let loss = scanned.loss().unwrap();
        let lost = (u64::from(chunk.size), Some(chunk.messages()));
        assert_eq!((loss.bytes, loss.messages), lost, "{compression:?} {loss:?}");
        assert_eq!(scanned.message_count(), 100 - chunk.messages());
        let made = reindex(MemoryChunkedFile::new(bytes), WriterOptions::default()).unwrap();
        assert_eq!(made.messages, 100 - chunk.messages(), "{compression:?}");
    }
}

#[test]
fn a_chunk_that_claims_gigabytes_is_refused_before_it_is_made() {
    let mut bytes = sample(Compression::Bz2);
    let at = bytes.windows(5).position(|window| window == b"size=").unwrap() + 5;
    bytes[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = scan(bytes.clone()).unwrap_err();
    let expected = "byte 4109: what lies there needs 4294967295 bytes of memory, and the limit \
                    leaves 67108864";
    assert_eq!(error.to_string(), expected);
    // Without a limit it is read as far as it goes, and called damaged.
    let bag = Bag::open_unindexed(MemoryChunkedFile::new(bytes)).unwrap();
    let loss = bag.loss().unwrap();
    assert!(loss.description.starts_with("bz2 data of 4294967295 bytes, found 1"), "{loss:?}");
}

#[test]
fn check_and_reindex_refuse_a_bomb_before_it_goes_off() {
    let options = WriterOptions { compression: Compression::Bz2, ..WriterOptions::default() };
    let mut writer = BagWriter::new(options.clone());
    writer.add_connection(&Connection { topic: "/a".to_owned(), ..Connection::default() });
    writer.write(0, 1, &vec![0; 30 << 20]).unwrap();
    let bytes = writer.finish().unwrap();
    assert!(bytes.len() < 20_000, "{} bytes", bytes.len());
    let size = scan(bytes.clone()).unwrap().chunks()[0].size;
    let limits = Limits { decompressed_bytes: u64::from(size) - 1 };
    let file = MemoryChunkedFile::new(bytes);
    let expected = format!("needs {size} bytes of memory, and the limit leaves {}", size - 1);
    let error = check_limited(&file, limits).unwrap_err().to_string();
    assert!(error.ends_with(&expected), "{error}");
    let error = reindex_limited(file.clone(), options.clone(), limits).unwrap_err().to_string();
    assert!(error.ends_with(&expected), "{error}");
    let enough = Limits { decompressed_bytes: u64::from(size) };
    assert!(check_limited(&file, enough).unwrap().sound());
    assert_eq!(reindex_limited(file, options, enough).unwrap().messages, 1);
}

#[test]
fn other_formats_are_named() {
    let error = scan(b"#ROSBAG V3.0\n rest of it".to_vec()).unwrap_err();
    let expected = "byte 0: expected the line \"#ROSBAG V2.0\", found \"#ROSBAG V3.0\\n\"";
    assert_eq!(error.to_string(), expected);
    assert!(matches!(scan(Vec::new()), Err(BagError::NotABag { .. })));
}

/// The least offset that an error about damage at `first` may name: compressed chunks name
/// where they or their data begin.
fn nearest(intact: &Bag<MemoryChunkedFile>, first: u64) -> u64 {
    let inside = |chunk: &&bagpipe_rosbag::ChunkInfo| {
        let end = chunk.data_position + u64::from(chunk.data_length);
        chunk.position <= first && first < end
    };
    intact.chunks().iter().find(inside).map_or(first.saturating_sub(4096), |chunk| chunk.position)
}

type Sample = (Vec<u8>, Bag<MemoryChunkedFile>, Vec<(u64, Vec<u8>)>);
static SAMPLES: std::sync::OnceLock<[Sample; 3]> = std::sync::OnceLock::new();

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn random_damage_loses_nothing_before_it(
        which in 0usize..3,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
    ) {
        let (bytes, intact, all) = &SAMPLES.get_or_init(|| {
            [Compression::None, Compression::Bz2, Compression::Lz4].map(|compression| {
                let bytes = sample(compression);
                let intact = scan(bytes.clone()).unwrap();
                let all = messages(&intact);
                (bytes, intact, all)
            })
        })[which];
        let mut damaged = bytes.clone();
        for (at, byte) in &changes {
            damaged[at.index(bytes.len())] = *byte;
        }
        let first = (0..bytes.len()).find(|at| bytes[*at] != damaged[*at]).unwrap_or(bytes.len());
        let whole = whole_before(intact, first as u64);
        match scan(damaged.clone()) {
            Ok(bag) => {
                // What a scan has kept is readable. Damage that no checksum covers may move a
                // message in time, but those before it are there, the same.
                let kept = messages(&bag);
                for message in &all[..whole] {
                    prop_assert!(kept.contains(message), "damage at {first}: {message:?}");
                }
                if let Some(loss) = bag.loss() {
                    prop_assert!(loss.offset >= nearest(intact, first as u64), "{first}: {loss:?}");
                }
            }
            // Without its header, or past the memory limit, there is no bag.
            Err(BagError::MemoryLimit { offset, .. }) => {
                prop_assert!(offset >= nearest(intact, first as u64), "{first}: {offset}");
            }
            Err(error) => prop_assert!(first < 4109, "damage at {first}: {error}"),
        }
        // By the index: whatever it says, an answer and not a panic.
        let limits = Limits { decompressed_bytes: 64 << 20 };
        if let Ok(bag) = Bag::open_limited(MemoryChunkedFile::new(damaged), limits) {
            let ordered = bag.timeline(|_| true);
            let pass: Result<Vec<_>, _> = bag.messages(|_| true).collect();
            match (ordered, pass) {
                // Of one pass more is asked: the index must say the right times.
                (Ok(ordered), Ok(pass)) => prop_assert!(ordered.iter().eq(pass)),
                (ordered, pass) => prop_assert!(pass.is_err(), "{ordered:?}"),
            }
        }
    }

    #[test]
    fn noise_is_an_error(noise in prop::collection::vec(any::<u8>(), 0..2000)) {
        let mut bytes = bagpipe_rosbag::MAGIC.to_vec();
        bytes.extend_from_slice(&noise);
        if let Ok(bag) = scan(bytes) {
            let _ = bag.timeline(|_| true).map(|timeline| timeline.iter().count());
        }
    }
}

#[test]
fn an_encrypted_bag_is_refused_by_name() {
    let mut bytes = sample(Compression::None);
    // In the header record, before its padding: one more field.
    let mut fields = bytes[17..17 + 69].to_vec();
    let more = b"encryptor=rosbag/AesCbcEncryptor";
    fields.extend_from_slice(&(more.len() as u32).to_le_bytes());
    fields.extend_from_slice(more);
    let mut record = (fields.len() as u32).to_le_bytes().to_vec();
    let padding = 4096 - 8 - fields.len();
    record.extend_from_slice(&fields);
    record.extend_from_slice(&(padding as u32).to_le_bytes());
    bytes[13..13 + record.len()].copy_from_slice(&record);
    let error = Bag::open(MemoryChunkedFile::new(bytes)).unwrap_err();
    let expected = "the bag is encrypted with \"rosbag/AesCbcEncryptor\"; decrypt it with";
    assert!(error.to_string().starts_with(expected), "{error}");
}

#[test]
fn an_index_that_names_a_strange_connection_hides_no_message() {
    let bytes = sample(Compression::None);
    let whole = scan(bytes.clone()).unwrap();
    let mut bent = bytes.clone();
    // The last chunk's first count, at the file's end, is (connection, messages).
    let counts = whole.chunks().last().unwrap().counts.len();
    let at = bent.len() - counts * 8;
    bent[at..at + 4].copy_from_slice(&77u32.to_le_bytes());
    let bag = Bag::open(MemoryChunkedFile::new(bent)).unwrap();
    assert_eq!(messages(&bag), messages(&whole));
    assert!(bag.loss().unwrap().description.contains("found 77"), "{:?}", bag.loss());
}
