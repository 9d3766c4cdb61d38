//! A node that writes over the ledger costs its case, and nothing else.
#![allow(clippy::unwrap_used)]

mod standin;

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, Event, Ledger, LedgerError, Mark, Waited};
use standin::{Client, Node};

const PROCESSES: u64 = 128;
const ENDPOINTS: u64 = PROCESSES + 512 * 64;
const OWN: u64 = ENDPOINTS + 4096 * 768;
const END: u64 = OWN + 4096 * 8;

/// The memory, as any node can open it.
fn opened(ledger: &Ledger) -> File {
    let [(_, path), _] = ledger.environment("/ledger.so".as_ref(), None);
    File::options().read(true).write(true).open(path).unwrap()
}

/// A ledger with one process (alive), its subscription and its publisher.
fn filled() -> (Ledger, Node, File) {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 3", "spin / 1"]);
    let file = opened(&ledger);
    (ledger, node, file)
}

fn damage(ledger: &Ledger) -> (u64, String) {
    match ledger.endpoints().and_then(|_| ledger.processes()) {
        Err(LedgerError::Damaged { offset, what }) => (offset as u64, what),
        other => panic!("{other:?}"),
    }
}

#[test]
fn what_can_not_be_is_refused_with_the_place_where_it_stands() {
    let (ledger, _node, file) = filled();
    let slot = ENDPOINTS;
    let whole: [(u64, Vec<u8>, u64, &str); 16] = [
        (PROCESSES + 4, vec![9], PROCESSES + 4, "9 is no state of a process"),
        (PROCESSES + 32, vec![4], PROCESSES + 32, "4 ends of 0 starts"),
        (PROCESSES + 56, vec![3], PROCESSES + 56, "3 is no exit status"),
        (PROCESSES + 56, vec![0, 2], PROCESSES + 56, "512 is no exit status"),
        (slot, vec![77], slot, "77 is no phase of an endpoint"),
        (slot + 1, vec![200, 1], slot, "process 456 has it, which there is not"),
        (slot + 1, vec![255, 255, 255], slot, "process 16777215 has it, which there is not"),
        (slot + 648, vec![4], slot + 648, "4 takes by their publishers of 3 takes"),
        (slot + 8, vec![3], slot + 8, "3 is no kind of endpoint"),
        (slot + 88, vec![4], slot + 88, "4 ends of 3 starts"),
        (slot + 64, vec![0, 0, 0, 0, 0, 0, 0, 0x80], slot + 64, "messages of"),
        (slot + 130, vec![10], slot + 130, "byte 10 in the name of a topic"),
        (slot + 128, vec![b'a'; 256], slot + 384, "the name of a topic does not end"),
        (slot + 128, vec![0], slot + 128, "a topic without a name"),
        (slot + 386, vec![200], slot + 386, "byte 200 in the name of a node"),
        (slot + 384, vec![b'a'; 256], slot + 640, "the name of a node does not end"),
    ];
    for (at, bytes, offset, what) in whole {
        let mut kept = vec![0; bytes.len()];
        file.read_exact_at(&mut kept, at).unwrap();
        file.write_all_at(&bytes, at).unwrap();
        let (place, sentence) = damage(&ledger);
        assert_eq!(place, offset, "{sentence}");
        assert!(sentence.contains(what), "{sentence}");
        file.write_all_at(&kept, at).unwrap();
        assert_eq!(ledger.endpoints().unwrap().len(), 2);
    }
}

#[test]
fn its_length_is_sealed() {
    let (ledger, mut node, file) = filled();
    assert!(file.set_len(0).is_err() && file.set_len(END + 1).is_err());
    assert_eq!(file.metadata().unwrap().len(), END);
    node.obey(&["publish /scan 1", "spin / 1"]);
    assert_eq!(ledger.endpoints().unwrap()[0].counts.ended, 4);
}

#[test]
fn a_ledger_of_another_version_is_left_alone() {
    let ledger = Ledger::new().unwrap();
    for (at, value) in [(0, 7), (8, 1), (12, 1), (16, 1)] {
        let file = opened(&ledger);
        let mut kept = [0];
        file.read_exact_at(&mut kept, at).unwrap();
        file.write_all_at(&[value], at).unwrap();
        let mut node = Node::start(Client::Rclcpp, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 3", "spin / 1"]);
        assert_eq!(node.report("/scan").called, 3);
        assert_eq!(ledger.processes().unwrap(), []);
        file.write_all_at(&kept, at).unwrap();
    }
}

/// Calls everything, whose results may be anything.
fn use_all(ledger: &Ledger, some: &[Endpoint]) -> usize {
    let mut refused = usize::from(ledger.processes().is_err());
    refused += usize::from(ledger.endpoints().is_err());
    refused += some.iter().filter(|one| ledger.counts(one.id).is_err()).count();
    refused += usize::from(ledger.strength_of(std::process::id()).is_err());
    let _any = ledger.unlisted();
    refused += usize::from(ledger.quiet(&Mark::default(), &[("/scan", 1)]).is_err());
    let soon = Instant::now() + Duration::from_millis(1);
    let processes: Vec<_> = some.iter().map(|one| one.process).collect();
    let waited = ledger.wait(&[Event::Ended], &processes, soon, |_| Ok(false)).unwrap();
    assert_ne!(waited, Waited::Held);
    refused + usize::from(ledger.retire().is_err())
}

#[test]
fn any_bytes_are_an_answer_or_an_error_and_never_a_panic() {
    let (ledger, node, file) = filled();
    let some = ledger.endpoints().unwrap();
    drop(node);
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    let mut refused = 0;
    for round in 0..300 {
        // A few slots at the beginning are in use; the rest would be noise that refuses at once.
        let (from, length) = match round % 3 {
            0 => (random() % 128, 128),
            1 => (PROCESSES + random() % 256, 64),
            _ => (ENDPOINTS + random() % 1536, 8),
        };
        let bytes: Vec<u8> = (0..length).map(|_| random() as u8).collect();
        file.write_all_at(&bytes, from).unwrap();
        refused += use_all(&ledger, &some);
    }
    assert!(refused > 50, "{refused}");
    file.write_all_at(&vec![0xff; END as usize], 0).unwrap();
    assert!(use_all(&ledger, &some) >= 3);
}

#[test]
fn a_node_whose_ledger_is_overwritten_runs_on() {
    let (ledger, mut node, file) = filled();
    file.write_all_at(&vec![0xff; END as usize], 0).unwrap();
    node.obey(&["flood /scan 2000 2", "sub /more 1", "destroy /more", "churn /more 10"]);
    let own = node.report("/scan");
    assert_eq!(own.called + own.overwritten, 2003);
    file.write_all_at(&vec![0; END as usize], 0).unwrap();
    node.obey(&["flood /scan 2000 2", "sub /more 1", "destroy /more", "churn /more 10"]);
    let own = node.report("/scan");
    assert_eq!(own.called + own.overwritten, 4003);
    drop(ledger);
    node.obey(&["publish /scan 1", "spin / 1"]);
}
