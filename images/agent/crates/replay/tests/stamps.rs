//! Lock-step by stamp with real nodes: which answers are taken for which inputs.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::time::Duration;

use bagpipe_replay::{AnswerBy, Mode, Replayed, Step, Strength};
use bagpipe_rosbag::{Bag, Connection, MemoryChunkedFile};
use graph::{Graph, compile};
use scene::{TMP, bag_of, node, read_back, request, run};

/// Empty JointStates with these stamps, in seconds.
fn joint_states(seconds: &[u32]) -> Bag<MemoryChunkedFile> {
    let definition = "std_msgs/Header header\nstring[] name\nfloat64[] position\n\
                      float64[] velocity\nfloat64[] effort\n";
    let connection = Connection {
        topic: "/joint_states".to_owned(),
        datatype: "sensor_msgs/JointState".to_owned(),
        md5sum: "3066dcd76a6cfaef579bd0f34173e9fd".to_owned(),
        definition: definition.into(),
        caller_id: Some("/robot".to_owned()),
        ..Connection::default()
    };
    let message = |second: &u32| [&[0; 4], &second.to_le_bytes()[..], &[0; 24]].concat();
    bag_of(&[connection], seconds.iter().map(|second| (0, message(second))))
}

/// Plays in lock-step by stamp.
fn play(bag: &Bag<MemoryChunkedFile>, graph: &Graph, deadline: Duration) -> Replayed {
    let mut request = request(bag, &graph.uri);
    request.mode = Mode::Lockstep;
    request.record_topics = vec!["/relayed".to_owned()];
    request.steps = vec![Step {
        trigger: "/joint_states".to_owned(),
        answer: "/relayed".to_owned(),
        deadline,
        by: AnswerBy::Stamp,
        optional: false,
    }];
    run(bag, &request).unwrap()
}

#[test]
fn equal_zero_backward_and_late_stamps_are_each_answered_by_their_own() {
    let seconds = [0, 0, 5, 5, 3, 2_147_483_648, u32::MAX, u32::MAX, 1, 1];
    let bag = joint_states(&seconds);
    let relay = compile(TMP, &node("relay.cpp"));
    for python in [false, true] {
        let graph = Graph::start(TMP);
        let _relay = match python {
            true => graph.python(&node("relay.py"), &["/joint_states", "/relayed", "0", "0"]),
            false => graph.spawn(relay.to_str().unwrap(), &["/joint_states", "/relayed", "0", "0"]),
        };
        let replayed = play(&bag, &graph, Duration::from_secs(20));
        let step = &replayed.playback.steps[0];
        let counts = (step.released, step.answered, step.no_output, step.unmatched);
        assert_eq!(counts, (10, 10, 0, 0), "{step:?}");
        assert_eq!(replayed.playback.warnings, [] as [String; 0]);
        // Each answer lies in the step of its input: the same time, and the same stamp.
        let answers = read_back(&replayed);
        let stamps = answers.iter().map(|(_, time, data)| {
            (time / 1_000_000, u32::from_le_bytes(*data[4..].first_chunk().unwrap()))
        });
        let expected: Vec<(u64, u32)> = (0..).zip(seconds).collect();
        assert_eq!(stamps.collect::<Vec<_>>(), expected);
        // The node of roscpp can't say that it called back; its answers do.
        assert_eq!(replayed.ledger.strength, Some(Strength::Called), "{:?}", replayed.ledger);
    }
}

#[test]
fn a_stamp_of_the_far_future_satisfies_no_wait_and_is_reported() {
    let seconds: Vec<u32> = (100..130).collect();
    let bag = joint_states(&seconds);
    for (other, first) in [("4102444800", "4102444800.000000000"), ("7", "7.000000000")] {
        let graph = Graph::start(TMP);
        let arguments = ["/joint_states", "/relayed", "12", other];
        let _stamper = graph.python(&node("stamper.py"), &arguments);
        let replayed = play(&bag, &graph, Duration::from_secs(3));
        let step = &replayed.playback.steps[0];
        let counts = (step.released, step.answered, step.no_output, step.unmatched);
        assert_eq!(counts, (30, 28, 2, 2), "{step:?}");
        let warning = &replayed.playback.warnings[0];
        assert!(warning.starts_with("2 messages of /relayed have stamps"), "{warning}");
        assert!(warning.contains(&format!("the first {first} where 111.0")), "{warning}");
        assert_eq!(replayed.recorded.messages, 30);
    }
}

#[test]
fn an_answer_that_comes_when_the_next_input_is_out_is_late_and_not_that_one_s() {
    let seconds: Vec<u32> = (100..125).collect();
    let bag = joint_states(&seconds);
    let graph = Graph::start(TMP);
    let _late = graph.python(&node("late_stamper.py"), &["/joint_states", "/relayed", "10"]);
    let replayed = play(&bag, &graph, Duration::from_secs(3));
    let step = &replayed.playback.steps[0];
    let counts = (step.released, step.answered, step.no_output, step.unmatched);
    assert_eq!(counts, (25, 23, 2, 2), "{step:?}");
    let warning = &replayed.playback.warnings[0];
    assert!(warning.starts_with("2 messages of /relayed have stamps"), "{warning}");
    assert!(warning.contains("the first 109.000000000 where 110.0"), "{warning}");
    // All were recorded, each where it came: the late ones in the step after their own.
    let answers = read_back(&replayed);
    let came = answers.iter().map(|(_, time, data)| {
        (time / 1_000_000, u32::from_le_bytes(*data[4..].first_chunk().unwrap()))
    });
    let step_of = |second| u64::from(second) - 100 + u64::from(matches!(second, 109 | 119));
    let expected: Vec<(u64, u32)> = seconds.iter().map(|s| (step_of(*s), *s)).collect();
    assert_eq!(came.collect::<Vec<_>>(), expected);
}
