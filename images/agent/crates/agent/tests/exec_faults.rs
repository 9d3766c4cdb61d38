//! What programs of the exec engine do wrong is reported, and nothing that they started is left.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::time::{Duration, Instant};

use bagpipe_wire::{Encoder, End, FileHeader, FrameType, MAX_PAYLOAD, to_map};
use worker::exec::*;
use worker::*;

#[test]
fn a_program_that_ends_early_or_badly_is_reported_with_its_last_lines() {
    let agent = Agent::start(1);
    let abort = refusal(&agent, "echo 'no such road' >&2; exit 3");
    assert_eq!((&*abort.reason, abort.exit_status), ("StackCrashed", Some(3)));
    assert_eq!(abort.message, "the program ended with exit status 3");
    assert_eq!(abort.stderr, ["no such road"]);
    // All frames and END, and then the wrong status.
    let abort = refusal(&agent, "cat; exit 4");
    assert_eq!((&*abort.reason, abort.exit_status), ("StackCrashed", Some(4)));
    let abort = refusal(&agent, "kill -SEGV $$");
    assert_eq!((&*abort.reason, abort.signal), ("StackCrashed", Some(11)));
    let abort = refusal(&agent, "no-such-simulator");
    assert!(abort.message.contains("missing command"), "{}", abort.message);
    let abort = refusal(&agent, "cat >/dev/null");
    assert_eq!(abort.reason, "StackExited");
    let expected = "the program ended with exit status 0 and without END, after 0 bytes in 0 files";
    assert!(abort.message.starts_with(expected), "{}", abort.message);
    // HELLO and FILE whole, then a cut.
    let abort = refusal(&agent, "head -c 60; cat >/dev/null");
    assert_eq!(abort.reason, "StackProtocolError");
    assert!(abort.message.contains("stdout is damaged"), "{}", abort.message);
    assert!(abort.message.contains("is cut off"), "{}", abort.message);
}

#[test]
fn what_is_printed_to_stdout_is_shown_with_its_place() {
    let agent = Agent::start(1);
    let abort = refusal(&agent, "echo 'Loading the map ...'; cat");
    assert_eq!(abort.reason, "StackProtocolError");
    let expected = "at byte 0 the program's stdout holds no frame but \"Loading the map ...\\n";
    assert!(abort.message.starts_with(expected), "{}", abort.message);
    assert!(abort.message.ends_with("so print to stderr"), "{}", abort.message);
    // Behind whole frames, and shorter than a header, from a program that goes on.
    let folder = tempfile::tempdir().unwrap();
    let script = answering(folder.path(), "a", &[file("a", 1), data(b"x")]);
    let begun = Instant::now();
    let abort = refusal(&agent, &format!("{script}; echo hi; exec sleep 100"));
    let length = std::fs::metadata(folder.path().join("a")).unwrap().len();
    let expected = format!("at byte {length} the program's stdout holds no frame but \"hi\\n\"");
    assert!(abort.message.starts_with(&expected), "{}", abort.message);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    assert_eq!(agent.left(), []);
}

#[test]
fn frames_that_break_the_rules_are_refused() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let bad: [(Frames, &str, &str); 9] = [
        (vec![file("../x", 0)], "StackProtocolError", "\"../x\" is no plain file name"),
        (vec![file("a", 0), file("a", 0)], "StackProtocolError", "two files are named \"a\""),
        (vec![data(b"x")], "StackProtocolError", "DATA came before any FILE"),
        (vec![file("a", 2), data(b"x")], "StackProtocolError", "is to have 2 bytes, and 1 came"),
        (vec![file("a", 1), data(b"xy")], "StackProtocolError", "more than its 1 bytes"),
        (vec![file("a", 1 << 31)], "RecorderBudgetExceeded", "1073741824 bytes in all"),
        (vec![result(&[("x", f64::NAN.into())])], "StackProtocolError", "RESULT.x is NaN"),
        (vec![result(&[]), result(&[])], "StackProtocolError", "a second RESULT came"),
        (
            vec![(FrameType::Abort, to_map(&map(&[("message", "no licence".into())])).unwrap())],
            "StackAborted",
            "the program gave up: no licence",
        ),
    ];
    for (number, (frames, reason, words)) in bad.iter().enumerate() {
        let abort = refusal(&agent, &answering(folder.path(), &number.to_string(), frames));
        assert_eq!(abort.reason, *reason, "{}", abort.message);
        assert!(abort.message.contains(words), "{}", abort.message);
    }
    let end =
        map(&[("files", 0.into()), ("bytes", 0.into()), ("digest", 0.into()), ("input", 1.into())]);
    let end = to_map(&end).unwrap();
    let header = Encoder::new().header(FrameType::End, &end).unwrap();
    let path = folder.path().join("wrong-input");
    std::fs::write(&path, [&header[..], &end].concat()).unwrap();
    let abort = refusal(&agent, &format!("cat >/dev/null; cat {}", path.display()));
    assert!(abort.message.contains("END's `input` is not the digest"), "{}", abort.message);
    let mut wrong_end = Encoder::new();
    let end = to_map(&End { files: 1, bytes: 0, digest: 0 }).unwrap();
    let header = wrong_end.header(FrameType::End, &end).unwrap();
    let path = folder.path().join("wrong-end");
    std::fs::write(&path, [&header[..], &end].concat()).unwrap();
    let abort = refusal(&agent, &format!("cat {}", path.display()));
    assert!(abort.message.contains("END says End { files: 1"), "{}", abort.message);
}

