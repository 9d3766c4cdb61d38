//! What a service publishes of its calls is played and recorded as the topic that it is.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use bagpipe_log::{Connection, RecordingWriter};
use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};
use bagpipe_replay::Strength;
use scene::{Ask, MS, Scene, imu, recorded, stamped};

const TOPIC: &str = "/add/_service_event";
const MESSAGES: u64 = 200;

/// Events of a service as rosbag2 records them, whose bytes are nobody's business.
fn events() -> Mcap {
    let mut writer = McapWriter::new(WriterOptions::default());
    let connection = Connection {
        datatype: "example_interfaces/srv/AddTwoInts_Event".to_owned(),
        definition: "service_msgs/ServiceEventInfo info\n".into(),
        ..imu(TOPIC)
    };
    let id = RecordingWriter::add_connection(&mut writer, &connection);
    for number in 0..MESSAGES {
        let time = (1000 + number) * MS;
        RecordingWriter::write(&mut writer, id, time, &stamped(time, number, 100)).unwrap();
    }
    Mcap::open(RecordingWriter::finish(Box::new(writer)).unwrap()).unwrap()
}

#[test]
fn recorded_events_of_a_service_are_played_to_who_subscribes_to_them() {
    let scene = Scene::new();
    let subscription = format!("{TOPIC}:example_interfaces/srv/AddTwoInts_Event:10:reliable");
    let relay = format!("{TOPIC}=/out");
    let publisher = "/out:std_msgs/msg/String:500:reliable";
    let arguments = ["--sub", &subscription, "--pub", publisher, "--relay", &relay];
    let _monitor = scene.start("standin_node", &[&["--name", "/monitor"], &arguments[..]].concat());
    let replayed = scene.play(&events(), &Ask::default()).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (MESSAGES, MESSAGES, 0));
    assert_eq!(ledger.strength, Some(Strength::Called));
    assert_eq!(ledger.topics[0].subscribers[0].node, "/monitor");
    assert_eq!(recorded(&replayed).len() as u64, MESSAGES);
}
