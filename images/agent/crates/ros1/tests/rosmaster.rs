//! Our master beside Debian's: the same answers to the same calls, and the same notices to nodes.
#![allow(clippy::unwrap_used)]
mod graph;

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};

use bagpipe_ros1::Value;
use graph::{Graph, free_ports};

const TMP: &str = env!("CARGO_TARGET_TMPDIR");

fn script(name: &str) -> String {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/rosmaster");
    folder.join(name).to_str().unwrap().to_owned()
}

#[test]
fn the_same_calls_have_the_same_answers_and_nodes_get_the_same_notices() {
    for seed in 0..8 {
        let [theirs, ours] = Graph::of_both(TMP);
        let seed = seed.to_string();
        let arguments = [&script("same_calls.py"), &theirs.uri, &ours.uri, &seed, "1500"];
        let printed = theirs.run("/usr/bin/python3", &arguments);
        let words: Vec<&str> = printed.split_whitespace().collect();
        assert_eq!(words[..2], ["equal", "1500"], "seed {seed}: {printed}");
        assert!(words[2].parse::<u64>().unwrap() > 12, "seed {seed}: {printed}");
    }
}

#[test]
fn the_uri_is_the_one_that_was_asked_and_no_node_can_end_it() {
    let graph = Graph::of_ours(TMP);
    let ask = "import sys, xmlrpc.client; m = xmlrpc.client.ServerProxy(sys.argv[1]); \
               print(m.getUri('/me')[2] == sys.argv[1], m.shutdown('/me', 'bye')[0], \
               m.getPid('/me')[0])";
    assert_eq!(graph.run("/usr/bin/python3", &["-c", ask, &graph.uri]).trim(), "True -1 1");
    assert_eq!(graph.client().get_pid().unwrap(), i64::from(std::process::id()));
}

#[test]
fn a_name_of_too_many_levels_is_refused_with_a_sentence() {
    let master = Graph::of_ours(TMP);
    let client = master.client();
    let deep = "/a".repeat(64);
    client.set_param(&deep, &Value::Int(1)).unwrap();
    assert_eq!(client.get_param(&deep).unwrap(), Value::Int(1));
    let error = client.set_param(&"/a".repeat(65), &Value::Int(1)).unwrap_err().to_string();
    assert!(error.contains("a parameter's name may have 64 levels"), "{error}");
}

#[test]
fn what_one_graph_holds_and_one_call_answers_has_a_bound() {
    let graph = Graph::of_ours(TMP);
    let printed = graph.run("/usr/bin/python3", &[&script("bounds.py"), &graph.uri]);
    let lines: Vec<&str> = printed.lines().collect();
    let expected = [
        "[1, 1, 1, -1]",
        "8 the answers before take more than 67108864 bytes",
        "[1, 1, 1, 1, 1, 1, 1, -1, -1]",
    ];
    assert_eq!(lines, expected);
    let client = graph.client();
    assert_eq!(client.get_param("/0").unwrap(), Value::String("x".repeat(8 << 20)));
}

#[test]
fn a_free_port_stays_free_while_others_start_processes() {
    // Who forks has what is open in this process for a moment, a listener of a probe among it.
    let over = AtomicBool::new(false);
    let starts = || {
        for _ in (0..20_000).take_while(|_| !over.load(Ordering::Relaxed)) {
            assert!(Command::new("/bin/true").status().unwrap().success());
        }
    };
    std::thread::scope(|scope| {
        let starting = [scope.spawn(starts), scope.spawn(starts)];
        let mut ports = BTreeSet::new();
        let taken = (0..300).find_map(|_| {
            let port = free_ports(1);
            ports.insert(port);
            TcpListener::bind(("127.0.0.1", port)).err().map(|error| (port, error))
        });
        over.store(true, Ordering::Relaxed);
        starting.into_iter().for_each(|one| one.join().unwrap());
        assert!(taken.is_none(), "{taken:?}");
        assert_eq!(ports.len(), 300);
    });
}
