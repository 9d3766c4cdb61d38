//! A stack that misbehaves ends the replay within its deadline, with a reason.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_replay::{Cancellation, Mode, Pause, ReplayError, Stage, replay};
use graph::Graph;
use scene::{TMP, bag_of_words, node, request, run, words};

#[test]
fn a_stack_that_never_subscribes_is_named_with_what_it_subscribes_to() {
    let bag = bag_of_words(&[words("/talk", "/t", false)], &[(0, 1, "a")]);
    let graph = Graph::start(TMP);
    let node = graph.python(&node("words.py"), &["/elsewhere"]);
    graph::wait_until("the node has subscribed", || {
        let state = graph.client().get_system_state().unwrap();
        state.subscribers.contains_key("/elsewhere")
    });
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    request.subscribe_deadline = Duration::from_millis(700);
    let error = run(&bag, &request).unwrap_err();
    assert_eq!(error.reason(), "NeverSubscribed");
    assert_eq!(
        error.to_string(),
        "nobody subscribed to /talk within 0.7 s; the stack's nodes subscribe to /elsewhere \
         (by /words); remap joins the names"
    );
    drop(node);
}

// Promise: other-type-is-named
#[test]
fn a_subscriber_of_another_type_is_refused_and_named() {
    let mut connection = words("/talk", "/t", false);
    connection.datatype = "my_msgs/Word".to_owned();
    connection.md5sum = "0123456789abcdef0123456789abcdef".to_owned();
    let bag = bag_of_words(&[connection], &[(0, 1, "a")]);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    graph::wait_until("the node has subscribed", || {
        let state = graph.client().get_system_state().unwrap();
        state.subscribers.contains_key("/talk")
    });
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    // So long the node may take to ask for the topic and to be refused.
    request.subscribe_deadline = Duration::from_secs(12);
    let error = run(&bag, &request).unwrap_err();
    assert_eq!(error.reason(), "NeverSubscribed");
    let sentence = error.to_string();
    let refusal = "/words subscribes to /talk as std_msgs/String (md5sum \
                   992ce8a1687cec8c8bd883ec73ca41d1), but it was recorded as my_msgs/Word (md5sum \
                   0123456789abcdef0123456789abcdef): build the node with the recording's message \
                   definition";
    assert!(sentence.contains(refusal), "{sentence}");
    // Beside a subscriber that takes any type the play goes on, and says who was left out.
    let _any = graph.python(&scene::node("anything.py"), &["/talk", "/relayed"]);
    request.subscribe_deadline = graph::PATIENCE;
    let replayed = run(&bag, &request).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.received), (1, 1));
    assert_eq!(replayed.playback.warnings, [refusal]);
}

/// A subscriber made by hand: it shakes hands with the player and then reads nothing.
struct Deaf {
    _slave: TcpListener,
    _data: TcpStream,
}

fn deaf_subscriber(graph: &Graph, topic: &str) -> Deaf {
    let slave = TcpListener::bind("127.0.0.1:0").unwrap();
    let uri = format!("http://{}/", slave.local_addr().unwrap());
    let master = bagpipe_ros1::Master::new(&graph.uri, "/deaf", Duration::from_secs(5)).unwrap();
    let mut publishers = Vec::new();
    graph::wait_until("the player publishes", || {
        publishers = master.register_subscriber(topic, "*", &uri).unwrap();
        !publishers.is_empty()
    });
    let place = place_of_topic(&publishers[0], topic);
    let mut data = TcpStream::connect(place).unwrap();
    let mut header = Vec::new();
    for field in ["callerid=/deaf", "md5sum=*", "type=*", &format!("topic={topic}")] {
        header.extend_from_slice(&(field.len() as u32).to_le_bytes());
        header.extend_from_slice(field.as_bytes());
    }
    data.write_all(&(header.len() as u32).to_le_bytes()).unwrap();
    data.write_all(&header).unwrap();
    Deaf { _slave: slave, _data: data }
}

