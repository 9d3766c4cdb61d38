//! The exec engine with programs of a line each: `cat` is one, since what goes in may come out.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::time::Instant;

use bagpipe_wire::{FrameType, HEADER_BYTES, MAX_PAYLOAD, PROTOCOL, to_map};
use rmpv::Value;
use worker::exec::*;
use worker::*;

#[test]
fn what_goes_in_comes_out_byte_for_byte() {
    // Without any rosmaster: the engine needs none.
    let agent = Agent::start_with(1, &[], |command| {
        command.env("PATH", "/usr/bin:/bin");
    });
    let input: Vec<u8> =
        (0..3_000_000u32).map(|number| (number.wrapping_mul(number) >> 5) as u8).collect();
    for round in 0..2 {
        let given = run(&agent, "exec cat", &[], &input);
        assert_eq!(given.files.len(), 1, "round {round}: {:?}", given.abort);
        assert_eq!(given.files[0].0, "in");
        assert!(given.files[0].1 == input);
        assert_eq!((given.number("bytes_in"), given.number("bytes_out")), (3_000_000, 3_000_000));
        assert_eq!((given.number("records_in"), given.number("records_out")), (1, 1));
        assert_eq!(given.number("files.0.size"), 3_000_000);
        assert_eq!(given.number("stack.exit_status"), 0);
        let result = given.result.unwrap();
        assert_eq!(at(&result, "engine").as_str(), Some("exec"));
        assert_eq!(at(&result, "stack.ended_by").as_str(), Some("itself"));
        assert!(at(&result, "program").is_nil());
        println!("timings: {}", at(&result, "timings"));
    }
    assert_eq!(agent.left(), []);
}

#[test]
fn the_program_is_greeted_with_its_case() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let seen = folder.path().join("seen");
    let script = format!("test $BAGPIPE_BINPIPE = 1 && tee {} | cat", seen.display());
    let given = run(&agent, &script, &[], b"some bytes");
    assert!(given.abort.is_none(), "{:?}", given.abort);
    let seen = std::fs::read(seen).unwrap();
    let length = u32::from_le_bytes(seen[8..12].try_into().unwrap()) as usize;
    assert_eq!((seen[5], &seen[12..16]), (FrameType::Hello as u8, &[0u8; 4][..]));
    let hello: Value = rmpv::decode::read_value(&mut &seen[HEADER_BYTES..][..length]).unwrap();
    assert_eq!(at(&hello, "protocol").as_u64(), Some(u64::from(PROTOCOL)));
    assert_eq!(at(&hello, "case.id").as_str(), Some("case-1"));
    assert_eq!(at(&hello, "session").as_str().unwrap().len(), 32);
    assert_eq!(at(&hello, "case.engine").as_str(), Some("exec"));
}

#[test]
fn many_files_and_the_programs_own_result_come_back() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let mut frames =
        vec![said(&[("outcome", "failed".into()), ("figures", map(&[("a", 1.5.into())]))])];
    for number in 0..500u64 {
        frames.push(file(&format!("track-{number}.csv"), number));
        if number > 0 {
            frames.push(data(&vec![number as u8; number as usize]));
        }
    }
    frames.push((FrameType::Metric, to_map(&map(&[("stage", "x".into())])).unwrap()));
    let given = run(&agent, &answering(folder.path(), "many", &frames), &[], b"input");
    assert_eq!(given.files.len(), 500, "{:?}", given.abort);
    for (number, (name, bytes)) in given.files.iter().enumerate() {
        assert_eq!(*name, format!("track-{number}.csv"));
        assert_eq!(*bytes, vec![number as u8; number]);
    }
    assert_eq!(given.metrics, 1);
    assert_eq!((given.number("records_out"), given.number("bytes_out")), (500, 499 * 500 / 2));
    let result = given.result.unwrap();
    assert_eq!(at(&result, "program.outcome").as_str(), Some("failed"));
    assert_eq!(at(&result, "program.figures.a").as_f64(), Some(1.5));
}

