//! Whole cases: what a stack does wrong is reported, and nothing that
//! it started is left.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::process::Command;
use std::time::{Duration, Instant};

use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use rmpv::Value;
use worker::*;

/// Ignores everything, and starts a daemon that does so too.
const STUBBORN: &str = r#"
trap '' INT TERM
(trap '' INT TERM; setsid sh -c 'trap "" INT TERM HUP; while :; do sleep 1; done' &) &
echo stubborn >&2
while :; do sleep 1; done
"#;

#[test]
fn a_case_is_played_recorded_and_proved() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let gain = vec![("/echo/gain".into(), Value::F64(2.5))];
    for round in 0..2 {
        let case = agent.case_with(ECHO, &[], gain.clone());
        let (result, bag) = agent.run(0, case, &chatter(200)).result();
        let number = |path| at(&result, path).as_u64().unwrap();
        assert_eq!((number("ledger.sent"), number("ledger.received")), (200, 200));
        assert_eq!((number("ledger.dropped"), number("ledger.lead_in")), (0, 0));
        assert_eq!(number("recorded.messages"), 200, "round {round}: {result}");
        assert_eq!(at(&result, "stack.ended_by").as_str(), Some("agent"));
        let stderr = at(&result, "stack.stderr").as_array().unwrap();
        assert!(stderr.iter().any(|line| line.as_str() == Some("gain is 2.5")), "{stderr:?}");
        let bag = Bag::open(MemoryChunkedFile::new(bag)).unwrap();
        assert!(bag.loss().is_none());
        let timeline = bag.timeline(|each| each.topic == "/echo").unwrap();
        let last = timeline.iter().last().unwrap();
        assert_eq!(&last.data[4..], b"echo of message 199");
        assert_eq!(agent.left(), []);
        println!("timings: {}", at(&result, "timings"));
    }
}

#[test]
fn in_lockstep_two_cases_record_the_same_bytes_and_say_what_came_of_the_steps() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let step = |answer: &str, deadline: f64| {
        map(&[
            ("trigger", "/chatter".into()),
            ("answer", answer.into()),
            ("deadline", deadline.into()),
        ])
    };
    let case = |steps: Vec<Value>| {
        let Value::Map(mut case) = agent.case(ECHO, &[]) else { panic!("a case is a map") };
        case.retain(|(key, _)| key.as_str() != Some("playback"));
        let steps = Value::Array(steps);
        case.push(("playback".into(), map(&[("mode", "lockstep".into()), ("steps", steps)])));
        Value::Map(case)
    };
    let mut bags = Vec::new();
    for _ in 0..2 {
        let all = case(vec![step("/echo", 60.0)]);
        let (result, bag) = agent.run(0, all, &chatter(150)).result();
        let steps = at(&result, "playback.steps.0");
        let number = |key| at(steps, key).as_u64().unwrap();
        assert_eq!((number("released"), number("answered"), number("no_output")), (150, 150, 0));
        assert_eq!(at(steps, "triggers.0").as_str(), Some("/chatter"));
        bags.push(bag);
    }
    assert_eq!(bags[0], bags[1]);
    let abort = agent.run(0, case(vec![step("/echo", -1.0)]), &chatter(1)).abort();
    assert_eq!(abort.reason, "ProtocolError");
    assert!(abort.message.contains("the deadline of playback.steps[0]"), "{}", abort.message);
    assert_eq!(agent.left(), []);
}

#[test]
fn nodes_are_waited_for_by_name() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let case = |node: &str, seconds: f64| {
        let Value::Map(mut case) = agent.case(ECHO, &[("subscribe", seconds)]) else { panic!() };
        case.retain(|(key, _)| key.as_str() != Some("playback"));
        let wait_for = Value::Array(vec![node.into()]);
        case.push(("playback".into(), map(&[("mode", "max".into()), ("wait_for", wait_for)])));
        Value::Map(case)
    };
    let (result, _) = agent.run(0, case("/echo", 100.0), &chatter(5)).result();
    assert_eq!(at(&result, "ledger.received").as_u64(), Some(5));
    let abort = agent.run(0, case("/nobody", 5.0), &chatter(5)).abort();
    assert_eq!(abort.reason, "NeverSubscribed");
    assert!(abort.message.contains("waited in vain for /nobody"), "{}", abort.message);
}

