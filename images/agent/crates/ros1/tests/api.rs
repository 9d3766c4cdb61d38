//! The client against Debian's rosmaster and ours, rospy and rostopic.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
mod graph;

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_graph::{Incoming, Node as _, NodeOptions, Share, Sink, TopicInfo};
use bagpipe_ros1::{Master, Node, RosError, Value};
use graph::{Graph, PATIENCE, wait_until};

const TMP: &str = env!("CARGO_TARGET_TMPDIR");

/// Topic, publisher, data.
type Message = (String, String, Vec<u8>);

/// Keeps what it receives.
#[derive(Clone, Default)]
struct Kept {
    messages: Arc<Mutex<Vec<Message>>>,
    too_large: Arc<Mutex<Vec<u64>>>,
}

impl Sink for Kept {
    fn message(&mut self, incoming: Incoming<'_>) {
        let caller = incoming.publisher.node.clone().unwrap();
        assert_eq!(incoming.publisher.datatype, "std_msgs/String");
        assert!(incoming.publisher.definition.contains("string data"));
        let message = (incoming.topic.to_owned(), caller, incoming.data.to_vec());
        self.messages.lock().unwrap().push(message);
    }

    fn too_large(&mut self, _topic: &str, length: u64) {
        self.too_large.lock().unwrap().push(length);
    }
}

fn start_node(graph: &Graph, name: &str, max_message: usize) -> (Node, Kept) {
    let kept = Kept::default();
    let options = NodeOptions {
        name: name.to_owned(),
        call_deadline: PATIENCE,
        stall: PATIENCE,
        max_message,
        paced_by: bagpipe_graph::PacedBy::default(),
    };
    (Node::start(&graph.uri, options, Box::new(kept.clone())).unwrap(), kept)
}

fn chatter(latching: bool) -> TopicInfo {
    TopicInfo {
        topic: "/chatter".to_owned(),
        datatype: "std_msgs/String".to_owned(),
        md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
        definition: "string data\n".into(),
        latching,
        offered_qos: None,
    }
}

fn frame(text: &str) -> Vec<u8> {
    let length = text.len() as u32;
    [&(length + 4).to_le_bytes()[..], &length.to_le_bytes(), text.as_bytes()].concat()
}

#[test]
fn parameters_of_every_kind_survive_the_real_master() {
    for graph in Graph::of_both(TMP) {
        let master = graph.client();
        let tree = Value::Map(BTreeMap::from([
            ("on".to_owned(), Value::Bool(true)),
            ("count".to_owned(), Value::Int(-7)),
            ("gain".to_owned(), Value::Double(0.1)),
            ("text".to_owned(), Value::from("a < b & c > \"d\" \u{e9}\n  ")),
            ("empty".to_owned(), Value::from("")),
            ("list".to_owned(), Value::List(vec![Value::Int(1), Value::from("two")])),
        ]));
        master.set_param("/lane", &tree).unwrap();
        assert_eq!(master.get_param("/lane").unwrap(), tree);
        let gain = graph
            .run("/usr/bin/python3", &["-c", "import rospy; print(rospy.get_param('/lane/gain'))"]);
        assert_eq!(gain.trim(), "0.1");
        assert_eq!(graph.run("/usr/bin/rosparam", &["get", "/lane/count"]).trim(), "-7");
        graph.run("/usr/bin/rosparam", &["set", "/lane/gain", "2.5"]);
        assert_eq!(master.get_param("/lane/gain").unwrap(), Value::Double(2.5));
        master.delete_param("/lane").unwrap();
        let error = master.get_param("/lane").unwrap_err();
        assert!(matches!(error, RosError::Refused { .. }), "{error}");
        assert!(error.to_string().contains("/lane"), "{error}");
        let error = master.set_param("/large", &Value::Int(1 << 40)).unwrap_err();
        assert!(error.to_string().contains("does not fit into 32 bits"), "{error}");
        assert!(master.get_pid().unwrap() > 1);
    }
}

#[test]
fn a_master_that_does_not_answer_is_an_error_within_the_deadline() {
    let deaf = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let uri = format!("http://{}/", deaf.local_addr().unwrap());
    let master = Master::new(&uri, "/test", Duration::from_millis(300)).unwrap();
    let began = std::time::Instant::now();
    let error = master.get_pid().unwrap_err();
    assert!(matches!(error, RosError::Unreachable { .. }), "{error}");
    assert!(began.elapsed() < Duration::from_secs(30), "{:?}", began.elapsed());
}