#[test]
fn a_program_that_hangs_is_ended_at_its_deadline_with_all_that_it_started() {
    let agent = Agent::start(1);
    let daemon = "setsid sh -c 'trap \"\" INT TERM HUP; while :; do sleep 1; done' & ";
    let hang = format!("{daemon} trap '' INT TERM; echo stuck >&2; while :; do sleep 1; done");
    let begun = Instant::now();
    let deadlines = [("case", 6.0), ("stop", 1.0)];
    // More than the pipes hold: the worker is still writing when the case ends.
    let mut link = agent.greet(0, exec_case(&agent, &hang, &deadlines));
    let header = FileHeader { name: "in".to_owned(), size: 10_000_000, ranges: vec![] };
    send(&mut link, FrameType::File, &to_map(&header).unwrap());
    let given = Given::default().rest(&mut link);
    let abort = given.abort.expect("ABORT");
    assert_eq!(abort.reason, "CaseDeadlineExceeded");
    let expected = "the program was given at most 0 bytes of its input, which has more, has given \
                    back 0 bytes in 0 files, and did not end within the case's 6 s";
    assert!(abort.message.starts_with(expected), "{}", abort.message);
    assert_eq!(abort.stderr, ["stuck"]);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    assert_eq!(agent.left(), []);
    drop(link);
    assert!(run(&agent, "exec cat", &[], b"next").abort.is_none());
}

#[test]
fn a_daemon_that_a_good_program_leaves_behind_is_gone_after_the_case() {
    let agent = Agent::start(1);
    let script = "setsid sh -c 'trap \"\" INT TERM HUP; while :; do sleep 1; done' & cat";
    let given = run(&agent, script, &[("stop", 0.5)], b"input");
    assert_eq!(given.number("stack.exit_status"), 0);
    assert_eq!(agent.left(), []);
}

#[test]
fn a_program_that_never_exits_after_end_is_reported() {
    let agent = Agent::start(1);
    let abort = run(&agent, "cat; exec sleep 1000", &[("drain", 0.5)], b"x").abort.unwrap();
    assert_eq!(abort.reason, "StackNeverExited");
    assert!(abort.message.contains("still runs 500ms later"), "{}", abort.message);
    assert_eq!(agent.left(), []);
}

#[test]
fn a_worker_that_dies_ends_the_program_even_while_its_input_waits() {
    let agent = Agent::start(1);
    let mut link = agent.greet(0, exec_case(&agent, "exec sleep 1000", &[("stop", 1.0)]));
    let header = FileHeader { name: "in".to_owned(), size: 1 << 30, ranges: vec![] };
    send(&mut link, FrameType::File, &to_map(&header).unwrap());
    until("the program runs", Duration::from_secs(60), || !agent.left().is_empty());
    // The pipes hold less than this, so the agent has a frame that it cannot hand on.
    for _ in 0..2 {
        let soon = Instant::now() + Duration::from_millis(300);
        if link.send(FrameType::Data, &vec![0; MAX_PAYLOAD], soon, &never).is_err() {
            break;
        }
    }
    drop(link);
    until("all is gone", Duration::from_secs(60), || agent.left().is_empty());
    assert!(run(&agent, "exec cat", &[], b"next").abort.is_none());
}

#[test]
fn sigterm_ends_a_program_that_hangs() {
    let hang = "trap '' INT TERM; while :; do sleep 1; done";
    sigterm_ends(|agent| {
        let link = agent.greet(0, exec_case(agent, hang, &[]));
        // A second process means that the first one has set its traps.
        until("the program runs", Duration::from_secs(60), || agent.left().len() >= 2);
        link
    });
}
