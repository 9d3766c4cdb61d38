//! `play` and `record` against Debian's rosmaster, rospy, rosbag and each other.
#![allow(clippy::unwrap_used, clippy::expect_used)]
// The graph and the worker take ports by the same rule.
#![allow(clippy::duplicate_mod)]

#[path = "../../ros1/tests/graph/mod.rs"]
mod graph;
mod worker;

use std::path::{Path, PathBuf};

use bagpipe_rosbag::{Bag, MemoryChunkedFile};
use graph::{Graph, Process, wait_until};
use worker::without_ros;

const TMP: &str = env!("CARGO_TARGET_TMPDIR");
const AGENT: &str = env!("CARGO_BIN_EXE_bagpipe-agent");

fn bag_of_chatter(graph: &Graph, count: u64) -> PathBuf {
    let path = graph.folder.join("chatter.bag");
    std::fs::write(&path, worker::chatter(count)).unwrap();
    path
}

fn read(path: &Path) -> Bag<MemoryChunkedFile> {
    let bytes = std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    Bag::open(MemoryChunkedFile::new(bytes)).unwrap()
}

fn words(graph: &Graph, topic: &str) -> Process {
    let script = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap())
        .join("../replay/tests/nodes/words.py");
    graph.python(&script, &[topic])
}

fn interrupt(process: &mut Process) {
    let pid = rustix::process::Pid::from_raw(process.id() as i32).unwrap();
    rustix::process::kill_process(pid, rustix::process::Signal::INT).unwrap();
    wait_until("it has ended", || process.has_ended());
}

#[test]
fn play_selects_renames_steps_and_records_the_answers() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = bag_of_chatter(&graph, 200);
    let bag = bag.to_str().unwrap();
    let _words = words(&graph, "/robot/talk");
    let names = ["--topics", "/chatter", "--remap", "/chatter:=/talk", "--prefix", "robot"];
    let window = ["--start", "0.5", "--duration", "1"];
    let answers = ["--record", "/answer", "--output", "answers.bag", "--json"];
    for way in [&["--immediate"][..], &["--step", "/robot/talk=/answer,10"], &["--rate", "4"]] {
        let mut all = vec!["play", bag, "--wait-for", "words", "--subscribers", "/robot/talk=1"];
        for more in [&names[..], &window, &answers, way] {
            all.extend_from_slice(more);
        }
        let text = graph.run(AGENT, &all);
        let ledger = r#""ledger":{"sent":100,"lead_in":0,"received":100,"dropped":0"#;
        assert!(text.contains(ledger), "{way:?}: {text}");
        let recorded = read(&graph.folder.join("answers.bag"));
        let timeline = recorded.timeline(|_| true).unwrap();
        assert_eq!(timeline.len(), 100, "{way:?}");
        assert_eq!(&timeline.get(0).unwrap().data[4..], b"message 50");
    }
}

#[test]
fn play_reads_bags_without_an_index_damaged_and_of_format_1_2() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let _words = words(&graph, "/chatter");
    let mut damaged = worker::bags::unindexed(50);
    // The index of the chunk, and the end of its last message.
    damaged.truncate(damaged.len() - (55 + 12 * 50) - 5);
    for (name, bytes, count) in [
        ("active", worker::bags::unindexed(50), 50),
        ("old", worker::bags::old_format(50), 50),
        ("damaged", damaged, 49),
    ] {
        let path = graph.folder.join(format!("{name}.bag"));
        std::fs::write(&path, &bytes).unwrap();
        let mut command = graph.command(AGENT, &["play", path.to_str().unwrap(), "--immediate"]);
        let output = command.output().unwrap();
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(text.contains(&format!("{count} received, 0 dropped")), "{name}: {text}");
        let errors = String::from_utf8(output.stderr).unwrap();
        let warned = errors.contains("are lost; the rest is played");
        assert_eq!(warned, name == "damaged", "{errors}");
    }
}

