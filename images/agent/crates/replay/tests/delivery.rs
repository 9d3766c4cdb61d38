//! What the ledger says is what the callbacks of real nodes saw.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use bagpipe_replay::LedgerSubscriber;
use bagpipe_rosbag::{Bag, Compression, Connection, MemoryChunkedFile, WriterOptions};
use graph::{Graph, Process, compile, wait_until};
use scene::{TMP, node, packed, pr2, read_back, request, run, words};

const PR2: u64 = 1598;

fn roscpp_relay(graph: &Graph, queue: &str, busy: &str) -> Process {
    let relay = compile(TMP, &node("relay.cpp"));
    graph.spawn(relay.to_str().unwrap(), &["/joint_states", "/relayed", queue, busy])
}

// Promise: player-never-drops
#[test]
fn a_roscpp_relay_gets_and_answers_every_message_in_max() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = roscpp_relay(&graph, "10000", "0");
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/joint_states".to_owned()];
    request.record_topics = vec!["/relayed".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    eprintln!("{}", serde_json::to_string(&replayed).unwrap());
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (PR2, PR2, 0));
    assert_eq!(ledger.topics[0].topic, "/joint_states");
    assert_eq!(ledger.topics[0].datatype, "sensor_msgs/JointState");
    assert_eq!(ledger.topics[0].subscribers[0].node, "/relay");
    wait_until("the last one is printed", || relay.last_number("seen ") == PR2);
    assert_eq!(replayed.recorded.messages, PR2);
    let inputs = bag.timeline(|_| true).unwrap();
    let outputs = read_back(&replayed);
    // roscpp's publisher counts header.seq, the first four bytes, itself.
    assert!(inputs.iter().zip(&outputs).all(|(sent, (_, _, got))| sent.data[4..] == got[4..]));
    rosbag_agrees(&graph, &replayed.recorded_bag, "/relayed", PR2);
}

/// Debian's rosbag reads the recording and finds the same counts.
fn rosbag_agrees(graph: &Graph, recorded: &[u8], topic: &str, messages: u64) {
    let path = graph.folder.join("recorded.bag");
    std::fs::write(&path, recorded).unwrap();
    let info = graph.run("/usr/bin/rosbag", &["info", "--yaml", path.to_str().unwrap()]);
    assert!(info.contains(&format!("messages: {messages}\n")), "{info}");
    assert!(info.contains(&format!("topic: {topic}\n")), "{info}");
    assert!(info.contains("indexed: True"), "{info}");
    graph.run("/usr/bin/rosbag", &["check", path.to_str().unwrap()]);
}

