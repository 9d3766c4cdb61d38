//! Files that others wrote: those of rosbag2's own tests, and the sums of types in bags.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::path::{Path, PathBuf};

use bagpipe_log::{MessageEncoding, SchemaEncoding};
use bagpipe_mcap::{Mcap, WriterOptions, rewrite, ros1_md5};
use bagpipe_rosbag::{Bag, MemoryChunkedFile};

/// Other people's recordings, beside the checkout; a clone has none.
fn beside(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../..");
    let places = ["../shared/data", "../../shared/data"];
    let found = places.iter().map(|place| root.join(place).join(name)).find(|path| path.exists());
    if found.is_none() {
        println!("left out: {name} is not beside the checkout");
    }
    found
}

/// File, messages, topics and how many of these are latched.
const RECORDINGS: [(&str, usize, usize, usize); 10] = [
    ("rosbag2_py/mcap/convert_a/rewriter_a_0.mcap", 150, 2, 0),
    ("rosbag2_py/mcap/convert_b/rewriter_b_0.mcap", 75, 2, 2),
    ("rosbag2_py/mcap/reindex_test_bags/multiple_files/multiple_files_0.mcap", 1324, 1, 0),
    ("rosbag2_py/mcap/reindex_test_bags/multiple_files/multiple_files_2.mcap", 529, 1, 0),
    ("rosbag2_py/mcap/talker/talker.mcap", 20, 3, 1),
    ("rosbag2_py/mcap/wbag/wbag_0.mcap", 1246, 8, 0),
    ("rosbag2_py/mcap/wbag/wbag_4.mcap", 1108, 8, 0),
    (
        "rosbag2_tests/mcap/bag_with_topics_and_service_events/bag_with_topics_and_service_events.mcap",
        10,
        5,
        2,
    ),
    ("rosbag2_tests/mcap/cdr_test/cdr_test_0.mcap", 7, 2, 2),
    ("rosbag2_tests/mcap/wrong_rmw_test/wrong_rmw_test_0.mcap", 7, 2, 0),
];

#[test]
fn the_recordings_of_rosbag2_s_tests_are_read_and_written_again() {
    let Some(folder) = beside("rosbag2") else { return };
    for (name, messages, topics, latched) in RECORDINGS {
        let bytes = std::fs::read(folder.join(name)).unwrap();
        let theirs: Vec<_> =
            mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap).collect();
        let recording = Mcap::open(bytes.clone()).unwrap();
        assert_eq!(recording.loss(), None, "{name}");
        assert_eq!(recording.profile(), "ros2");
        let connections = recording.connections();
        assert_eq!(connections.len(), topics, "{name}");
        assert_eq!(connections.iter().filter(|each| each.latching).count(), latched, "{name}");
        for each in connections {
            assert_eq!(each.schema_encoding, SchemaEncoding::Ros2Msg, "{name}");
            assert!(each.offered_qos.is_some() && each.md5sum.is_empty(), "{each:?}");
            let cdr = each.message_encoding == MessageEncoding::Cdr;
            assert!(cdr != name.contains("wrong_rmw"), "{each:?}");
        }
        let again = rewrite(&recording, WriterOptions::default()).unwrap();
        for bytes in [bytes, again] {
            let recording = Mcap::open(bytes).unwrap();
            let timeline = recording.timeline(|_| true).unwrap();
            assert_eq!(timeline.len(), messages, "{name}");
            let mut expected: Vec<_> = theirs
                .iter()
                .map(|each| (each.log_time, &each.channel.topic, &each.data))
                .collect();
            expected.sort_by_key(|(time, ..)| *time);
            for (at, (time, topic, data)) in expected.into_iter().enumerate() {
                let message = timeline.get(at).unwrap();
                assert_eq!((message.time, message.data), (time, &data[..]), "{name}");
                let of = recording.connections().iter().find(|each| each.id == message.connection);
                assert_eq!(&of.unwrap().topic, topic);
            }
        }
    }
}

/// The recording that every machine with the tests has.
fn pr2_recording() -> PathBuf {
    let cache = std::env::var_os("BAGPIPE_CACHE").map(PathBuf::from);
    let ours = || PathBuf::from(std::env::var_os("HOME").unwrap()).join(".cache/bagpipe");
    let path = cache.unwrap_or_else(ours).join("recordings/pr2_joint_states.bag");
    assert!(path.exists(), "{} is missing: `make recording` fetches it", path.display());
    path
}

#[test]
fn the_sums_of_types_are_those_that_recorders_wrote() {
    let mut bags = vec![pr2_recording()];
    bags.extend(["jackal_bz2.bag", "luminar_lz4.bag", "arrays.bag"].into_iter().filter_map(beside));
    for path in bags {
        let bag = Bag::open(MemoryChunkedFile::new(std::fs::read(&path).unwrap())).unwrap();
        assert!(!bag.connections().is_empty());
        for each in bag.connections() {
            let sum = ros1_md5(&each.datatype, &each.definition);
            assert_eq!(sum.as_ref(), Some(&each.md5sum), "{} of {}", each.datatype, path.display());
        }
    }
}
