//! A master that is restarted in the middle of a play and a recording.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use bagpipe_replay::{Pause, RecordRequest, RecordedLive, Replayed, record};
use bagpipe_rosbag::{Bag, MemoryChunkedFile, WriterOptions};
use graph::{Graph, Process, compile, wait_until};
use scene::{TMP, bag_of_words, node, request, run, words};

/// Where the play stands while the master is restarted.
#[derive(Default)]
struct Gate {
    reached: AtomicBool,
    open: AtomicBool,
    /// Whether the recording is to end.
    over: AtomicBool,
}

/// Ends the play and the recording also when an assertion fails beside them.
struct OpenOnDrop<'a>(&'a Gate);

impl Drop for OpenOnDrop<'_> {
    fn drop(&mut self) {
        self.0.open.store(true, Ordering::Relaxed);
        self.0.over.store(true, Ordering::Relaxed);
    }
}

/// What came of a play and a recording beside it.
struct Both {
    replayed: Replayed,
    recorded: RecordedLive,
    bag: Vec<u8>,
}

/// Nodes that know only the new master.
struct Late {
    echo: Process,
    _relay: Process,
}

fn recorder() -> String {
    format!("/bagpipe_recorder_{}", std::process::id())
}

/// 100 words, the gate, another 100; `at_gate` is called while the play stands there.
fn with_a_gate(graph: &mut Graph, at_gate: impl FnOnce(&mut Graph) -> Late) -> (Both, Late) {
    let texts: Vec<String> = (0..200).map(|number| format!("w{number}")).collect();
    let mut messages: Vec<(usize, u64, &str)> =
        texts.iter().zip(0..).map(|(text, at)| (0, at * 2, text.as_str())).collect();
    messages.insert(100, (1, 199, "open"));
    let bag = bag_of_words(&[words("/words", "/t", true), words("/gate", "/t", false)], &messages);
    let gate = Arc::new(Gate::default());
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/words".to_owned(), "/gate".to_owned()];
    request.record_topics = vec!["/answer".to_owned()];
    request.start.nodes = vec!["/words".to_owned(), recorder()];
    let resumed = Arc::clone(&gate);
    let resumed = Arc::new(move |_: &str| {
        resumed.reached.store(true, Ordering::Relaxed);
        resumed.open.load(Ordering::Relaxed)
    });
    request.pause = Some(Pause { topics: vec!["/gate".to_owned()], resumed });
    let kept = Arc::new(Mutex::new(Vec::new()));
    let wanted = record_request(graph);
    std::thread::scope(|scope| {
        let recording = scope.spawn(|| {
            let kept = Arc::clone(&kept);
            let keep = Box::new(move |bag| {
                *kept.lock().unwrap() = bag;
                Ok(())
            });
            record(&wanted, keep, &|| gate.over.load(Ordering::Relaxed))
        });
        let _ends = OpenOnDrop(&gate);
        await_recorder(graph);
        let playing = scope.spawn(|| run(&bag, &request));
        wait_until("the play stands at the gate", || gate.reached.load(Ordering::Relaxed));
        let late = at_gate(graph);
        gate.open.store(true, Ordering::Relaxed);
        let replayed = playing.join().unwrap().unwrap();
        gate.over.store(true, Ordering::Relaxed);
        let recorded = recording.join().unwrap().unwrap();
        let bag = std::mem::take(&mut *kept.lock().unwrap());
        (Both { replayed, recorded, bag }, late)
    })
}

/// Waits until the recorder is connected to the first publisher of /answer.
fn await_recorder(graph: &Graph) {
    wait_until("the recorder has subscribed to the answers", || {
        let state = graph.client().get_system_state().unwrap();
        state.subscribers.get("/answer").is_some_and(|nodes| nodes.contains(&recorder()))
    });
    wait_until("the recorder is connected to the node", || {
        let info = graph.run("/usr/bin/rosnode", &["info", "/words"]);
        let mut parts = info.split("* topic: ");
        parts.any(|part| part.starts_with("/answer") && part.contains(&recorder()))
    });
}

fn record_request(graph: &Graph) -> RecordRequest {
    RecordRequest {
        middleware: Arc::new(bagpipe_ros1::Ros1 { master_uri: graph.uri.clone() }),
        topics: vec!["/words".to_owned(), "/answer".to_owned()],
        exclude: None,
        node: None,
        record_as: Arc::new(WriterOptions::default()),
        split_bytes: u64::MAX,
        split_after: None,
        duration: None,
        limit: None,
    }
}

