//! Several channels of one topic of ROS 2, as folders whose files were recorded of other publishers
//! have.

use bagpipe_log::{Connection, Recording, SchemaEncoding};
use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};

use super::bags::words;
use super::{ByHand, request, window};
use crate::ReplayError;
use crate::plan::Plan;

const BEST_EFFORT: &str = "- history: 3\n  depth: 0\n  reliability: 2\n  durability: 2\n";
const LATCHED: &str = "- history: 1\n  depth: 3\n  reliability: 1\n  durability: 1\n";

fn channel(definition: &str, offered_qos: Option<&str>) -> Connection {
    Connection {
        caller_id: None,
        // What the rehearsal's master plays is ros1; the rest is as ROS 2 has it.
        schema_encoding: SchemaEncoding::Ros2Msg,
        md5sum: String::new(),
        datatype: "p/msg/X".to_owned(),
        definition: definition.into(),
        offered_qos: offered_qos.map(str::to_owned),
        ..words("/a", "", false)
    }
}

/// A message on each of these.
fn recording(channels: &[Connection]) -> Mcap {
    let mut writer = McapWriter::new(WriterOptions::default());
    for (channel, at) in channels.iter().zip(1..) {
        let id = writer.add_connection(channel);
        writer.write(id, 1_000_000 * at, b"\0\0\0\0").unwrap();
    }
    Mcap::open(writer.finish().unwrap()).unwrap()
}

/// The quality of service that the one topic of these recordings is played with.
fn offered(files: &[&Mcap]) -> String {
    let files: Vec<&dyn Recording> = files.iter().map(|file| *file as &dyn Recording).collect();
    let plan = Plan::new(&files, &request(&ByHand::new(), window(0, 9_000))).unwrap();
    assert_eq!(plan.topics.len(), 1);
    plan.topics[0].offered_qos.clone().unwrap()
}

#[test]
fn what_the_publishers_of_each_channel_offered_counts_for_the_play() {
    let of = |qos: &[Option<&str>]| {
        let channels: Vec<Connection> =
            qos.iter().map(|each| channel("float64 metres\n", *each)).collect();
        recording(&channels)
    };
    let both = of(&[Some(BEST_EFFORT), Some(LATCHED)]);
    assert_eq!(offered(&[&both]), [BEST_EFFORT, LATCHED].concat());
    let (weak, strong) = (of(&[Some(BEST_EFFORT)]), of(&[Some(LATCHED)]));
    assert_eq!(offered(&[&weak, &strong]), [BEST_EFFORT, LATCHED].concat());
    // The same publishers in parts of one drive are not more of them.
    assert_eq!(offered(&[&both, &weak, &strong, &both]), [BEST_EFFORT, LATCHED].concat());
    // Of two channels alike in one file each has publishers of its own.
    assert_eq!(offered(&[&of(&[Some(LATCHED), Some(LATCHED)])]), LATCHED.repeat(2));
    // Whose quality of service is not known may have been reliable.
    let unknown = offered(&[&of(&[Some(BEST_EFFORT), None])]);
    assert!(unknown.starts_with(BEST_EFFORT) && unknown.len() > BEST_EFFORT.len(), "{unknown}");
    assert_eq!(offered(&[&of(&[None])]), "");
}

#[test]
fn one_name_of_two_definitions_is_two_types_where_there_are_no_md5_sums() {
    let plan = |other: &str| {
        let file = recording(&[channel("float64 metres\n", None), channel(other, None)]);
        let planned = Plan::new(&[&file], &request(&ByHand::new(), window(0, 9_000)));
        planned.map(|_| ())
    };
    assert!(plan("# Length.\nfloat64  metres # of all\n\nint8 NONE = 0\n").is_ok());
    assert!(plan("").is_ok());
    let Err(error) = plan("int32 feet\nstring unit\n") else { panic!("it was taken") };
    assert!(matches!(error, ReplayError::TwoTypes { .. }));
    let text = error.to_string();
    for field in ["field 1 of p/X: float64 metres", "field 1 of p/X: int32 feet"] {
        assert!(text.contains(field), "{text}");
    }
}