#[test]
fn play_says_what_it_waited_for_in_vain() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = bag_of_chatter(&graph, 3);
    let _words = words(&graph, "/chatter");
    wait_until("the node has subscribed", || {
        graph.client().get_system_state().unwrap().subscribers.contains_key("/chatter")
    });
    let arguments = ["--wait-for", "/judge", "--subscribers", "/chatter=2"];
    let mut command = graph.command(AGENT, &["play", bag.to_str().unwrap()]);
    let output = command.args(arguments).args(["--subscribe-timeout", "5"]).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let text = String::from_utf8(output.stderr).unwrap();
    let expected = "waited in vain for /judge, 2 subscribers of /chatter (there are 1) for 5.0 s";
    assert!(text.contains(expected), "{text}");
}

#[test]
fn what_play_sends_record_has_and_both_say_so() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = bag_of_chatter(&graph, 3_000);
    let out = graph.folder.join("live.bag");
    let arguments = ["record", "--output", out.to_str().unwrap(), "--exclude", "/rosout.*"];
    let mut recorder = graph.spawn(AGENT, &arguments);
    let played = graph.run(AGENT, &["play", bag.to_str().unwrap(), "--immediate"]);
    assert!(played.contains("/bagpipe_recorder_"), "{played}");
    assert!(played.contains("3000 received, 0 dropped"), "{played}");
    interrupt(&mut recorder);
    recorder.wait_for("3000 messages, ");
    let recorded = read(&out);
    assert_eq!((recorded.message_count(), recorded.loss()), (3_000, None));
    let connection = &recorded.connections()[0];
    assert_eq!(
        (connection.topic.as_str(), connection.datatype.as_str()),
        ("/chatter", "std_msgs/String")
    );
    assert!(connection.caller_id.as_ref().unwrap().starts_with("/bagpipe_player_"));
    graph.run("/usr/bin/rosbag", &["check", out.to_str().unwrap()]);
    let info = graph.run("/usr/bin/rosbag", &["info", "--yaml", out.to_str().unwrap()]);
    assert!(info.contains("messages: 3000\n") && info.contains("indexed: True"), "{info}");
}

#[test]
fn record_splits_compresses_and_takes_only_what_a_node_subscribes_to() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = bag_of_chatter(&graph, 1_000);
    let _words = words(&graph, "/chatter");
    let out = graph.folder.join("part.bag");
    let mut arguments = vec!["record", "--output", out.to_str().unwrap(), "--node", "words"];
    arguments.extend(["--compression", "lz4", "--split-size", "5000B"]);
    let mut recorder = graph.spawn(AGENT, &arguments);
    graph
        .run(AGENT, &["play", bag.to_str().unwrap(), "--immediate", "--subscribers", "/chatter=2"]);
    interrupt(&mut recorder);
    recorder.wait_for("1000 messages, ");
    let mut texts = Vec::new();
    let parts = parts(&graph);
    let info = rosbag_info(&graph, &parts);
    assert_eq!(info.matches("compression: lz4\n").count(), parts.len(), "{info}");
    for part in &parts {
        let bag = read(Path::new(part));
        assert_eq!(bag.chunks()[0].compression.name(), "lz4");
        let timeline = bag.timeline(|_| true).unwrap();
        texts.extend(timeline.iter().map(|m| String::from_utf8(m.data[4..].to_vec()).unwrap()));
    }
    let expected: Vec<String> = (0..1_000).map(|number| format!("message {number}")).collect();
    assert_eq!(texts, expected);
}

/// The parts of part.bag, in order.
fn parts(graph: &Graph) -> Vec<String> {
    let path = |part| graph.folder.join(format!("part_{part}.bag"));
    (0..).map(path).take_while(|path| path.exists()).map(|p| p.display().to_string()).collect()
}

/// What Debian's rosbag says of bags.
fn rosbag_info(graph: &Graph, bags: &[String]) -> String {
    let bags = bags.iter().map(String::as_str);
    let arguments: Vec<&str> = ["info", "--yaml"].into_iter().chain(bags).collect();
    graph.run("/usr/bin/rosbag", &arguments)
}