fn place_of_topic(uri: &str, topic: &str) -> String {
    let host = uri.trim_start_matches("http://").trim_end_matches('/');
    let mut http = TcpStream::connect(host).unwrap();
    let body = format!(
        "<methodCall><methodName>requestTopic</methodName><params>\
         <param><value>/deaf</value></param><param><value>{topic}</value></param>\
         <param><value><array><data><value><array><data><value>TCPROS</value></data></array>\
         </value></data></array></value></param></params></methodCall>"
    );
    write!(http, "POST / HTTP/1.0\r\nContent-length: {}\r\n\r\n{body}", body.len()).unwrap();
    let mut answer = String::new();
    http.read_to_string(&mut answer).unwrap();
    let (_, rest) = answer.split_once("<i4>").and_then(|(_, r)| r.split_once("<i4>")).unwrap();
    let port = rest.split('<').next().unwrap();
    format!("127.0.0.1:{port}")
}

/// The end of a play whose drain deadline is half a second, by its own account. That it is no longer is
/// tested where nothing but the questions whether to give up is counted (`bagpipe-ros1`'s publisher).
fn read_nothing_for_half_a_second(error: &ReplayError, name: &str) {
    let ReplayError::StackStoppedReading { node, topic, waited, .. } = error else {
        panic!("{error}");
    };
    assert_eq!((node.as_str(), topic.as_str()), (name, "/talk"));
    assert!(*waited >= Duration::from_millis(500), "{waited:?}");
    let seconds = waited.as_secs_f64();
    let sentence = format!(
        "the node {name} has taken nothing from /talk for {seconds:.1} s although messages wait for \
         it; it hangs, or its callback never returns"
    );
    assert_eq!(error.to_string(), sentence);
}

