//! What is latched and in force: of each publisher, and of those that a recording does not name.

use bagpipe_graph::{Incoming, Publisher, Sink};
use bagpipe_log::{Connection, Late, Recording};
use bagpipe_mcap::{Latched, Mcap, McapWriter, WriterOptions};

use super::bags::words;
use super::{ByHand, MS, Rehearsal, request, window};
use crate::plan::Plan;
use crate::{ReplayRequest, Window};

const TRANSIENT_LOCAL: &str = "- history: 3\n  depth: 0\n  durability: 1\n";

/// A channel as rosbag2 records it, for all publishers of the topic.
fn channel(topic: &str, datatype: &str, profiles: &str) -> Connection {
    Connection {
        caller_id: None,
        datatype: datatype.to_owned(),
        offered_qos: Some(profiles.to_owned()),
        latching: !profiles.is_empty(),
        ..words(topic, "", false)
    }
}

/// Each a message of that topic and millisecond, which is its word as well.
fn recording(messages: &[(usize, u64)]) -> Mcap {
    let mut writer = McapWriter::new(WriterOptions::default());
    let ids = [
        channel("/a", "tf2_msgs/TFMessage", TRANSIENT_LOCAL),
        channel("/b", "nav_msgs/OccupancyGrid", TRANSIENT_LOCAL),
        channel("/c", "std_msgs/String", ""),
    ]
    .map(|each| writer.add_connection(&each));
    for (topic, time) in messages {
        writer.write(ids[*topic], time * MS, &word(&time.to_string())).unwrap();
    }
    Mcap::open(writer.finish().unwrap()).unwrap()
}

fn word(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn of_window(window: Window) -> ReplayRequest {
    let by_hand = ByHand::new();
    let topics = ["/a", "/b", "/c"].map(str::to_owned).to_vec();
    ReplayRequest { topics, ..request(&by_hand, window) }
}

/// The words that are latched, and those of the window.
fn planned(file: &dyn Recording, request: &ReplayRequest) -> (Vec<String>, Vec<String>) {
    let plan = Plan::new(&[file], request).unwrap();
    let text = |place: usize| {
        let (message, _) = plan.message(place).unwrap();
        String::from_utf8(message.data[4..].to_vec()).unwrap()
    };
    let latched = plan.latched.iter().map(|place| text(*place)).collect();
    (latched, plan.counted.clone().map(text).collect())
}

#[test]
fn transforms_of_several_publishers_in_one_channel_are_all_in_force() {
    let file = recording(&[(0, 1), (1, 2), (0, 3), (1, 4), (0, 5), (2, 6), (2, 20), (0, 21)]);
    let request = of_window(window(10, 30));
    let (latched, counted) = planned(&file, &request);
    assert_eq!(latched, ["1", "3", "4", "5"]);
    assert_eq!(counted, ["20", "21"]);
}

#[test]
fn a_slice_plays_as_its_recording_does() {
    let messages: Vec<(usize, u64)> = (0..400).map(|at| (at as usize % 3, at)).collect();
    let files = [recording(&messages)];
    for start in [0, 1, 2, 50, 399] {
        let request = of_window(window(start, 400));
        let (start, end) = (start * MS, 400 * MS);
        let part = bagpipe_log::Window { start, end };
        let options = WriterOptions::default();
        let made = bagpipe_mcap::slice(&files, part, Latched::AS_RECORDED, |_| true, options);
        let part = Mcap::open(made.unwrap().bytes).unwrap();
        let whole = planned(&files[0], &request);
        assert_eq!(planned(&part, &request), whole);
        let of = |topic: usize| {
            messages.iter().filter(move |each| each.0 == topic && each.1 * MS < start)
        };
        assert_eq!(whole.0.len(), of(0).count().min(100) + of(1).count().min(1), "{start}");
    }
}

#[test]
fn a_job_says_what_late_subscribers_get() {
    let file = recording(&[(0, 1), (1, 2), (0, 3), (2, 4), (0, 5), (2, 6), (1, 7)]);
    let mut request = of_window(window(10, 30));
    let late = |latching, depth| Late { latching, depth };
    for (topic, wanted, expected) in [
        ("/a", late(None, Some(2)), &["3", "5", "7"][..]),
        ("/a", late(Some(false), None), &["7"]),
        ("/b", late(None, Some(9)), &["1", "2", "3", "5", "7"]),
        ("/c", late(Some(true), None), &["1", "3", "5", "6", "7"]),
        ("c", late(Some(true), Some(5)), &["1", "3", "4", "5", "6", "7"]),
    ] {
        request.late = [(topic.to_owned(), wanted)].into();
        assert_eq!(planned(&file, &request).0, expected, "{topic} {wanted:?}");
        let plan = Plan::new(&[&file], &request).unwrap();
        let latches =
            |topic: &str| plan.topics.iter().find(|each| each.topic == topic).unwrap().latching;
        assert_eq!(latches("/a"), wanted.latching != Some(false), "{topic} {wanted:?}");
        assert_eq!(latches("/c"), topic.ends_with('c'), "{topic} {wanted:?}");
    }
}

#[test]
fn the_recorder_keeps_what_each_channel_has_in_force_when_it_begins_to_count() {
    let by_hand = ByHand::new();
    let recorder = Rehearsal::new(&by_hand, request(&by_hand, window(0, 1_000))).recorder;
    let deep = "- history: keep_last\n  depth: 2\n  durability: transient_local\n";
    let says = |topic: &str, datatype: &str, text: &str| {
        let publisher = &Publisher {
            datatype: datatype.to_owned(),
            latching: true,
            offered_qos: Some(deep.to_owned()),
            message_encoding: "ros1",
            schema_encoding: "ros1msg",
            ..Publisher::default()
        };
        recorder.clone().message(Incoming { topic, publisher, link: 1, data: &word(text) });
    };
    for text in ["one", "two", "three"] {
        says("/map", "nav_msgs/OccupancyGrid", text);
        says("/tf_static", "tf2_msgs/TFMessage", text);
    }
    recorder.count_from(0);
    let (recorded, bytes) = recorder.finish().unwrap();
    let counts: Vec<_> =
        recorded.topics.iter().map(|each| (each.topic.as_str(), each.messages)).collect();
    assert_eq!(counts, [("/map", 2), ("/tf_static", 3)]);
    assert!(!bytes.is_empty());
}

#[test]
fn what_is_latched_before_the_play_is_bounded_by_the_recording_s_budget() {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 1_000));
    request.byte_budget = 1000;
    let recorder = Rehearsal::new(&by_hand, request).recorder;
    let publisher = &Publisher {
        datatype: "tf2_msgs/TFMessage".to_owned(),
        latching: true,
        ..Publisher::default()
    };
    for at in 0..12 {
        assert_eq!(recorder.failure().is_some(), at > 10, "{at}");
        let incoming = Incoming { topic: "/tf_static", publisher, link: 1, data: &[0; 100] };
        recorder.clone().message(incoming);
    }
    let error = recorder.finish().unwrap_err();
    assert_eq!(error.reason(), "RecorderBudgetExceeded");
    assert!(error.to_string().contains("latched before the play"), "{error}");
}
