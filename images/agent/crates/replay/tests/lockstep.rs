//! Lock-step: real, unmodified nodes, whose answers come out the same on every run.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use bagpipe_replay::{AnswerBy, Mode, ReplayRequest, Replayed, Step};
use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use graph::{Graph, compile};
use scene::{TMP, bag_of_words, node, pr2, read_back, request, run, words};

const MS: u64 = 1_000_000;

fn step(trigger: &str, answer: &str) -> Step {
    Step {
        trigger: trigger.to_owned(),
        answer: answer.to_owned(),
        deadline: Duration::from_secs(20),
        by: AnswerBy::Count,
        optional: false,
    }
}

/// A request in lock-step that plays the steps' triggers and records their answers.
fn lockstep(bag: &Bag<MemoryChunkedFile>, graph: &Graph, steps: &[Step]) -> ReplayRequest {
    let mut request = request(bag, &graph.uri);
    request.mode = Mode::Lockstep;
    request.topics = steps.iter().map(|step| step.trigger.clone()).collect();
    request.record_topics = steps.iter().map(|step| step.answer.clone()).collect();
    request.steps = steps.to_vec();
    request
}

fn texts(replayed: &Replayed) -> Vec<(u64, String)> {
    let text = |(_, time, data): &(String, u64, Vec<u8>)| {
        (time / MS, String::from_utf8_lossy(&data[4..]).into_owned())
    };
    read_back(replayed).iter().map(text).collect()
}

/// Threads that want every processor, until they are dropped.
struct Load(Arc<AtomicBool>);