// Promise: reader-that-stops
#[test]
fn a_subscriber_that_stops_reading_is_named_and_nothing_hangs() {
    let large = "x".repeat(1 << 20);
    let messages: Vec<(usize, u64, &str)> = (0..40).map(|at| (0, at, large.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    request.drain_deadline = Duration::from_millis(500);
    let error = std::thread::scope(|scope| {
        let deaf = scope.spawn(|| deaf_subscriber(&graph, "/talk"));
        let error = run(&bag, &request).unwrap_err();
        drop(deaf.join().unwrap());
        error
    });
    read_nothing_for_half_a_second(&error, "/deaf");
}

#[test]
fn a_real_node_that_is_stopped_in_the_middle_is_named_and_nothing_hangs() {
    let large = "x".repeat(1 << 20);
    let messages: Vec<(usize, u64, &str)> = (0..60).map(|at| (0, at, large.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/talk".to_owned()];
    request.drain_deadline = Duration::from_millis(500);
    let stopped = std::cell::Cell::new(false);
    let mut progress = |progress: bagpipe_replay::Progress| {
        if progress.stage == Stage::Play && !stopped.replace(true) {
            graph.run("/bin/kill", &["-STOP", &node.id().to_string()]);
        }
    };
    let error = replay(&bag, &request, &mut progress, &|| None).unwrap_err();
    assert!(stopped.get());
    read_nothing_for_half_a_second(&error, "/words");
}

#[test]
fn a_stack_that_exits_ends_the_play() {
    let bag = bag_of_words(&[words("/talk", "/t", false)], &[(0, 0, "a"), (0, 600_000, "b")]);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    let playing = std::cell::Cell::new(false);
    let mut progress = |progress: bagpipe_replay::Progress| {
        playing.set(playing.get() || progress.stage == Stage::Play);
    };
    let exits = || playing.get().then_some(Cancellation::StackExited);
    let error = replay(&bag, &request, &mut progress, &exits).unwrap_err();
    assert!(matches!(error, ReplayError::StackExited { .. }), "{error}");
    // Ten minutes before the second message is due.
    assert_eq!(
        error.to_string(),
        "the stack ended during the play; it must keep running until the agent stops it"
    );
}

// Promise: recording-over-budget
#[test]
fn a_recording_over_its_budget_is_an_error() {
    let large = "x".repeat(100_000);
    let messages: Vec<(usize, u64, &str)> = (0..20).map(|at| (0, at, large.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    let mut request = request(&bag, &graph.uri);
    request.record_topics = vec!["/answer".to_owned()];
    request.byte_budget = 500_000;
    let error = run(&bag, &request).unwrap_err();
    assert_eq!(error.reason(), "RecorderBudgetExceeded");
    assert!(error.to_string().contains("500000"), "{error}");
}

#[test]
fn no_master_and_bad_requests_are_sentences() {
    let bag = bag_of_words(&[words("/talk", "/t", false)], &[(0, 1, "a")]);
    let mut request = request(&bag, "http://127.0.0.1:9/");
    request.record_topics = vec!["/lane".to_owned()];
    assert_eq!(run(&bag, &request).unwrap_err().reason(), "RosMasterFailed");
    request.record_topics = vec!["/lane/(".to_owned()];
    let error = run(&bag, &request).unwrap_err();
    assert_eq!(error.reason(), "ProtocolError");
    assert!(error.to_string().contains("\"/lane/(\" is not a regular expression"), "{error}");
    request.rate = 0.0;
    assert!(run(&bag, &request).unwrap_err().to_string().contains("above 0"));
}

#[test]
fn a_subscriber_that_leaves_early_keeps_its_line_and_its_loss_counts() {
    let texts: Vec<String> = (0..100).map(|number| format!("{number}")).collect();
    let messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(text, at)| (0, at * 150, text.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _stays = graph.python(&node("words.py"), &["/talk"]);
    let leaver = graph.python(&node("leaver.py"), &["/talk", "50"]);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.start.nodes = vec!["/words".to_owned(), "/leaver".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    leaver.wait_for("leaving 50");
    let lines = &replayed.ledger.topics[0].subscribers;
    eprintln!("{lines:?}");
    assert_eq!((lines[0].node.as_str(), lines[1].node.as_str()), ("/leaver", "/words"));
    assert_eq!((lines[1].received, lines[1].dropped), (100, 0));
    // It was asked twice a second: what it reported last, at most what it really received.
    let leaver = &lines[0];
    assert!((1..=50).contains(&leaver.received), "{leaver:?}");
    assert_eq!(leaver.received + leaver.dropped, 100);
    assert_eq!(replayed.ledger.received, leaver.received);
}

/// Half-way through a hundred messages the play waits until a node is connected: on a busy machine
/// it takes as long for that as the rest of the play.
fn half_way(graph: &Graph, topic: &str, node: &str) -> Pause {
    let (asked, there) = (AtomicU64::new(0), AtomicBool::new(false));
    let connection = format!("* topic: {topic}\n");
    let info = Mutex::new(graph.command("/usr/bin/rosnode", &["info", node]));
    let connected = move || {
        let output = info.lock().unwrap().output().unwrap();
        String::from_utf8_lossy(&output.stdout).contains(&connection)
    };
    let resumed = move |_: &str| {
        let is_early = asked.fetch_add(1, Ordering::Relaxed) < 50;
        if !is_early && !there.load(Ordering::Relaxed) {
            there.store(connected(), Ordering::Relaxed);
        }
        is_early || there.load(Ordering::Relaxed)
    };
    Pause { topics: vec![topic.to_owned()], resumed: Arc::new(resumed) }
}

#[test]
fn a_subscriber_that_comes_late_has_lost_what_was_before() {
    let texts: Vec<String> = (0..100).map(|number| format!("{number}")).collect();
    let messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(text, at)| (0, at * 100, text.as_str())).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _stays = graph.python(&node("words.py"), &["/talk"]);
    let late = std::cell::RefCell::new(None);
    let mut progress = |progress: bagpipe_replay::Progress| {
        if progress.stage == Stage::Play && late.borrow().is_none() {
            *late.borrow_mut() = Some(graph.python(&node("leaver.py"), &["/talk", "1000"]));
        }
    };
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.pause = Some(half_way(&graph, "/talk", "/leaver"));
    let replayed = replay(&bag, &request, &mut progress, &|| None).unwrap();
    let lines = &replayed.ledger.topics[0].subscribers;
    eprintln!("{lines:?}");
    assert_eq!((lines[0].node.as_str(), lines[1].node.as_str()), ("/leaver", "/words"));
    assert!((1..100).contains(&lines[0].received), "{lines:?}");
    assert_eq!(lines[0].received + lines[0].dropped, 100);
    assert_eq!((lines[1].received, lines[1].dropped), (100, 0));
}
