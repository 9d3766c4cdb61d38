//! Sessions that go wrong before anything is started: each is refused with a reason, and the
//! slot takes the next one.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::os::unix::fs::PermissionsExt;
use std::time::{Duration, Instant};

use bagpipe_wire::{End, FrameType, from_map, to_map};
use worker::*;

/// The slot is free: a session that is refused at once shows it.
fn assert_free(agent: &Agent) {
    let begun = Instant::now();
    let mut link = agent.greet(0, agent.case("true", &[]));
    send(&mut link, FrameType::File, b"\xc0");
    assert_eq!(answer(&mut link).abort().reason, "ProtocolError");
    assert!(begun.elapsed() < Duration::from_secs(20), "{:?}", begun.elapsed());
}

#[test]
fn pipes_are_there_soon_and_for_everybody() {
    let agent = Agent::start(3);
    println!("start to ready, three slots: {:?}", agent.ready_after);
    assert!(agent.ready_after < Duration::from_secs(30), "{:?}", agent.ready_after);
    for slot in 0..3 {
        for name in ["to-agent", "from-agent", "lease"] {
            let found = std::fs::metadata(agent.slot(slot).join(name)).unwrap();
            assert_eq!(found.permissions().mode() & 0o777, 0o666, "{name}");
        }
        let folder = std::fs::metadata(agent.slot(slot)).unwrap().permissions().mode();
        assert_eq!(folder & 0o777, 0o755);
    }
    assert_eq!(agent.slot_processes().len(), 3);
}

#[test]
fn a_worker_that_dies_leaves_a_slot_for_the_next() {
    let agent = Agent::start(1);
    for round in 0..5 {
        drop(agent.greet(0, agent.case("true", &[])));
        let mut link = agent.greet(0, agent.case("true", &[]));
        send(&mut link, FrameType::File, &to_map(&file_header(1 << 20)).unwrap());
        send(&mut link, FrameType::Data, &vec![round; 300_000]);
        drop(link);
    }
    assert_free(&agent);
}

#[test]
fn a_writer_that_dies_inside_a_frame_leaves_a_slot_for_the_next() {
    let agent = Agent::start(1);
    let link = agent.greet(0, agent.case("true", &[]));
    let path = agent.slot(0).join("to-agent");
    let raw = bagpipe_wire::fifo::open_writer(&path, soon(), &never).unwrap().unwrap();
    rustix::io::write(&raw, b"BPIP\x01\x02\0\0\x10\0\0\0\x01\0\0\0").unwrap();
    drop((raw, link));
    assert_free(&agent);
}

#[test]
fn a_successor_that_comes_before_the_end_is_seen_is_answered() {
    let agent = Agent::start(1);
    for round in 1..=20 {
        let dead = agent.greet(0, agent.case("true", &[]));
        let path = agent.slot(0).join("to-agent");
        let raw = bagpipe_wire::fifo::open_writer(&path, soon(), &never).unwrap().unwrap();
        // Inside a frame of 1 MiB; the successor's HELLO falls into what should be its payload.
        rustix::io::write(&raw, b"BPIP\x01\x03\0\0\0\0\x10\0\x01\0\0\0cccc begun").unwrap();
        let next = agent.open(0);
        drop((raw, dead));
        let mut next = next;
        let session = format!("{round:016x}feedfeedfeedfeed");
        hello(&mut next, &session, agent.case("true", &[]));
        // There never was an end of the stream; the HELLO is found all the same.
        agent.await_hello(0, &mut next, &session);
    }
}

#[test]
fn a_wrong_digest_is_refused() {
    let agent = Agent::start(1);
    let mut link = agent.greet(0, agent.case("true", &[]));
    let bag = chatter(3);
    send(&mut link, FrameType::File, &to_map(&file_header(bag.len() as u64)).unwrap());
    send(&mut link, FrameType::Data, &bag);
    let right = link.encoder().end();
    let wrong = End { digest: right.digest ^ 1, ..right };
    send(&mut link, FrameType::End, &to_map(&wrong).unwrap());
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "ProtocolError");
    assert!(abort.message.starts_with("END says"), "{}", abort.message);
    drop(link);
    assert_free(&agent);
}

