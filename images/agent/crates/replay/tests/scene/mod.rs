//! What the replay tests play: the real PR2 recording, small bags, usual requests.
#![allow(dead_code)] // each test file uses its own part

mod bags;
#[path = "../../../rosbag/tests/needed/mod.rs"]
mod needed;

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_replay::{
    CLOCK_RATE, Mode, Progress, ReplayError, ReplayRequest, Replayed, StartWhen, Window, replay,
};
use bagpipe_ros1::Ros1;
use bagpipe_rosbag::{Bag, MemoryChunkedFile};

#[allow(unused_imports)] // each test file uses its own part
pub use bags::{bag_of, bag_of_words, in_lz4, packed, words};

/// Where compiled nodes and the graphs' folders lie.
pub const TMP: &str = env!("CARGO_TARGET_TMPDIR");

/// A source of a node. Where the crate is, cargo says when it runs the test: what was compiled may
/// come from the cache of another checkout.
pub fn node(name: &str) -> PathBuf {
    PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap()).join("tests/nodes").join(name)
}

/// The real PR2 recording: 1,598 JointStates in 16 s.
pub fn pr2() -> Bag<MemoryChunkedFile> {
    let bytes = std::fs::read(needed::pr2_recording()).unwrap();
    Bag::open(MemoryChunkedFile::new(bytes)).unwrap()
}

/// A request for all of a bag, in `max`.
pub fn request(bag: &Bag<MemoryChunkedFile>, master: &str) -> ReplayRequest {
    let (first, last) = bag.time_range().unwrap_or((0, 0));
    ReplayRequest {
        middleware: Arc::new(Ros1 { master_uri: master.to_owned() }),
        window: Window { lead_in_start: first, start: first, end: last + 1 },
        topics: Vec::new(),
        late: BTreeMap::new(),
        remap: BTreeMap::new(),
        mode: Mode::Max,
        steps: Vec::new(),
        rate: 1.0,
        record_topics: Vec::new(),
        record_as: Arc::new(in_lz4()),
        byte_budget: 1 << 30,
        record_to: None,
        subscribe_deadline: Duration::from_secs(60),
        drain_deadline: Duration::from_secs(10),
        case_deadline: Instant::now() + Duration::from_secs(400),
        use_sim_time: false,
        clock_rate: CLOCK_RATE,
        start: StartWhen::default(),
        pause: None,
        meter: Arc::default(),
    }
}

/// Replays without anybody who cancels.
pub fn run(bag: &Bag<MemoryChunkedFile>, request: &ReplayRequest) -> Result<Replayed, ReplayError> {
    replay(bag, request, &mut |_: Progress| (), &|| None)
}

/// (connection's topic, time in nanoseconds, data) of a recording.
pub fn read_back(recorded: &Replayed) -> Vec<(String, u64, Vec<u8>)> {
    let bag = Bag::open(MemoryChunkedFile::new(recorded.recorded_bag.clone())).unwrap();
    let timeline = bag.timeline(|_| true).unwrap();
    let message = |m: bagpipe_rosbag::Message<'_>| {
        let topic = bag.connection(m.connection).unwrap().topic.clone();
        (topic, m.time, m.data.to_vec())
    };
    timeline.iter().map(message).collect()
}