/// Restarts the master and brings a rospy and a roscpp subscriber that know only the new one.
fn restart(graph: &mut Graph, counter: &str) -> Late {
    graph.restart_master();
    let state = || graph.client().get_system_state().unwrap();
    wait_until("the player and the recorder have registered again", || {
        let state = state();
        let named = |nodes: Option<&Vec<String>>, name: &str| {
            nodes.is_some_and(|nodes| nodes.iter().any(|node| node.starts_with(name)))
        };
        named(state.publishers.get("/words"), "/bagpipe_player_")
            && named(state.subscribers.get("/answer"), "/bagpipe_player_")
            && named(state.subscribers.get("/answer"), "/bagpipe_recorder_")
    });
    let relay = graph.spawn(counter, &["/words", "/answer"]);
    let echo = graph.spawn("/usr/bin/rostopic", &["echo", "/words"]);
    // The last word before the gate is latched: whoever has it is connected.
    echo.wait_for("data: \"w99\"");
    wait_until("the relay is connected in both directions", || {
        let info = graph.run("/usr/bin/rosnode", &["info", "/clock_of"]);
        let answers = info.split("* topic: ").filter(|part| part.starts_with("/answer"));
        answers.filter(|part| part.contains("to: /bagpipe_")).count() == 2
            && info.contains("* topic: /words")
    });
    Late { echo, _relay: relay }
}

#[test]
fn a_restarted_master_is_registered_with_again_and_nothing_that_flows_is_lost() {
    let counter = compile(TMP, &node("clock_of.cpp"));
    let mut graph = Graph::start(TMP);
    let _words = graph.python(&node("words.py"), &["/words", "/gate"]);
    let (both, late) = with_a_gate(&mut graph, |graph| restart(graph, counter.to_str().unwrap()));
    // Connections that stood went on, on both sides.
    let of = |node: &str| {
        let lines = &both.replayed.ledger.topics[0].subscribers;
        let line = lines.iter().find(|line| line.node.starts_with(node)).unwrap();
        (line.received, line.dropped)
    };
    assert_eq!(both.replayed.ledger.topics[0].sent, 200);
    assert_eq!((of("/words"), of("/bagpipe_recorder_")), ((200, 0), (200, 0)));
    // Those that came afterwards: the latched word, and all the following.
    assert_eq!(of("/clock_of"), (101, 99));
    late.echo.wait_for("data: \"w199\"");
    let lines = late.echo.lines();
    let received: Vec<&str> = lines.iter().filter_map(|line| line.strip_prefix("data: ")).collect();
    let expected: Vec<String> = (99..200).map(|number| format!("\"w{number}\"")).collect();
    assert_eq!(received, expected);
    let by_publisher = answers(&both.bag);
    assert_eq!(
        (by_publisher("/words", "/bagpipe_player_"), by_publisher("/answer", "/words")),
        (200, 201)
    );
    // Its answer to the latched word may have come before anybody was connected to receive it.
    assert!((100..=101).contains(&by_publisher("/answer", "/clock_of")));
    let by_publisher = answers(&both.replayed.recorded_bag);
    assert_eq!(by_publisher("/answer", "/words"), 201);
    assert!((100..=101).contains(&by_publisher("/answer", "/clock_of")));
    // /words, /gate and /answer of the player; /words and /answer of the recorder.
    let expected = "the ROS master was restarted: 3 registrations were made again";
    let warnings = &both.replayed.playback.warnings;
    assert!(warnings.iter().any(|warning| warning.starts_with(expected)), "{warnings:?}");
    assert_eq!((both.recorded.again, both.recorded.master_lost), (2, false));
}

/// How many messages of a topic a publisher, by the beginning of its name, has in a bag.
fn answers(bytes: &[u8]) -> impl Fn(&str, &str) -> usize {
    let bag = Bag::open(MemoryChunkedFile::new(bytes.to_vec())).unwrap();
    move |topic, publisher| {
        let timeline = bag.timeline(|connection| {
            let caller = connection.caller_id.as_deref().unwrap_or_default();
            connection.topic == topic && caller.starts_with(publisher)
        });
        timeline.unwrap().len()
    }
}