#[test]
fn a_file_may_begin_before_its_size_is_known() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let unsized_file = |name: &str| {
        let header = map(&[("name", name.into()), ("size", Value::Nil), ("fields", map(&[]))]);
        (FrameType::File, to_map(&header).unwrap())
    };
    let frames = [unsized_file("a"), data(b"xy"), data(b"z"), unsized_file("b"), file("c", 0)];
    let given = run(&agent, &answering(folder.path(), "unsized", &frames), &[], b"input");
    assert_eq!(given.files[0], ("a".to_owned(), b"xyz".to_vec()), "{:?}", given.abort);
    assert_eq!((given.number("files.0.size"), given.number("files.1.size")), (3, 0));
    assert_eq!((given.number("records_out"), given.number("bytes_out")), (3, 3));
}

#[test]
fn nothing_may_come_back_and_an_empty_file_may_go_in() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let given = run(&agent, &answering(folder.path(), "none", &[]), &[], b"");
    assert_eq!((given.number("records_out"), given.number("bytes_out")), (0, 0));
    assert_eq!((given.number("records_in"), given.number("bytes_in")), (1, 0));
}

#[test]
fn a_program_need_not_read_all_of_its_input() {
    let agent = Agent::start(1);
    let folder = tempfile::tempdir().unwrap();
    let script = answering(folder.path(), "early", &[file("a", 1), data(b"x")]);
    let script = script.replace("cat >/dev/null;", "exec 0</dev/null;");
    let given = run(&agent, &script, &[], &vec![7; 20_000_000]);
    assert_eq!(given.files, [("a".to_owned(), b"x".to_vec())], "{:?}", given.abort);
    assert!(given.number("bytes_in") < 20_000_000);
}

#[test]
fn a_flood_on_stderr_does_not_stop_the_frames() {
    // The agent passes every line on; here that goes nowhere, as with a log that is read fast.
    let agent = Agent::start_with(1, &[], |command| {
        command.stderr(std::process::Stdio::null());
    });
    let line = "0123456789abcdef0123456789abcde";
    let script = format!("(yes {line} | head -c 16000000; echo the end) >&2; cat");
    let begun = Instant::now();
    let given = run(&agent, &script, &[], b"input");
    let stderr = at(given.result.as_ref().unwrap(), "stack.stderr").as_array().unwrap().clone();
    assert_eq!(stderr.last().unwrap().as_str(), Some("the end"));
    assert!(stderr.len() <= 50);
    println!("16 MB of stderr took {:?}", begun.elapsed());
}

/// The most memory that a process has had, in bytes.
fn peak_memory(pid: u32) -> u64 {
    let status = std::fs::read_to_string(format!("/proc/{pid}/status")).unwrap();
    let line = status.lines().find(|line| line.starts_with("VmHWM")).unwrap();
    line.split_whitespace().nth(1).unwrap().parse::<u64>().unwrap() * 1024
}

#[test]
fn two_hundred_megabytes_pass_through_in_flat_memory() {
    let agent = Agent::start(1);
    let mut link = agent.greet(0, exec_case(&agent, "exec cat", &[]));
    let size = 200 * MAX_PAYLOAD as u64;
    let piece = vec![7; MAX_PAYLOAD];
    let begun = Instant::now();
    let given = Given { counted_only: true, ..Given::default() };
    let given = given.feed(&mut link, size as usize, (0..200).map(|_| &piece[..]));
    assert!(given.abort.is_none(), "{:?}", given.abort);
    assert_eq!((given.number("bytes_in"), given.number("bytes_out")), (size, size));
    let peak = peak_memory(agent.slot_processes()[0]);
    println!("{size} bytes in {:?}, at most {peak} bytes of memory", begun.elapsed());
    assert!(peak < 32 << 20, "{peak}");
}
