//! Real recordings, over both kinds of `ChunkedFile`; figures, not just the absence of errors.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::collections::BTreeMap;
use std::path::PathBuf;

use bagpipe_bag::{Bag, ChunkedFile, Compression, DiskChunkedFile, MemoryChunkedFile};

fn recording(name: &str) -> Option<PathBuf> {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../../../shared/data");
    let path = folder.join(name);
    if path.exists() {
        return Some(path);
    }
    println!("skipped: {name} is not at {}", folder.display());
    None
}

/// Messages by topic, and whether times never go back.
fn count<F: ChunkedFile>(bag: &Bag<F>) -> BTreeMap<String, usize> {
    let timeline = bag.timeline(|_| true).unwrap();
    let mut counts = BTreeMap::new();
    let mut last = 0;
    for message in &timeline {
        assert!(message.time >= last, "the timeline goes back");
        last = message.time;
        assert_eq!(message.frame[..4], (message.data.len() as u32).to_le_bytes());
        assert_eq!(message.frame[4..], *message.data);
        let topic = &bag.connection(message.connection).unwrap().topic;
        *counts.entry(topic.clone()).or_default() += 1;
    }
    assert_eq!(timeline.len() as u64, bag.message_count());
    assert!(timeline.iter().eq(bag.messages(|_| true).map(Result::unwrap)));
    counts
}

fn check(name: &str, compression: Compression, expected: &[(&str, usize)]) {
    let Some(path) = recording(name) else { return };
    let expected: BTreeMap<String, usize> =
        expected.iter().map(|(topic, count)| ((*topic).to_owned(), *count)).collect();
    let bytes = std::fs::read(&path).unwrap();
    let memory = || MemoryChunkedFile::new(bytes.clone());
    let disk = || DiskChunkedFile::open(&path).unwrap();
    let indexed = Bag::open(memory()).unwrap();
    assert!(indexed.chunks().iter().all(|chunk| chunk.compression == compression));
    assert!(indexed.loss().is_none());
    assert_eq!(count(&indexed), expected);
    assert_eq!(count(&Bag::open(disk()).unwrap()), expected);
    let scanned = Bag::open_unindexed(memory()).unwrap();
    assert!(scanned.loss().is_none(), "{:?}", scanned.loss());
    assert_eq!(count(&scanned), expected);
    assert_eq!(scanned.chunks(), indexed.chunks());
    assert_eq!(count(&Bag::open_unindexed(disk()).unwrap()), expected);
}

#[test]
fn pr2_bz2_has_1598_joint_states() {
    check("pr2_joint_states_bz2.bag", Compression::Bz2, &[("joint_states", 1598)]);
}

#[test]
fn jackal_bz2_has_3061_imu_and_3060_odometry_messages() {
    check(
        "jackal_bz2.bag",
        Compression::Bz2,
        &[("/imu/data", 3061), ("/jackal_velocity_controller/odom", 3060)],
    );
}

#[test]
fn luminar_lz4_has_five_of_each() {
    check(
        "luminar_lz4.bag",
        Compression::Lz4,
        &[("/base_pose_ground_truth", 5), ("/base_scan", 5), ("/luminar_pointcloud", 5)],
    );
}

#[test]
fn arrays_has_20() {
    check("arrays.bag", Compression::None, &[("/array_test", 20)]);
}