#[test]
fn a_crash_that_the_job_allows_is_no_reason_for_what_goes_wrong_later() {
    let agent = Agent::start(1);
    let case = |allowed: &[&str]| {
        let crashes = "sh -c 'sleep 1; kill -s SEGV $$' & exec sleep 1000";
        let Value::Map(mut case) = agent.case(crashes, &[("subscribe", 5.0)]) else { panic!() };
        case.retain(|(key, _)| key.as_str() != Some("faults"));
        case.push(("faults".into(), map(&[("allow", strings(allowed))])));
        Value::Map(case)
    };
    let abort = agent.run(0, case(&[]), &chatter(5)).abort();
    assert_eq!(abort.reason, "StackCrashed", "{}", abort.message);
    let abort = agent.run(0, case(&["StackCrashed"]), &chatter(5)).abort();
    assert_eq!(abort.reason, "NeverSubscribed", "{}", abort.message);
}

#[test]
fn two_slots_run_at_once() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(2);
    let run = |slot: u32| {
        let (result, _) = agent.run(slot, agent.case(ECHO, &[]), &chatter(100)).result();
        let number = |path| at(&result, path).as_u64().unwrap();
        (number("ledger.sent"), number("ledger.received"), number("recorded.messages"))
    };
    // Both are greeted before either is fed, so they do overlap.
    let mut links = [0, 1].map(|slot| agent.greet(slot, agent.case(ECHO, &[])));
    for link in &mut links {
        feed(link, &chatter(100));
    }
    for link in &mut links {
        let (result, _) = answer(link).result();
        assert_eq!(at(&result, "ledger.received").as_u64(), Some(100));
    }
    drop(links);
    assert_eq!(run(1), (100, 100, 100));
    assert_eq!(agent.left(), []);
}

#[test]
fn a_stack_that_crashes_is_reported_with_its_last_lines() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let script = "echo on stdout; echo first >&2; echo 'no such calibration' >&2; exit 3";
    let abort = agent.run(0, agent.case(script, &[]), &chatter(5)).abort();
    assert_eq!(abort.reason, "StackCrashed");
    assert_eq!((abort.exit_status, abort.signal), (Some(3), None));
    assert!(abort.message.starts_with("the stack's command ("), "{}", abort.message);
    assert!(abort.message.contains("ended with exit status 3"), "{}", abort.message);
    assert_eq!(abort.stderr, ["first", "no such calibration"]);
    assert_eq!(abort.stdout, ["on stdout"]);
    let abort = agent.run(0, agent.case("kill -SEGV $$", &[]), &chatter(5)).abort();
    assert_eq!((abort.exit_status, abort.signal), (None, Some(11)));
    let abort = agent.run(0, agent.case("exit 0", &[]), &chatter(5)).abort();
    assert_eq!((&*abort.reason, abort.exit_status), ("StackExited", Some(0)));
    let abort = agent.run(0, agent.case("no-such-node", &[]), &chatter(5)).abort();
    assert_eq!(abort.exit_status, Some(127));
    assert!(abort.message.contains("missing command"), "{}", abort.message);
}

#[test]
fn a_command_that_is_not_there_is_named() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let mut case = agent.case("", &[]);
    if let Value::Map(entries) = &mut case {
        let stack = entries.iter_mut().find(|(key, _)| key.as_str() == Some("stack")).unwrap();
        stack.1 = map(&[("command", strings(&["no-such-node", "--fast"]))]);
    }
    let abort = agent.run(0, case, &chatter(5)).abort();
    assert_eq!(abort.reason, "CommandNotFound");
    let expected = "no-such-node is in no folder of PATH (/";
    assert!(abort.message.starts_with(expected), "{}", abort.message);
}

#[test]
fn an_image_without_rosmaster_is_refused_with_what_to_install() {
    let agent = Agent::start_with(1, &[], |command| {
        command.env("PATH", "/nowhere");
    });
    let abort = agent.run(0, agent.case_with_rosmaster("true"), &chatter(5)).abort();
    assert_eq!(abort.reason, "RosMasterNotFound");
    let expected = "this image has no rosmaster (rosmaster is in no folder of PATH (/nowhere)): \
                    install the package python3-rosmaster (Debian, Ubuntu) or \
                    ros-noetic-rosmaster (packages.ros.org) in it, or write \
                    stack.ros1.master: agent";
    assert_eq!(abort.message, expected);
}

