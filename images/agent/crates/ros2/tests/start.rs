//! When a play begins. A file of its own, with one test at a time: it looks at all processes below this one.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bagpipe_graph::Node;
use scene::{Ask, RELAY, Scene, joined, recording};
use standin::{LONG, built, eventually};

fn alone() -> MutexGuard<'static, ()> {
    static ONE: Mutex<()> = Mutex::new(());
    ONE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Whether all spin by now.
fn all_spin(node: &dyn Node) -> bool {
    node.look().unwrap();
    node.all_spin(&BTreeSet::new())
}

#[test]
fn all_spin_once_each_node_counts_and_has_begun_to_take() {
    let _alone = alone();
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    scene.await_subscriptions(1);
    let node = joined(&scene.middleware(), Arc::default());
    eventually(|| all_spin(&*node));
    let late = ["--name", "/late", "--sub", "/other:sensor_msgs/msg/Imu:10:reliable"];
    let late = [&late[..], &["--spins-late-us", "600000000"]].concat();
    let sleeps = scene.start("standin_node", &late);
    scene.await_subscriptions(2);
    assert!(!all_spin(&*node));
    drop(sleeps);
    // The graph shows a killed node for a while, and its process is known not to run.
    eventually(|| all_spin(&*node));
    let foreign = ["--name", "/foreign", "--sub", "/other:sensor_msgs/msg/Imu:10:reliable"];
    let _foreign = scene.start_uncounted("standin_node", &foreign);
    eventually(|| !all_spin(&*node));
}

#[test]
fn not_all_spin_where_a_process_has_loaded_ros_2_and_has_no_node() {
    let _alone = alone();
    let scene = Scene::new();
    let relay = scene.start("standin_node", &RELAY);
    scene.await_subscriptions(1);
    let node = joined(&scene.middleware(), Arc::default());
    eventually(|| all_spin(&*node));
    let library = built().join("librmw_implementation.so");
    let loads = ["-c", "LD_PRELOAD=\"$0\" exec sleep 600", library.to_str().unwrap()];
    let loaded = scene.start_uncounted("/bin/sh", &loads);
    let with = |pid: u32| node.all_spin(&BTreeSet::from([i32::try_from(pid).unwrap()]));
    let pid = loaded.pid();
    eventually(|| !with(pid));
    assert!(with(relay.pid()) && with(std::process::id()));
    drop(loaded);
    assert!(with(pid));
}

// Promise: nothing-before-everybody
#[test]
fn a_stack_that_spins_is_played_to_without_a_wait_for_more_subscribers() {
    let _alone = alone();
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    scene.await_subscriptions(1);
    // By the clock alone it would go on later than it is waited for at most.
    let ask = Ask { at_rest: true, stable: 2 * LONG, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 20, 100), &ask).unwrap();
    assert_eq!((replayed.ledger.sent, replayed.ledger.received), (20, 20));
    assert!(replayed.timings.subscribe < ask.deadline.as_secs_f64());
}

// Promise: nothing-before-everybody
#[test]
fn who_sleeps_before_it_starts_misses_nothing() {
    let _alone = alone();
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let program = built().join("standin_node");
    let late = [
        ["-c", "sleep 0.3; exec \"$0\" \"$@\"", program.to_str().unwrap()],
        ["--name", "/late", "--sub"],
    ];
    let late = [late.as_flattened(), &["/in:sensor_msgs/msg/Imu:10:reliable"]].concat();
    scene.await_subscriptions(1);
    let _late = scene.start("/bin/sh", &late);
    let ask = Ask { at_rest: true, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 20, 100), &ask).unwrap();
    let lines = &replayed.ledger.topics[0].subscribers;
    let received: BTreeMap<&str, u64> =
        lines.iter().map(|line| (line.node.as_str(), line.received)).collect();
    assert_eq!(received, BTreeMap::from([("/relay", 20), ("/late", 20)]));
}

// Promise: nothing-before-everybody
#[test]
fn nothing_is_played_before_a_publisher_of_the_stack_knows_its_subscriber() {
    let _alone = alone();
    let scene = Scene::new();
    let middle = "/mid:std_msgs/msg/String:5000:reliable";
    let output = "/out:std_msgs/msg/String:5000:reliable";
    let first = [
        ["--name", "/first", "--sub", "/in:sensor_msgs/msg/Imu:5000:reliable"],
        ["--pub", middle, "--relay", "/in=/mid"],
    ];
    let first = [first.as_flattened(), &["--meets-late-ms", "1200"]].concat();
    let second = ["--name", "/second", "--sub", middle, "--pub", output, "--relay", "/mid=/out"];
    let _second = scene.start("standin_node", &second);
    let _first = scene.start("standin_node", &first);
    scene.await_subscriptions(2);
    let ask = Ask { at_rest: true, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 20, 100), &ask).unwrap();
    assert_eq!((replayed.ledger.received, replayed.recorded.messages), (20, 20));
}
