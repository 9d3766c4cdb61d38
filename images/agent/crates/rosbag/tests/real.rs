//! Bags that others wrote, a real recording and what Debian's rosbag writes, over both kinds of
//! `ChunkedFile`; figures, not just the absence of errors.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod needed;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use bagpipe_rosbag::{Bag, ChunkedFile, Compression, DiskChunkedFile, MemoryChunkedFile};
use needed::{pr2_recording, without_ros};

/// By turns on two topics and, in every hundredth turn, large ones on a third.
const WRITES: &str = r#"
import sys
import rosbag, rospy
from std_msgs.msg import Float64, String, UInt8MultiArray
with rosbag.Bag(sys.argv[1], "w", compression=sys.argv[2], chunk_threshold=65536) as bag:
    for turn in range(3061):
        time = rospy.Time(1700000000, 20000 * turn)
        bag.write("/imu/data", String("reading %d " % turn + "z" * 300), time)
        if turn < 3060:
            bag.write("odom", Float64(turn / 7), time)
        if turn % 100 == 0:
            bag.write("/cloud", UInt8MultiArray(data=bytes(turn % 256 for _ in range(90000))), time)
"#;

/// A bag as Debian's rosbag writes it.
fn of_rosbag(folder: &Path, compression: Compression) -> PathBuf {
    let path = folder.join("theirs.bag");
    let mut command = Command::new("/usr/bin/python3");
    let done = command.args(["-c", WRITES]).arg(&path).arg(compression.name()).output().unwrap();
    assert!(done.status.success(), "{done:?}");
    path
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

fn check(path: &Path, compression: Compression, expected: &[(&str, usize)]) {
    let expected: BTreeMap<String, usize> =
        expected.iter().map(|(topic, count)| ((*topic).to_owned(), *count)).collect();
    let bytes = std::fs::read(path).unwrap();
    let memory = || MemoryChunkedFile::new(bytes.clone());
    let disk = || DiskChunkedFile::open(path).unwrap();
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
fn the_real_pr2_recording_has_1598_joint_states() {
    check(&pr2_recording(), Compression::Bz2, &[("joint_states", 1598)]);
}

#[test]
fn what_rosbag_writes_in_any_compression_is_read_whole() {
    if without_ros() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    for compression in [Compression::None, Compression::Bz2, Compression::Lz4] {
        let path = of_rosbag(folder.path(), compression);
        check(&path, compression, &[("/imu/data", 3061), ("odom", 3060), ("/cloud", 31)]);
    }
}