#[test]
fn a_rosmaster_that_fails_is_reported_with_its_last_lines() {
    let folder = tempfile::tempdir().unwrap();
    let fake = folder.path().join("rosmaster");
    std::fs::write(&fake, "#!/bin/sh\necho 'No module named rosgraph' >&2\nexit 1\n").unwrap();
    assert!(Command::new("chmod").arg("+x").arg(&fake).status().unwrap().success());
    let agent = Agent::start_with(1, &[], |command| {
        command.env("PATH", folder.path());
    });
    let abort = agent.run(0, agent.case_with_rosmaster("true"), &chatter(5)).abort();
    assert_eq!(abort.reason, "RosMasterFailed");
    assert_eq!(abort.stderr, ["No module named rosgraph"]);
    assert!(abort.message.contains("exit status 1"), "{}", abort.message);
}

#[test]
fn a_stack_is_played_to_by_either_master() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    for case in [agent.case(ECHO, &[]), agent.case_with_rosmaster(ECHO)] {
        let (result, _) = agent.run(0, case, &chatter(50)).result();
        assert_eq!(at(&result, "ledger.received").as_u64(), Some(50));
        assert_eq!(at(&result, "recorded.messages").as_u64(), Some(50));
        println!("{}", at(&result, "timings"));
        assert_eq!(agent.left(), []);
    }
}

#[test]
fn a_port_that_another_program_has_is_named() {
    let agent = Agent::start(1);
    let _other = std::net::TcpListener::bind(("127.0.0.1", agent.master_port)).unwrap();
    let abort = agent.run(0, agent.case("true", &[]), &chatter(5)).abort();
    assert_eq!(abort.reason, "RosMasterFailed");
    let expected = format!("port {} is taken by another program", agent.master_port);
    assert!(abort.message.contains(&expected), "{}", abort.message);
}

#[test]
fn a_stubborn_stack_and_its_daemon_are_gone_after_the_case() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let case = agent.case(STUBBORN, &[("subscribe", 5.0), ("stop", 1.0)]);
    let begun = Instant::now();
    let abort = agent.run(0, case, &chatter(5)).abort();
    assert_eq!(abort.reason, "NeverSubscribed");
    assert_eq!(abort.stderr, ["stubborn"]);
    assert_eq!(agent.left(), []);
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
}

#[test]
fn the_case_deadline_ends_a_case() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let case = agent.case("exec sleep 1000", &[("subscribe", 100.0), ("case", 2.0)]);
    let begun = Instant::now();
    let abort = agent.run(0, case, &chatter(5)).abort();
    assert_eq!(abort.reason, "CaseDeadlineExceeded");
    assert!(begun.elapsed() < Duration::from_secs(60), "{:?}", begun.elapsed());
    assert_eq!(agent.left(), []);
}

/// Feeds a case whose stack never ends, and waits until that runs: a second process means that the
/// first one has set its traps.
fn started(agent: &Agent, script: &str) -> bagpipe_wire::Duplex {
    let deadlines = [("subscribe", 100.0), ("stop", 1.0)];
    let mut link = agent.greet(0, agent.case(script, &deadlines));
    feed(&mut link, &chatter(5));
    until("the stack runs", Duration::from_secs(60), || agent.left().len() >= 2);
    link
}

#[test]
fn a_worker_that_dies_ends_its_case_and_frees_the_slot() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    drop(started(&agent, STUBBORN));
    let gone = until("all is gone", Duration::from_secs(60), || agent.left().is_empty());
    println!("gone after {gone:?}");
    let (result, _) = agent.run(0, agent.case(ECHO, &[]), &chatter(20)).result();
    assert_eq!(at(&result, "ledger.received").as_u64(), Some(20));
}

#[test]
fn sigterm_ends_everything() {
    if without_ros() {
        return;
    }
    sigterm_ends(|agent| started(agent, STUBBORN));
}

#[test]
fn a_slot_that_is_killed_takes_its_stack_with_it_and_starts_again() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let mut link = started(&agent, STUBBORN);
    let slot = agent.slot_processes()[0];
    let folder = std::env::temp_dir().join(format!("bagpipe-case-0-{slot}"));
    assert!(folder.is_dir(), "{}", folder.display());
    assert!(Command::new("kill").args(["-9", &slot.to_string()]).status().unwrap().success());
    assert!(matches!(answer(&mut link), Answer::Gone(_)));
    drop(link);
    until("all is gone", Duration::from_secs(60), || agent.left().is_empty() && !folder.exists());
    until("a new process", Duration::from_secs(60), || agent.slot_processes() != [slot]);
    let (result, _) = agent.run(0, agent.case(ECHO, &[]), &chatter(20)).result();
    assert_eq!(at(&result, "ledger.received").as_u64(), Some(20));
}