#[test]
fn damage_in_a_frame_is_named_by_its_offset() {
    let agent = Agent::start(1);
    let link = &mut agent.greet(0, agent.case("true", &[]));
    let sent = {
        let case = agent.case("true", &[]);
        let software = "test".to_owned();
        let session = format!("{:032x}", 1);
        let hello = bagpipe_wire::WorkerHello { session, protocol: 1, software, case };
        20 + to_map(&hello).unwrap().len()
    };
    let path = agent.slot(0).join("to-agent");
    let raw = bagpipe_wire::fifo::open_writer(&path, soon(), &never).unwrap().unwrap();
    rustix::io::write(&raw, b"BPIP\x01\x0a\0\0\x10\0\0\0\x01\0\0\0abcd").unwrap();
    let abort = answer(link).abort();
    assert_eq!(abort.reason, "ProtocolError");
    let expected = format!(
        "the frame at byte {sent} of the stream has a wrong type: expected 1 to 9, found 10"
    );
    assert_eq!(abort.message, expected);
    assert_eq!(abort.session, format!("{:032x}", 1));
}

#[test]
fn a_declared_size_over_the_budget_is_refused_before_a_byte_of_it() {
    let agent = Agent::start_with(1, &["--memory-budget", "64MiB"], |_| {});
    let mut link = agent.greet(0, agent.case("true", &[]));
    send(&mut link, FrameType::File, &to_map(&file_header(1 << 50)).unwrap());
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "MemoryBudgetExceeded");
    let expected = "user.bag sends 1125899906842624 bytes, and a case may take 67108864: cut \
                    shorter fragments, or give `bagpipe-agent serve` a larger --memory-budget";
    assert_eq!(abort.message, expected);
}

#[test]
fn more_or_less_than_declared_is_refused() {
    let agent = Agent::start(1);
    for (declared, message) in
        [(9, "user.bag sends more than its 9 bytes"), (11, "user.bag has 11")]
    {
        let mut link = agent.greet(0, agent.case("true", &[]));
        feed_file(&mut link, &file_header(declared), b"ten bytes.");
        let abort = answer(&mut link).abort();
        assert_eq!(abort.reason, "ProtocolError");
        assert!(abort.message.starts_with(message), "{}", abort.message);
    }
}

#[test]
fn a_damaged_bag_is_named_by_the_users_own_offset() {
    let agent = Agent::start(1);
    let bag = chatter(50);
    let cut = 4117 + 700;
    let mut header = file_header(cut as u64);
    // The stream's first 4,117 bytes are made up; the rest lies at 1,000,000 in the file.
    header.ranges = vec![(4117, 1_000_000, (cut - 4117) as u64)];
    let mut link = agent.greet(0, agent.case("true", &[]));
    feed_file(&mut link, &header, &bag[..cut]);
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "BagUnreadable");
    assert!(abort.message.starts_with("user.bag at byte 1000700: expected "), "{}", abort.message);
    assert!(abort.message.contains("found the file's end"), "{}", abort.message);

    let mut link = agent.greet(0, agent.case("true", &[]));
    feed(&mut link, b"not a bag at all");
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "BagUnreadable");
    let expected = "user.bag at byte 0: expected the line \"#ROSBAG V2.0\", found \
                    \"not a bag at \"";
    assert_eq!(abort.message, expected);
}

#[test]
fn a_hello_that_cannot_be_is_refused_with_a_sentence() {
    let agent = Agent::start(1);
    let mut link = agent.open(0);
    hello(&mut link, "short", agent.case("true", &[]));
    let abort: bagpipe_wire::Abort = from_map(&first_frame(&mut link).unwrap().payload).unwrap();
    assert_eq!(abort.message, "a session is 32 hexadecimal digits, and \"short\" came");
    assert_eq!(abort.session, "short");
    drop(link);

    let mut link = agent.greet(0, rmpv::Value::Nil);
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "ProtocolError");
    assert!(abort.message.starts_with("HELLO has no case, and an agent's slot runs"), "{abort:?}");
    drop(link);

    let mut link = agent.greet(0, map(&[("id", "x".into())]));
    let abort = answer(&mut link).abort();
    assert_eq!(abort.reason, "ProtocolError");
    assert!(abort.message.starts_with("the case in HELLO cannot be understood"), "{abort:?}");
    drop(link);

    // Another agent, whose pipe has no earlier session that may end just now.
    let agent = Agent::start(1);
    let mut link = agent.open(0);
    send(&mut link, FrameType::Data, b"x");
    let frame = first_frame(&mut link).unwrap();
    let abort: bagpipe_wire::Abort = from_map(&frame.payload).unwrap();
    assert_eq!(abort.message, "expected HELLO, and DATA came");
}
