//! Several channels of one topic of ROS 2, as folders whose files were recorded of other publishers
//! have.

use std::sync::Arc;

use bagpipe_graph::{GraphError, Middleware, Node, NodeOptions, ReadStamp, Sink, TopicInfo};
use bagpipe_log::{
    Connection, MessageEncoding, Recording, RecordingError, SchemaEncoding, Timeline,
};
use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};

use super::bags::words;
use super::{ByHand, graph_of, request, window};
use crate::plan::Plan;
use crate::{ReplayError, ReplayRequest};

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

/// A recording behind channels without a message, which our own writer leaves out.
struct Behind(Vec<Connection>, Mcap);

impl Behind {
    fn new(silent: &[Connection], recording: Mcap) -> Behind {
        let numbered = (1_000..).zip(silent).map(|(id, each)| Connection { id, ..each.clone() });
        Behind(numbered.chain(recording.connections().iter().cloned()).collect(), recording)
    }
}

impl Recording for Behind {
    fn connections(&self) -> &[Connection] {
        &self.0
    }

    fn timeline(
        &self,
        wanted: &dyn Fn(&Connection) -> bool,
    ) -> Result<Timeline<'_>, RecordingError> {
        Recording::timeline(&self.1, wanted)
    }
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

#[test]
fn a_channel_without_a_message_is_no_fault_whatever_its_encoding_and_type() {
    let json = Connection {
        topic: "/events".to_owned(),
        message_encoding: MessageEncoding::Other("json".to_owned()),
        ..channel("", None)
    };
    let feet = Connection { datatype: "p/msg/Y".to_owned(), ..channel("int32 feet\n", None) };
    let later = Connection { topic: "/later".to_owned(), ..channel("float64 metres\n", None) };
    let spoken = channel("float64 metres\n", Some(BEST_EFFORT));
    let everything =
        ReplayRequest { topics: Vec::new(), ..request(&ByHand::new(), window(0, 9_000)) };
    let silent = [json.clone(), feet.clone(), later];
    let first = Behind::new(&silent, recording(std::slice::from_ref(&spoken)));
    let second = Behind::new(std::slice::from_ref(&feet), recording(&[]));
    for files in [&[&first as &dyn Recording][..], &[&second, &first], &[&first, &second]] {
        let plan = Plan::new(files, &everything).unwrap();
        assert_eq!(plan.counted.len(), 1);
        let topics = plan.topics.iter().map(|each| (&*each.topic, &*each.datatype));
        assert_eq!(topics.collect::<Vec<_>>(), [("/a", "p/msg/X"), ("/later", "p/msg/X")]);
        assert_eq!(plan.topics[0].offered_qos.as_deref(), Some(BEST_EFFORT));
    }
    for wrong in [json, feet] {
        let file = recording(&[spoken.clone(), wrong]);
        assert!(Plan::new(&[&file], &everything).is_err());
    }
}

/// A graph of ROS 1 whose messages are CDR.
#[derive(Debug)]
struct OfCdr(Arc<dyn Middleware>);

impl Middleware for OfCdr {
    fn join(&self, options: NodeOptions, sink: Box<dyn Sink>) -> Result<Box<dyn Node>, GraphError> {
        self.0.join(options, sink)
    }

    fn encoding(&self) -> &'static str {
        "cdr"
    }

    fn schema_encoding(&self) -> &'static str {
        self.0.schema_encoding()
    }

    fn read_stamp(&self, definition: &str) -> Option<ReadStamp> {
        self.0.read_stamp(definition)
    }

    fn clock_topic(&self) -> TopicInfo {
        self.0.clock_topic()
    }

    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8> {
        self.0.clock_frame(nanoseconds)
    }
}

#[test]
fn messages_that_were_compressed_one_by_one_are_an_error_and_not_played_as_cdr() {
    let plan = |first: &[u8], second: &[u8]| {
        let cdr = Connection { message_encoding: MessageEncoding::Cdr, ..channel("", None) };
        let mut writer = McapWriter::new(WriterOptions::default());
        let id = writer.add_connection(&cdr);
        writer.write(id, 1_000_000, first).unwrap();
        writer.write(id, 2_000_000, second).unwrap();
        let file = Mcap::open(writer.finish().unwrap()).unwrap();
        let request = ReplayRequest {
            middleware: Arc::new(OfCdr(graph_of("http://127.0.0.1:9/"))),
            ..request(&ByHand::new(), window(0, 9_000))
        };
        Plan::new(&[&file], &request).map(|plan| plan.counted.len())
    };
    let (cdr, frame) = (&b"\0\x01\0\0"[..], &b"\x28\xb5\x2f\xfd\x20\x00\x01\0\0"[..]);
    assert_eq!(plan(cdr, cdr).unwrap(), 2);
    let Err(error) = plan(frame, frame) else { panic!("it was taken") };
    assert_eq!(error.reason(), "BagUnreadable");
    assert!(
        error.to_string().starts_with("the messages of /a were compressed one by one"),
        "{error}"
    );
}