// Promise: player-never-drops
#[test]
fn a_rospy_relay_gets_and_answers_every_message_in_max() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = graph.python(&node("relay.py"), &["/joint_states", "/relayed", "0", "0"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["joint_states".to_owned()];
    request.record_topics = vec!["/relay.*".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    eprintln!("{}", serde_json::to_string(&replayed).unwrap());
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (PR2, PR2, 0));
    wait_until("the last one is printed", || relay.last_number("seen ") == PR2);
    assert_eq!(replayed.recorded.topics.len(), 1);
    assert_eq!(replayed.recorded.topics[0].messages, PR2);
}

// Promise: loss-is-known
#[test]
fn what_a_short_roscpp_queue_drops_is_what_its_callbacks_did_not_see() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = roscpp_relay(&graph, "10", "1000");
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/joint_states".to_owned()];
    request.record_topics = vec!["/relayed".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    let ledger = &replayed.ledger;
    wait_until("the last callback has run", || relay.last_number("seen ") >= ledger.received);
    let seen = relay.last_number("seen ");
    eprintln!("{} seen by the callback, {} dropped by the ledger", seen, ledger.dropped);
    assert!(ledger.dropped > 0, "nothing was dropped: the test shows nothing");
    assert_eq!(ledger.dropped, PR2 - seen);
    assert_eq!((ledger.sent, ledger.received), (PR2, seen));
    assert_eq!(replayed.recorded.messages, seen);
}

// Promise: loss-is-known
#[test]
fn what_a_short_rospy_queue_drops_is_what_its_callbacks_did_not_see() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let relay = graph.python(&node("relay.py"), &["/joint_states", "/relayed", "3", "0.001"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/joint_states".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    let ledger = &replayed.ledger;
    wait_until("the last callback has run", || relay.last_number("seen ") >= ledger.received);
    let seen = relay.last_number("seen ");
    eprintln!("{} seen by the callback, {} dropped by the ledger", seen, ledger.dropped);
    assert!(ledger.dropped > 0, "nothing was dropped: the test shows nothing");
    assert_eq!(ledger.dropped, PR2 - seen);
    assert_eq!((ledger.sent, ledger.received), (PR2, seen));
}

#[test]
fn two_nodes_on_one_topic_are_two_lines_and_the_worst_one_counts() {
    let bag = pr2();
    let graph = Graph::start(TMP);
    let _slow = roscpp_relay(&graph, "10", "1000");
    let _whole = graph.python(&node("relay.py"), &["/joint_states", "/other", "0", "0"]);
    let mut request = request(&bag, &graph.uri);
    request.start.nodes = vec!["/relay".to_owned(), "/relay_py".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    let lines = &replayed.ledger.topics[0].subscribers;
    let names: Vec<&str> = lines.iter().map(|line| line.node.as_str()).collect();
    assert_eq!(names, ["/relay", "/relay_py"]);
    let sums = |line: &LedgerSubscriber| line.received + line.dropped == PR2;
    assert!(lines.iter().all(sums), "{lines:?}");
    assert_eq!((lines[1].received, lines[1].dropped), (PR2, 0));
    assert!(lines[0].dropped > 0);
    assert_eq!(replayed.ledger.received, lines[0].received);
    assert_eq!(replayed.ledger.dropped, lines[0].dropped);
}

/// A topic, and how many messages of how many bytes it has.
type Course = (&'static str, u64, usize);

#[test]
fn every_topic_of_other_shapes_and_compressions_arrives_whole() {
    let shapes: [(Compression, &[Course]); 3] = [
        (Compression::Bz2, &[("/imu", 3_061, 320), ("odom", 3_060, 720)]),
        (Compression::Lz4, &[("/pose", 5, 720), ("/scan", 5, 9_000), ("/cloud", 5, 1_700_000)]),
        (Compression::None, &[("/array", 20, 90)]),
    ];
    for (compression, courses) in shapes {
        let bag = bag_of_courses(compression, courses);
        let graph = Graph::start(TMP);
        let names: Vec<String> = courses.iter().map(|course| absolute(course.0)).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let listener = graph.python(&node("any.py"), &names);
        let mut request = request(&bag, &graph.uri);
        request.topics = names.iter().map(|name| (*name).to_owned()).collect();
        let replayed = run(&bag, &request).unwrap();
        eprintln!("{compression:?}: {:?}", replayed.playback);
        let ledger = &replayed.ledger;
        let messages: u64 = courses.iter().map(|course| course.1).sum();
        assert_eq!((ledger.sent, ledger.received, ledger.dropped), (messages, messages, 0));
        wait_until("the last one was printed", || listener.last_number("seen ") == messages);
        let bytes: u64 = courses.iter().map(|course| course.1 * course.2 as u64).sum();
        wait_until("its size too", || listener.last_number("bytes ") == bytes);
        let sent: u64 = ledger.topics.iter().map(|topic| topic.subscribers[0].bytes).sum();
        assert_eq!(sent, bytes);
    }
}

/// Messages by turns, of types that only the bag knows.
fn bag_of_courses(compression: Compression, courses: &[Course]) -> Bag<MemoryChunkedFile> {
    let connection = |course: &Course| Connection {
        datatype: "lab/Sample".to_owned(),
        md5sum: "00112233445566778899aabbccddeeff".to_owned(),
        definition: "uint8[] data\n".into(),
        ..words(course.0, "/robot", false)
    };
    let connections: Vec<Connection> = courses.iter().map(connection).collect();
    let most = courses.iter().map(|course| course.1).max().unwrap();
    let turn = |round| {
        let still = courses.iter().enumerate().filter(move |(_, course)| round < course.1);
        still.map(move |(at, course)| (at, vec![round as u8; course.2]))
    };
    let options = WriterOptions { compression, ..WriterOptions::default() };
    packed(&connections, (0..most).flat_map(turn), options)
}

fn absolute(topic: &str) -> String {
    format!("/{}", topic.trim_start_matches('/'))
}
