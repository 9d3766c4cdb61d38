//! Sessions over real named pipes.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use bagpipe_wire::fifo::{self, Readiness};
use bagpipe_wire::{Duplex, FrameType, PipeError};

fn soon() -> Instant {
    Instant::now() + Duration::from_secs(20)
}

fn never() -> bool {
    false
}

/// Both ends of one direction.
fn direction(path: &Path) -> (std::os::fd::OwnedFd, std::os::fd::OwnedFd) {
    fifo::make(path).unwrap();
    let reader = fifo::open_reader(path).unwrap();
    let writer = fifo::open_writer(path, soon(), &never).unwrap().unwrap();
    (reader, writer)
}

fn session(folder: &Path) -> (Duplex, Duplex) {
    let (to_agent_read, to_agent_write) = direction(&folder.join("to-agent"));
    let (from_agent_read, from_agent_write) = direction(&folder.join("from-agent"));
    let mut agent = Duplex::new(to_agent_read);
    agent.set_output(from_agent_write);
    let mut worker = Duplex::new(from_agent_read);
    worker.set_output(to_agent_write);
    (agent, worker)
}

#[test]
fn pipes_are_made_for_everybody_and_grow() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    std::fs::write(&path, "in the way").unwrap();
    fifo::make(&path).unwrap();
    fifo::make(&path).unwrap();
    let mode = std::fs::metadata(&path).unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o666);
    let reader = fifo::open_reader(&path).unwrap();
    // 4 KiB where the node's soft limit is used up.
    assert!([4096, 8192, 65536, 262_144].contains(&fifo::grow(&reader)));
}

#[test]
fn opening_without_a_reader_ends_at_the_deadline() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    fifo::make(&path).unwrap();
    let begun = Instant::now();
    let deadline = begun + Duration::from_millis(120);
    assert!(fifo::open_writer(&path, deadline, &never).unwrap().is_none());
    assert!(begun.elapsed() >= Duration::from_millis(120));
    let stopped = Instant::now();
    assert!(fifo::open_writer(&path, soon(), &|| true).unwrap().is_none());
    assert!(stopped.elapsed() < Duration::from_secs(10));
}

#[test]
fn a_reader_alone_is_not_at_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("pipe");
    fifo::make(&path).unwrap();
    let reader = fifo::open_reader(&path).unwrap();
    let moment = Duration::from_millis(20);
    assert_eq!(fifo::await_bytes(&reader, moment).unwrap(), Readiness::Nothing);
    let writer = fifo::open_writer(&path, soon(), &never).unwrap().unwrap();
    assert_eq!(fifo::await_bytes(&reader, moment).unwrap(), Readiness::Nothing);
    rustix::io::write(&writer, b"x").unwrap();
    assert_eq!(fifo::await_bytes(&reader, moment).unwrap(), Readiness::Bytes);
    rustix::io::read(&reader, &mut [0; 8]).unwrap();
    drop(writer);
    assert_eq!(fifo::await_bytes(&reader, moment).unwrap(), Readiness::HangUp);
}

#[test]
fn both_ends_may_write_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let (mut agent, mut worker) = session(folder.path());
    // Far more than both pipes hold: an end that did not read while it writes would hang.
    let payload = vec![0x5a; 1 << 20];
    let exchange = |end: &mut Duplex| {
        let mut received = 0;
        for _ in 0..3 {
            end.send(FrameType::Data, &payload, soon(), &never).unwrap();
        }
        while received < 3 {
            let frame = end.receive(soon(), &never).unwrap();
            assert_eq!((frame.kind, frame.sequence), (FrameType::Data, received));
            assert_eq!(frame.payload.len(), 1 << 20);
            received += 1;
        }
        assert_eq!(end.decoder().data_bytes(), 3 << 20);
        assert_eq!(end.decoder().digest(), end.encoder().end().digest);
    };
    std::thread::scope(|scope| {
        scope.spawn(|| exchange(&mut agent));
        exchange(&mut worker);
    });
}

#[test]
fn a_peer_that_goes_is_noticed_by_reader_and_writer() {
    let folder = tempfile::tempdir().unwrap();
    let (mut agent, mut worker) = session(folder.path());
    worker.send(FrameType::Hello, b"", soon(), &never).unwrap();
    drop(worker);
    assert_eq!(agent.receive(soon(), &never).unwrap().kind, FrameType::Hello);
    assert!(matches!(agent.receive(soon(), &never), Err(PipeError::PeerGone(1))));
    let sent = agent.send(FrameType::Data, b"x", soon(), &never);
    assert!(matches!(sent, Err(PipeError::PeerGone(1))), "{sent:?}");
}

#[test]
fn a_peer_that_stalls_meets_the_deadline_and_cancellation() {
    let folder = tempfile::tempdir().unwrap();
    let (mut agent, _worker) = session(folder.path());
    let short = || Instant::now() + Duration::from_millis(100);
    assert!(matches!(agent.receive(short(), &never), Err(PipeError::Deadline("send"))));
    assert!(matches!(agent.receive(soon(), &|| true), Err(PipeError::Cancelled)));
    let payload = vec![1; 1 << 20];
    let sent = agent.send(FrameType::Data, &payload, short(), &never);
    assert!(matches!(sent, Err(PipeError::Deadline("read"))), "{sent:?}");
}

#[test]
fn an_offer_to_a_full_pipe_is_left_out_whole() {
    let folder = tempfile::tempdir().unwrap();
    let (mut agent, mut worker) = session(folder.path());
    let mut taken = 0;
    while agent.offer(FrameType::Metric, &[9; 1000]).unwrap() {
        taken += 1;
    }
    assert!((3..300).contains(&taken), "{taken}");
    for number in 0..taken {
        assert_eq!(worker.receive(soon(), &never).unwrap().sequence, number);
    }
    // The frame that was left out took no number.
    agent.send(FrameType::Result, b"", soon(), &never).unwrap();
    assert_eq!(worker.receive(soon(), &never).unwrap().sequence, taken);
}

#[test]
fn a_frame_cut_by_the_end_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (mut agent, worker) = session(folder.path());
    let writer = fifo::open_writer(&folder.path().join("to-agent"), soon(), &never).unwrap();
    rustix::io::write(writer.as_ref().unwrap(), b"BPIP\x01").unwrap();
    drop((writer, worker));
    let error = agent.receive(soon(), &never).unwrap_err();
    assert_eq!(
        error.to_string(),
        "the frame at byte 0 of the stream is cut off: expected 20 bytes of header, \
         found the end after 5"
    );
}