/// The sum of the numbers behind a key of rosbag's, where it is no topic's.
fn sum(info: &str, key: &str) -> u64 {
    info.lines()
        .filter_map(|line| line.strip_prefix(key))
        .map(|n| n.trim().parse::<u64>().unwrap())
        .sum()
}

#[test]
fn record_chooses_by_expression_and_splits_by_time_as_debian_s_rosbag_reads() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    let bag = bag_of_chatter(&graph, 100);
    let bag = bag.to_str().unwrap();
    let out = graph.folder.join("part.bag");
    let mut arguments = vec!["record", "/robot/.*", "--output", out.to_str().unwrap()];
    arguments.extend(["--exclude", ".*/noise", "--compression", "bz2", "--split-duration", "0.3"]);
    let mut recorder = graph.spawn(AGENT, &arguments);
    let noise = ["play", bag, "--remap", "/chatter:=/robot/noise", "--subscribe-timeout", "2"];
    let output = graph.command(AGENT, &noise).output().unwrap();
    assert!(!output.status.success(), "somebody received what is excluded");
    // Slowly: each part has what came in its time, however late that is on a busy machine.
    graph.run(AGENT, &["play", bag, "--prefix", "robot", "--rate", "0.4"]);
    interrupt(&mut recorder);
    recorder.wait_for("100 messages, ");
    let parts = parts(&graph);
    assert!(parts.len() >= 3, "{parts:?}");
    let info = rosbag_info(&graph, &parts);
    assert_eq!(sum(&info, "messages: "), 100, "{info}");
    assert_eq!(info.matches("compression: bz2\n").count(), parts.len(), "{info}");
    assert_eq!(info.matches("topic: /robot/chatter\n").count(), parts.len(), "{info}");
    assert_eq!(info.matches("topic: ").count(), parts.len(), "{info}");
}

#[test]
fn debian_s_rosbag_records_what_we_play_and_we_record_what_it_plays() {
    if without_ros() {
        return;
    }
    let graph = Graph::start(TMP);
    // No more than the queues of rosbag hold, which record and play have 100 long.
    let bag = bag_of_chatter(&graph, 90);
    let theirs = graph.folder.join("theirs.bag");
    // The program behind `rosbag record`: it ends with its own Ctrl-C, not with its parent's.
    let arguments = ["--output-name", theirs.to_str().unwrap(), "/chatter"];
    let mut recorder = graph.spawn("/usr/lib/rosbag/record", &arguments);
    let played = graph.run(AGENT, &["play", bag.to_str().unwrap(), "--rate", "1"]);
    assert!(played.contains("90 received, 0 dropped"), "{played}");
    interrupt(&mut recorder);
    wait_until("its bag is whole", || theirs.exists());
    assert_eq!(read(&theirs).message_count(), 90);

    let ours = graph.folder.join("ours.bag");
    let arguments = ["record", "/again", "--output", ours.to_str().unwrap(), "--limit", "90"];
    let mut recorder = graph.spawn(AGENT, &arguments);
    let mut arguments = vec!["play", "--quiet", "--wait-for-subscribers", "--rate", "4"];
    arguments.extend([theirs.to_str().unwrap(), "/chatter:=/again"]);
    graph.run("/usr/bin/rosbag", &arguments);
    wait_until("it has its 90", || recorder.has_ended());
    let recorded = read(&ours);
    let timeline = recorded.timeline(|_| true).unwrap();
    let texts = timeline.iter().map(|m| String::from_utf8(m.data[4..].to_vec()).unwrap());
    assert!(texts.eq((0..90).map(|number| format!("message {number}"))));
}

#[test]
fn without_a_master_both_say_which_one_they_wanted() {
    let mut command = std::process::Command::new(AGENT);
    command.args(["record", "--output", "/tmp/never.bag"]).env_remove("ROS_MASTER_URI");
    let text = String::from_utf8(command.output().unwrap().stderr).unwrap();
    assert!(text.contains("Set ROS_MASTER_URI"), "{text}");
    let gone = "http://127.0.0.1:1/";
    let output = command.args(["--master", gone]).output().unwrap();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("the ROS master failed") && text.contains("127.0.0.1:1"), "{text}");
}
