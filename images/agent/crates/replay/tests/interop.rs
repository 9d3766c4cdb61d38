//! What real recordings and graphs have that a demonstration has not.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use bagpipe_replay::{Mode, Pause, replay};
use bagpipe_rosbag::{Bag, Connection, MemoryChunkedFile};
use graph::{Graph, Process, compile, wait_until};
use scene::{TMP, bag_of, bag_of_words, node, read_back, request, run, words};

#[test]
fn a_type_that_nobody_here_has_ever_seen_is_played_and_its_answer_recorded() {
    let mut odd = words("/odd", "/t", false);
    odd.datatype = "nowhere_msgs/Odd".to_owned();
    odd.md5sum = "00112233445566778899aabbccddeeff".to_owned();
    odd.definition = "# of a package that is not installed\nfloat32[3] a\nint8 b\n".into();
    let data = |n: u8| vec![n; 13];
    let bag = bag_of(&[odd.clone()], (0..50).map(|n| (0, data(n))));
    let graph = Graph::start(TMP);
    let _relay = graph.python(&node("anything.py"), &["/odd", "/relayed"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/odd".to_owned()];
    request.record_topics = vec!["/relayed".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (50, 0));
    let answers: Vec<Vec<u8>> = read_back(&replayed).into_iter().map(|(_, _, d)| d).collect();
    assert_eq!(answers, (0..50).map(data).collect::<Vec<_>>());
    let recorded = Bag::open(MemoryChunkedFile::new(replayed.recorded_bag)).unwrap();
    let kept = &recorded.connections()[0];
    assert_eq!((&kept.datatype, &kept.md5sum), (&odd.datatype, &odd.md5sum));
    assert_eq!(kept.definition, odd.definition);
}

#[test]
fn a_message_of_80_megabytes_goes_both_ways() {
    let length = 80_000_000;
    let data = [&(length as u32).to_le_bytes()[..], &vec![b'x'; length]].concat();
    let bag = bag_of(&[words("/big", "/t", false)], (0..2).map(|_| (0, data.clone())));
    let graph = Graph::start(TMP);
    let _relay = graph.python(&node("anything.py"), &["/big", "/relayed"]);
    let mut request = request(&bag, &graph.uri);
    request.topics = vec!["/big".to_owned()];
    request.drain_deadline = graph::PATIENCE;
    request.record_topics = vec!["/relayed".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (2, 0));
    assert_eq!(replayed.recorded.messages, 2);
    assert!(read_back(&replayed).iter().all(|(_, _, answer)| *answer == data));
}

#[test]
fn a_thousand_topics_arrive_whole() {
    let names: Vec<String> = (0..1_000).map(|n| format!("/many/t{n}")).collect();
    let connections: Vec<Connection> = names.iter().map(|name| words(name, "/t", false)).collect();
    let messages = (0..3_000).map(|n: usize| (n % 1_000, vec![1, 0, 0, 0, b'a']));
    let bag = bag_of(&connections, messages);
    let graph = Graph::start(TMP);
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let listener = graph.python(&node("any.py"), &names);
    let mut request = request(&bag, &graph.uri);
    request.topics = names.iter().map(|name| (*name).to_owned()).collect();
    request.subscribe_deadline = graph::PATIENCE * 2;
    let replayed = run(&bag, &request).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (3_000, 3_000, 0));
    assert!(ledger.topics.iter().all(|topic| topic.sent == 3 && topic.subscribers.len() == 1));
    wait_until("the last one was printed", || listener.last_number("seen ") == 3_000);
    eprintln!("{:?}", replayed.timings);
}

/// Lets the play go on also when an assertion fails beside it.
struct OpenOnDrop<'a>(&'a AtomicBool);

impl Drop for OpenOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Plays 12 s of words in realtime; `at_half` is called once in the middle, where the play stands
/// as long.
fn disturbed(graph: &mut Graph, at_half: &mut dyn FnMut(&mut Graph)) -> bagpipe_replay::Replayed {
    let messages: Vec<(usize, u64, &str)> = (0..300).map(|n| (0, 1_000 + n * 40, "w")).collect();
    let bag = bag_of_words(&[words("/words", "/t", false)], &messages);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    request.topics = vec!["/words".to_owned()];
    request.record_topics = vec!["/answer".to_owned()];
    let (asked, open) = (Arc::new(AtomicU64::new(0)), Arc::new(AtomicBool::new(false)));
    let (before, opened) = (Arc::clone(&asked), Arc::clone(&open));
    let resumed = Arc::new(move |_: &str| {
        before.fetch_add(1, Ordering::Relaxed) < 100 || opened.load(Ordering::Relaxed)
    });
    request.pause = Some(Pause { topics: vec!["/words".to_owned()], resumed });
    std::thread::scope(|scope| {
        let playing = scope.spawn(|| replay(&bag, &request, &mut |_| (), &|| None));
        let _opens = OpenOnDrop(&open);
        wait_until("a third of it is played", || asked.load(Ordering::Relaxed) > 100);
        at_half(graph);
        open.store(true, Ordering::Relaxed);
        playing.join().unwrap().unwrap()
    })
}

#[test]
fn subscribers_come_and_go_and_each_has_its_own_line() {
    let mut graph = Graph::start(TMP);
    let _words = graph.python(&node("words.py"), &["/words"]);
    let mut late: Option<Process> = None;
    let counter = compile(TMP, &node("clock_of.cpp"));
    let mut leaver: Option<Process> = None;
    let replayed = disturbed(&mut graph, &mut |graph| {
        // Comes in the middle, receives ten words and leaves.
        leaver = Some(graph.python(&node("leaver.py"), &["/words", "10"]));
        late = Some(graph.spawn(counter.to_str().unwrap(), &["/words", "/late_answer"]));
        // On a busy machine they take as long to start as the rest of the play.
        wait_until("both have subscribed", || {
            let state = graph.client().get_system_state().unwrap();
            state.subscribers.get("/words").is_some_and(|nodes| nodes.len() == 3)
        });
        wait_until("both are connected", || {
            ["/leaver", "/clock_of"].iter().all(|&node| {
                graph.run("/usr/bin/rosnode", &["info", node]).contains("* topic: /words\n")
            })
        });
    });
    leaver.unwrap().wait_for("leaving 10");
    let lines = &replayed.ledger.topics[0].subscribers;
    let line = |node: &str| lines.iter().find(|line| line.node == node).unwrap();
    assert_eq!((line("/words").received, line("/words").dropped), (300, 0));
    assert!(lines.iter().all(|line| line.received + line.dropped == 300), "{lines:?}");
    assert!(line("/clock_of").received > 0 && line("/clock_of").received < 300, "{lines:?}");
    assert!(line("/leaver").dropped >= 290, "{lines:?}");
    assert_eq!(replayed.recorded.messages, 300);
}
