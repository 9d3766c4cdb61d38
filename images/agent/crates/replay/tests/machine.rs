//! What is reported about the machine beside real processes that take its processors.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod scene;

use std::process::Command;

use bagpipe_replay::Mode;
use graph::{Graph, wait_until};
use scene::{TMP, bag_of_words, node, request, run, words};

/// Processes that are nobody's here, and want all processors until this is dropped.
struct Strangers(Vec<String>);

impl Strangers {
    fn start(number: usize) -> Strangers {
        // Their parent ends at once, so that they are not below this process.
        let one = "(while :; do :; done) >/dev/null 2>&1 & echo $!\n";
        let output = Command::new("/bin/sh").args(["-c", &one.repeat(number)]).output().unwrap();
        let pids = String::from_utf8(output.stdout).unwrap();
        Strangers(pids.split_whitespace().map(str::to_owned).collect())
    }
}

impl Drop for Strangers {
    fn drop(&mut self) {
        let _ended = Command::new("/bin/kill").arg("-KILL").args(&self.0).status();
    }
}

#[test]
fn a_machine_that_others_keep_busy_says_so() {
    let processors = std::thread::available_parallelism().unwrap().get();
    let messages: Vec<(usize, u64, &str)> = (0..30).map(|at| (0, at * 100, "word")).collect();
    let bag = bag_of_words(&[words("/talk", "/t", false)], &messages);
    let graph = Graph::start(TMP);
    let _node = graph.python(&node("words.py"), &["/talk"]);
    // Beside so many it would take minutes to start.
    wait_until("the node has subscribed", || {
        graph.client().get_system_state().unwrap().subscribers.contains_key("/talk")
    });
    let _strangers = Strangers::start(4 * processors);
    let mut request = request(&bag, &graph.uri);
    request.mode = Mode::Realtime;
    let machine = run(&bag, &request).unwrap().machine.unwrap();
    eprintln!("{machine:?}");
    assert!(machine.busy, "{machine:?}");
    assert!(machine.message.starts_with("the machine could have caused a loss: in "));
    assert!(machine.stall_max_seconds > 0.0);
    assert!(machine.cpu_pressure_seconds.is_none_or(|waited| waited > 0.3), "{machine:?}");
}
