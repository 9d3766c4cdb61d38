//! The states of nodes with a life cycle, asked by librcl: whenever they were entered, and of who comes,
//! stands still or is killed.
#![allow(clippy::unwrap_used)]

mod standin;

use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};

use bagpipe_ros2player::{Asked, Player, PlayerError, PlayerOptions};
use standin::{Graph, Node, built, eventually};

const NODE: &str = "/ns/planner";

fn node(graph: &Graph, state: &str) -> Node {
    graph.node(&["--name", NODE, "--life-cycle", state])
}

/// Waits for an answer that is this one.
fn await_state(player: &Player, state: u8) {
    eventually(|| player.ask_state(3, NODE).unwrap() == Asked::Answered(state));
}

#[test]
fn a_state_is_known_whenever_it_was_entered() {
    for (state, number, other) in [("inactive", 2, 3), ("active", 3, 2)] {
        let graph = Graph::new();
        let player = graph.player();
        assert_eq!(player.ask_state(3, NODE).unwrap(), Asked::Nobody);
        let node = node(&graph, state);
        await_state(&player, number);
        node.signal("USR1");
        await_state(&player, other);
        node.signal("USR1");
        await_state(&player, number);
    }
}

#[test]
fn who_stands_still_keeps_nobody_waiting_and_answers_later() {
    let graph = Graph::new();
    let player = graph.player();
    let node = node(&graph, "inactive");
    await_state(&player, 2);
    node.signal("STOP");
    eventually(|| standin::threads_are(node.pid(), 'T'));
    // What was asked before may be answered yet.
    eventually(|| player.ask_state(3, NODE).unwrap() == Asked::Now);
    for _ in 0..20 {
        let asked = player.ask_state(3, NODE).unwrap();
        assert!(matches!(asked, Asked::Before | Asked::Now), "{asked:?}");
    }
    node.signal("CONT");
    await_state(&player, 2);
}

#[test]
fn of_who_was_killed_nothing_is_known_until_it_is_there_again() {
    let graph = Graph::new();
    let player = graph.player();
    let first = node(&graph, "active");
    await_state(&player, 3);
    assert!(first.end());
    eventually(|| player.ask_state(3, NODE).unwrap() == Asked::Nobody);
    let _second = node(&graph, "inactive");
    await_state(&player, 2);
}

#[test]
fn each_of_64_nodes_has_its_question_and_no_more_are_asked() {
    let graph = Graph::new();
    let player = graph.player();
    let (_first, _last) = (
        graph.node(&["--name", "/first", "--life-cycle", "active"]),
        graph.node(&["--name", "/last", "--life-cycle", "inactive"]),
    );
    eventually(|| player.ask_state(0, "/first").unwrap() == Asked::Answered(3));
    eventually(|| player.ask_state(63, "/last").unwrap() == Asked::Answered(2));
    let error = player.ask_state(64, "/more").unwrap_err();
    assert!(matches!(error, PlayerError::TooMany { most: 64, .. }), "{error}");
}

/// The stand-in without some of its libraries.
struct Without(PathBuf);

impl Without {
    fn new(missing: &str) -> Without {
        let name = format!("ros2-without-{}-{missing}", std::process::id());
        let folder = std::env::temp_dir().join(name);
        std::fs::create_dir(&folder).unwrap();
        for entry in std::fs::read_dir(built()).unwrap().map(|entry| entry.unwrap()) {
            if !entry.file_name().to_string_lossy().ends_with(missing) {
                symlink(entry.path(), folder.join(entry.file_name())).unwrap();
            }
        }
        Without(folder)
    }
}

impl Drop for Without {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).unwrap();
    }
}

fn refusal(graph: &Graph, folder: &Path) -> String {
    let environment = graph.environment_with(folder);
    let player = Player::start(&PlayerOptions { environment, ..graph.options() }).unwrap();
    player.ask_state(0, NODE).unwrap_err().to_string()
}

#[test]
fn what_an_image_lacks_for_it_is_named() {
    for missing in
        ["liblifecycle_msgs__rosidl_typesupport_c.so", "liblifecycle_msgs__rosidl_generator_c.so"]
    {
        let (graph, folder) = (Graph::new(), Without::new(missing));
        let sentence = refusal(&graph, &folder.0);
        let expected = [
            format!("/ns/planner/get_state needs the messages of lifecycle_msgs, and {missing}"),
            "install the package lifecycle_msgs in the image".to_owned(),
        ];
        assert!(expected.iter().all(|part| sentence.contains(part)), "{sentence}");
    }
}

#[test]
fn on_dds_alone_no_state_is_asked_for() {
    let graph = Graph::on_dds();
    let error = graph.player().ask_state(0, NODE).unwrap_err().to_string();
    assert!(error.contains("on DDS alone no service is called"), "{error}");
}
