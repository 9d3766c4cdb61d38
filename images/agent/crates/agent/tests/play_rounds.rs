//! `play` of several bags, several times, and with pauses.
#![allow(clippy::unwrap_used, clippy::expect_used)]
// The graph and the worker take ports by the same rule.
#![allow(clippy::duplicate_mod)]

#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod worker;

use std::io::{BufRead, BufReader, Write};
use std::path::PathBuf;
use std::process::Stdio;

use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use graph::{Graph, Process, wait_until};
use worker::without_ros;

const TMP: &str = env!("CARGO_TARGET_TMPDIR");
const AGENT: &str = env!("CARGO_BIN_EXE_bagpipe-agent");

fn chatter(graph: &Graph, name: &str, count: u64) -> String {
    let path = graph.folder.join(name);
    std::fs::write(&path, worker::chatter(count)).unwrap();
    path.display().to_string()
}

/// A node of the replay tests on /chatter.
fn node(graph: &Graph, name: &str, more: &[&str]) -> Process {
    let nodes = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap())
        .join("../replay/tests/nodes");
    let script: PathBuf = nodes.join(name);
    graph.python(&script, &[&["/chatter"], more].concat())
}

fn texts(graph: &Graph, name: &str) -> Vec<String> {
    let bytes = std::fs::read(graph.folder.join(name)).unwrap();
    let bag = Bag::open(MemoryChunkedFile::new(bytes)).unwrap();
    let timeline = bag.timeline(|_| true).unwrap();
    timeline.iter().map(|m| String::from_utf8(m.data[4..].to_vec()).unwrap()).collect()
}

#[test]
fn two_bags_are_one_and_each_round_has_its_own_ledger_and_recording() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let (short, long) = (chatter(&graph, "short.bag", 20), chatter(&graph, "long.bag", 50));
    let _words = node(&graph, "words.py", &[]);
    let mut arguments = vec!["play", &long, &short, "--immediate", "--wait-for", "words"];
    arguments.extend(["--repeat", "3", "--json"]);
    arguments.extend(["--record", "/answer", "--output", "answers.bag"]);
    let output = graph.run(AGENT, &arguments);
    let rounds: Vec<&str> = output.lines().collect();
    assert_eq!(rounds.len(), 3, "{output}");
    let ledger = r#""ledger":{"sent":70,"lead_in":0,"received":70,"dropped":0"#;
    assert!(rounds.iter().all(|round| round.contains(ledger)), "{output}");
    // Both bags have a message at each of the first 20 times.
    let twice = (0..20).flat_map(|number| [number, number]);
    let expected: Vec<String> =
        twice.chain(20..50).map(|number| format!("message {number}")).collect();
    for round in 0..3 {
        assert_eq!(texts(&graph, &format!("answers_{round}.bag")), expected);
    }
    assert!(!graph.folder.join("answers.bag").exists());
}

#[test]
fn a_round_that_lost_something_is_named_and_makes_the_status_1() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = chatter(&graph, "chatter.bag", 60);
    let _words = node(&graph, "words.py", &[]);
    let leaver = node(&graph, "leaver.py", &["10"]);
    wait_until("both nodes have subscribed", || {
        let state = graph.client().get_system_state().unwrap();
        state.subscribers.get("/chatter").is_some_and(|nodes| nodes.len() == 2)
    });
    // The one that leaves is there for the first round alone: it can only be given time to connect.
    let start = ["--wait-for", "words", "--delay", "1"];
    let mut command = graph.command(AGENT, &["play", &bag, "--repeat", "2"]);
    let output = command.args(start).output().unwrap();
    leaver.wait_for("leaving 10");
    let (report, complaint) = (String::from_utf8(output.stdout), String::from_utf8(output.stderr));
    let (report, complaint) = (report.unwrap(), complaint.unwrap());
    assert_eq!(output.status.code(), Some(1), "{report}{complaint}");
    let (first, second) = report.split_once("round 2 of 2\n").unwrap();
    assert!(first.starts_with("round 1 of 2\n60 messages in ") && first.contains("/leaver"));
    assert!(second.starts_with("60 messages in ") && second.contains("60 received, 0 dropped"));
    assert!(!second.contains("/leaver"), "{report}");
    let losses = complaint.trim_end().rsplit(": lost were ").next().unwrap();
    assert!(losses.ends_with(" in round 1 of 2") && !losses.contains(','), "{complaint}");
}

#[test]
fn a_pause_ends_with_each_line_on_stdin() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = chatter(&graph, "chatter.bag", 2);
    let words = node(&graph, "words.py", &[]);
    let mut command = graph.command(AGENT, &["play", &bag, "--pause", "/chatter"]);
    let mut player = command.args(["--wait-for", "words"]).stdin(Stdio::piped()).spawn().unwrap();
    let mut stdin = player.stdin.take().unwrap();
    let mut errors = BufReader::new(player.stderr.take().unwrap()).lines();
    for number in 0..2 {
        let line = errors.next().unwrap().unwrap();
        assert_eq!(line, "paused before a message of /chatter; Enter goes on");
        assert!(!words.lines().contains(&format!("word message {number}")));
        stdin.write_all(b"\n").unwrap();
        words.wait_for(&format!("word message {number}"));
    }
    assert!(player.wait().unwrap().success());
}
