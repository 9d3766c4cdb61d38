use bagpipe_graph::Publisher;
use bagpipe_rosbag::{Bag, Compression, MemoryChunkedFile, WriterOptions};

use super::*;
use crate::time::Time;

fn recorder(bytes: u64) -> Recorder {
    let options = WriterOptions::with_compression(Compression::Lz4);
    let room = Room { bytes, format: Arc::new(options), file: None };
    Recorder::new(Arc::new(BagClock::new(Time::Machine, 0, u64::MAX)), room, Arc::default(), true)
}

fn connection() -> Arc<Connection> {
    Arc::new(Connection {
        topic: "/out".to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        ..Connection::default()
    })
}

// Promise: recording-over-budget
#[test]
fn a_last_step_that_does_not_fit_is_an_error_and_never_a_shorter_recording() {
    let recorder = recorder(2_000);
    recorder.count_from(0);
    // They fit while they are held: a bag needs room for more than its messages' bytes.
    for _ in 0..3 {
        recorder.keep(&connection(), &[7; 600]);
    }
    assert!(recorder.failure().is_none());
    let error = recorder.finish().unwrap_err();
    assert_eq!(error.reason(), "RecorderBudgetExceeded");
    assert!(error.to_string().contains("2000"), "{error}");
}

fn send(recorder: &mut Recorder, link: u64, data: &[u8]) {
    let node = Some(format!("/n{link}"));
    let publisher = Publisher { node, may_latch: true, ..Publisher::default() };
    recorder.message(Incoming { topic: "/out", publisher: &publisher, link, data });
}

#[test]
fn of_who_latches_after_all_the_last_message_is_in_force_and_of_who_does_not_none_is() {
    let mut recorder = recorder(7_000);
    for link in [1, 2] {
        // Only the last one has to fit.
        for byte in 0..4 {
            send(&mut recorder, link, &[byte; 3_000]);
        }
    }
    recorder.latch_after_all(&BTreeSet::from([2, 3]));
    send(&mut recorder, 1, &[8; 10]);
    send(&mut recorder, 2, &[9; 50]);
    recorder.count_from(0);
    let (recorded, bag) = recorder.finish().unwrap();
    assert_eq!((recorded.messages, recorded.bytes), (1, 50));
    let bag = Bag::open(MemoryChunkedFile::new(bag)).unwrap();
    let timeline = bag.timeline(|_| true).unwrap();
    let messages: Vec<_> = timeline.iter().map(|m| (m.time, m.data.to_vec())).collect();
    assert_eq!(messages, [(0, vec![9; 50])]);
    let connections = bag.connections().iter();
    let named: Vec<_> = connections.map(|c| (c.caller_id.as_deref(), c.latching)).collect();
    assert_eq!(named, [(Some("/n2"), true)]);
}

#[test]
fn what_had_no_room_is_an_error_only_once_its_publisher_is_known_to_latch() {
    for (found, fails) in [(BTreeSet::new(), false), (BTreeSet::from([2]), true)] {
        let mut recorder = recorder(2_000);
        send(&mut recorder, 1, &[1; 1_500]);
        send(&mut recorder, 2, &[2; 600]);
        recorder.latch_after_all(&found);
        assert_eq!(recorder.failure().is_some(), fails);
    }
}

#[test]
fn what_comes_after_the_end_is_in_no_recording() {
    let recorder = recorder(20_000);
    recorder.count_from(0);
    recorder.keep(&connection(), &[7; 600]);
    let (recorded, bag) = recorder.finish().unwrap();
    assert_eq!((recorded.messages, recorded.bytes), (1, 600));
    assert!(bag.len() > 13);
    recorder.keep(&connection(), &[7; 600]);
    recorder.end_step();
    let figures = recorder.figures();
    assert_eq!((figures.messages, figures.bytes), (1, 600));
    let again = recorder.finish().unwrap_err().to_string();
    assert!(again.contains("finished before"), "{again}");
}

#[test]
fn a_last_step_that_fits_is_recorded_whole() {
    let recorder = recorder(20_000);
    recorder.count_from(0);
    for _ in 0..3 {
        recorder.keep(&connection(), &[7; 600]);
    }
    let (recorded, bag) = recorder.finish().unwrap();
    assert_eq!((recorded.messages, recorded.bytes), (3, 1_800));
    assert!(!bag.is_empty());
}