#[test]
fn rostopic_receives_our_messages_and_we_receive_its_messages() {
    for graph in Graph::of_both(TMP) {
        let (node, kept) = start_node(&graph, "/bagpipe_test", 1 << 20);
        node.subscribe("/answer").unwrap();
        let publication = node.advertise(chatter(true)).unwrap();
        let hello = frame("hello");
        publication.latch("/recorded", Share::LeadIn, &frame("older"));
        publication.latch("/recorded", Share::LeadIn, &hello);
        publication.latch("/recorded_too", Share::LeadIn, &hello);
        // The last one that each publisher latched reaches a subscriber that comes later.
        let echo = graph.spawn("/usr/bin/rostopic", &["echo", "/chatter"]);
        echo.wait_for("data: \"hello\"");
        // It is a subscriber once all that is latched is written, which it may have read before.
        wait_until("it has subscribed", || !publication.subscribers().is_empty());
        let world = frame("world");
        publication.send(Share::Counted, &[&world, &world], &mut || false).unwrap();
        echo.wait_for("data: \"world\"");
        let links = publication.subscribers();
        assert_eq!((links[0].lead_in, links[0].counted, links[0].counted_bytes), (2, 2, 18));
        assert!(!echo.lines().iter().any(|line| line.contains("older")));
        let mut audit = node.audit(PATIENCE);
        let link = ("/chatter".to_owned(), links[0].id);
        let asked = BTreeMap::from([(link.0.clone(), vec![link.1])]);
        let received = audit.ask(&links[0].node, &asked).unwrap()[&link];
        assert_eq!((received.messages, received.drops), (4, None));
        drop(echo);
        wait_until("the subscriber has left", || !publication.subscribers()[0].open);
        publication.send(Share::Counted, &[&world], &mut || false).unwrap();
        assert_eq!(publication.subscribers()[0].counted, 2);

        let talk = ["pub", "-l", "/answer", "std_msgs/String", "back"];
        let _talker = graph.spawn("/usr/bin/rostopic", &talk);
        wait_until("the answer is here", || !kept.messages.lock().unwrap().is_empty());
        let (topic, caller, data) = kept.messages.lock().unwrap()[0].clone();
        assert_eq!(topic, "/answer");
        assert!(caller.starts_with("/rostopic_"), "{caller}");
        assert_eq!(data, frame("back")[4..]);
    }
}

#[test]
fn rostopic_describes_our_topics_and_measures_their_rate() {
    for graph in Graph::of_both(TMP) {
        let (node, _) = start_node(&graph, "/bagpipe_test", 1 << 20);
        node.subscribe("/answer").unwrap();
        let publication = node.advertise(chatter(false)).unwrap();
        let hz = graph.spawn("/usr/bin/rostopic", &["hz", "/chatter"]);
        wait_until("it has subscribed", || publication.subscribers().iter().any(|link| link.open));
        let measured = || hz.lines().iter().any(|line| line.starts_with("average rate: "));
        let hello = frame("hello");
        wait_until("it has measured", || {
            publication.send(Share::Counted, &[&hello], &mut || false).unwrap();
            measured()
        });
        let info = graph.run("/usr/bin/rostopic", &["info", "/chatter"]);
        assert!(info.contains("Type: std_msgs/String"), "{info}");
        let (_, publishers) = info.split_once("Publishers:").unwrap();
        let (publishers, subscribers) = publishers.split_once("Subscribers:").unwrap();
        let ours = format!("* /bagpipe_test ({})", node.slave_uri());
        assert!(publishers.contains(&ours) && subscribers.contains("* /rostopic_"), "{info}");
        let info = graph.run("/usr/bin/rostopic", &["info", "/answer"]);
        assert!(info.contains("Publishers: None") && info.contains(&ours), "{info}");
    }
}

#[test]
fn rosnode_sees_a_node_as_it_is_and_leaves_no_trace() {
    for graph in Graph::of_both(TMP) {
        let (node, _) = start_node(&graph, "/bagpipe_test", 1 << 20);
        node.subscribe("/answer").unwrap();
        node.advertise(chatter(false)).unwrap();
        let info = graph.run("/usr/bin/rosnode", &["info", "/bagpipe_test"]);
        assert!(info.contains("/chatter [std_msgs/String]"), "{info}");
        assert!(info.contains("/answer [unknown type]"), "{info}");
        assert!(info.contains(&format!("Pid: {}", std::process::id())), "{info}");
        // It waits for three seconds, which a busy machine may take.
        wait_until("it answers a ping", || {
            let mut ping = graph.command("/usr/bin/rosnode", &["ping", "-c", "1", "/bagpipe_test"]);
            let replies = String::from_utf8(ping.output().unwrap().stdout).unwrap();
            replies.contains("reply from http://127.0.0.1:")
        });
        drop(node);
        let state = graph.client().get_system_state().unwrap();
        assert_eq!((state.publishers.len(), state.subscribers.len()), (0, 0));
    }
}

#[test]
fn our_own_publications_are_not_received_and_a_large_message_is_reported() {
    for graph in Graph::of_both(TMP) {
        let (listener, kept) = start_node(&graph, "/listener", 1_000_000);
        listener.subscribe("/chatter").unwrap();
        let ours = listener.advertise(chatter(false)).unwrap();
        let (talker, _) = start_node(&graph, "/talker", 1 << 20);
        let theirs = talker.advertise(chatter(false)).unwrap();
        wait_until("the listener is connected", || listener.publishers_of("/chatter") == 1);
        // The talker greets a subscriber before it sends to it.
        wait_until("the talker has it", || theirs.subscribers().iter().any(|link| link.open));
        assert!(ours.subscribers().is_empty());
        let messages: Vec<Vec<u8>> =
            (0..500).map(|number| frame(&"x".repeat(number * 10))).collect();
        let frames: Vec<&[u8]> = messages.iter().map(Vec::as_slice).collect();
        theirs.send(Share::Counted, &frames, &mut || false).unwrap();
        wait_until("all are received", || kept.messages.lock().unwrap().len() == 500);
        for ((_, caller, data), sent) in kept.messages.lock().unwrap().iter().zip(&frames) {
            assert_eq!((caller.as_str(), data.as_slice()), ("/talker", &sent[4..]));
        }
        let large = frame(&"x".repeat(2_000_000));
        theirs.send(Share::Counted, &[&large], &mut || false).unwrap();
        wait_until("it is reported", || !kept.too_large.lock().unwrap().is_empty());
        assert_eq!(*kept.too_large.lock().unwrap(), [2_000_004]);
    }
}