impl Load {
    fn start(threads: usize) -> Load {
        let over = Arc::new(AtomicBool::new(false));
        for _ in 0..threads {
            let over = Arc::clone(&over);
            std::thread::spawn(move || {
                while !over.load(Ordering::Relaxed) {
                    std::hint::spin_loop();
                }
            });
        }
        Load(over)
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

// Promise: same-bytes
#[test]
fn six_runs_of_a_rospy_and_a_roscpp_relay_record_the_same_bytes_on_a_loaded_machine() {
    let bag = pr2();
    let _load = Load::start(3);
    let mut first: Option<Vec<u8>> = None;
    // Twenty of them each night.
    let runs = std::env::var("BAGPIPE_RUNS").map_or(6, |runs| runs.parse().unwrap());
    for round in 0..runs {
        // A publisher counts header.seq for as long as it lives, so each run has its own.
        let graph = Graph::start(TMP);
        let relay = compile(TMP, &node("relay.cpp"));
        // An anonymous name as roscpp and one as rospy make it, different in every run.
        let cpp = format!("__name:=relay_{}", 1_763_617_212_345_678_901_u64 + round);
        let py = format!("__name:=relay_py_{}_{}", 4_000 + round, 1_763_617_212_345 + round);
        let relay = relay.to_str().unwrap();
        let _cpp = graph.spawn(relay, &["/joint_states", "/relayed", "0", "0", &cpp]);
        let script = node("relay.py");
        let _py = graph.python(&script, &["/joint_states", "/relayed_py", "0", "0", &py]);
        let mut stamped = step("/joint_states", "/relayed_py");
        stamped.by = AnswerBy::Stamp;
        let steps = [step("/joint_states", "/relayed"), stamped];
        let mut request = lockstep(&bag, &graph, &steps);
        request.window.end = request.window.start + 4_000 * MS;
        let named = |argument: &str| argument.trim_start_matches("__name:=").to_owned();
        request.start.nodes = vec![named(&cpp), named(&py)];
        let replayed = run(&bag, &request).unwrap();
        let sent = replayed.ledger.sent;
        assert!(sent > 300, "{sent}");
        let (ledger, told) = (&replayed.ledger, &replayed.playback);
        assert_eq!((ledger.received, ledger.dropped), (sent, 0), "{ledger:?} {told:?}");
        assert_eq!(replayed.recorded.messages, 2 * sent);
        for step in &replayed.playback.steps {
            assert_eq!((step.released, step.answered, step.no_output), (sent, sent, 0), "{step:?}");
        }
        let seconds = replayed.playback.played_seconds;
        eprintln!("run {round}: {sent} steps, {:.0} us each", seconds / sent as f64 * 1e6);
        let bytes = replayed.recorded_bag;
        let same = first.get_or_insert_with(|| bytes.clone()) == &bytes;
        assert!(same, "run {round} recorded {} other bytes than run 0", bytes.len());
    }
}

#[test]
fn the_time_that_a_callback_sees_is_its_input_s_in_rospy_and_never_a_later_one_in_roscpp() {
    let messages: Vec<(usize, u64, String)> =
        (0..200).map(|n| (0, 1_000 + 10 * n, format!("{n}"))).collect();
    let messages: Vec<(usize, u64, &str)> =
        messages.iter().map(|(at, time, text)| (*at, *time, text.as_str())).collect();
    let bag = bag_of_words(&[words("/in", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    graph.client().set_param("/use_sim_time", &true.into()).unwrap();
    let clock_of = compile(TMP, &node("clock_of.cpp"));
    let _cpp = graph.spawn(clock_of.to_str().unwrap(), &["/in", "/now_cpp"]);
    let _py = graph.python(&node("fuse.py"), &["/now_py", "1", "/in"]);
    let _load = Load::start(2);
    let mut request = lockstep(&bag, &graph, &[step("/in", "/now_cpp"), step("/in", "/now_py")]);
    request.use_sim_time = true;
    request.start.nodes = vec!["/clock_of".to_owned(), "/fuse".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    assert_eq!(replayed.recorded.messages, 400);
    let mut behind = 0;
    for (time, text) in texts(&replayed) {
        let seen: u64 = text.rsplit(' ').next().unwrap().parse().unwrap();
        if text.contains(" at ") {
            assert_eq!(seen, time * MS, "rospy: {text:?} recorded at {time} ms");
        } else {
            // roscpp sets its time on a thread of its own, which may be late.
            assert!(seen <= time * MS, "{text:?} at {time} ms");
            behind += u64::from(seen != time * MS);
        }
    }
    eprintln!("roscpp saw an earlier time in {behind} of 200 callbacks");
}

#[test]
fn two_inputs_that_are_fused_are_answered_once_both_have_come() {
    let bag = bag_of_words(
        &[words("/left", "/t", false), words("/right", "/t", false), words("/x", "/t", false)],
        &[
            (0, 1_000, "l1"),
            (1, 1_010, "r1"),
            (0, 1_100, "l2"),
            (2, 1_110, "unrelated"),
            (0, 1_200, "l3"),
            (1, 1_210, "r2"),
            (1, 1_300, "r3"),
        ],
    );
    let graph = Graph::start(TMP);
    let _fuse = graph.python(&node("fuse.py"), &["/both", "1", "/left", "/right"]);
    let _other = graph.python(&node("words.py"), &["/x"]);
    let mut request = lockstep(&bag, &graph, &[step("/left", "/both"), step("/right", "/both")]);
    request.topics.push("/x".to_owned());
    let replayed = run(&bag, &request).unwrap();
    let said: Vec<(u64, String)> = texts(&replayed)
        .into_iter()
        .map(|(time, text)| (time, text.split(' ').next().unwrap().to_owned()))
        .collect();
    let expected = [(1_010, "l1+r1"), (1_210, "l2+r2"), (1_300, "l3+r3")];
    assert_eq!(said, expected.map(|(time, text)| (time, text.to_owned())));
    let step = &replayed.playback.steps[0];
    assert_eq!(step.triggers, ["/left", "/right"]);
    assert_eq!((step.released, step.answered, step.no_output), (3, 3, 0));
    assert_eq!((replayed.ledger.sent, replayed.ledger.received), (7, 7));
}

// Promise: no-output-at-the-deadline
#[test]
fn an_answer_that_does_not_come_is_no_output_after_its_deadline_and_the_play_goes_on() {
    let messages: Vec<(usize, u64, &str)> = (0..6).map(|n| (0, 1_000 + n * 100, "w")).collect();
    let bag = bag_of_words(&[words("/in", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _second = graph.python(&node("fuse.py"), &["/out", "2", "/in"]);
    let mut every_second = step("/in", "/out");
    // So long an answer may take; those that may be skipped are in src/rehearsal.
    every_second.deadline = Duration::from_secs(5);
    let replayed = run(&bag, &lockstep(&bag, &graph, &[every_second])).unwrap();
    let step = &replayed.playback.steps[0];
    assert_eq!((step.released, step.answered), (6, 3), "{step:?}");
    assert_eq!((step.no_output, step.skipped), (3, 0));
    assert!(replayed.playback.played_seconds >= 15.0, "{:?}", replayed.playback);
    let times: Vec<u64> = texts(&replayed).iter().map(|(time, _)| *time).collect();
    assert_eq!(times, [1_100, 1_300, 1_500]);
}

#[test]
fn an_answer_may_be_awaited_without_being_recorded_and_must_be_published_by_somebody() {
    let bag = bag_of_words(&[words("/in", "/t", false)], &[(0, 1_000, "a"), (0, 1_100, "b")]);
    let graph = Graph::start(TMP);
    let _words = graph.python(&node("words.py"), &["/in"]);
    let mut request = lockstep(&bag, &graph, &[step("/in", "/answer")]);
    request.record_topics = vec!["/state".to_owned()];
    let replayed = run(&bag, &request).unwrap();
    assert_eq!(replayed.playback.steps[0].answered, 2);
    assert_eq!(texts(&replayed), [(1_000, "ready".to_owned())]);

    let mut request = lockstep(&bag, &graph, &[step("/in", "/nobody_says")]);
    request.subscribe_deadline = Duration::from_secs(3);
    let error = run(&bag, &request).unwrap_err();
    assert_eq!(error.reason(), "NeverSubscribed");
    assert!(error.to_string().contains("nobody published /nobody_says within 3.0 s"), "{error}");

    let mut by_stamp = step("/in", "/answer");
    by_stamp.by = AnswerBy::Stamp;
    let error = run(&bag, &lockstep(&bag, &graph, &[by_stamp])).unwrap_err();
    assert_eq!(error.reason(), "ProtocolError");
}
