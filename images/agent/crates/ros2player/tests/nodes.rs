//! The nodes of the stand-in, which whole jobs are tested with: they answer as their input decides,
//! and what they count for themselves is what the ledger has.
#![allow(clippy::unwrap_used)]

mod standin;

use std::path::PathBuf;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Event, Kind, Strength, Waited};
use bagpipe_ros2player::{
    Durability, History, Player, Presence, PublisherId, Qos, Received, SubscriptionId,
};
use standin::{ALL, CDR, Graph, LONG, RELIABLE, built, eventually, hash, message, publish};

/// A node under test with who plays to it and records it: one topic in, one out.
struct Scene {
    graph: Graph,
    player: Player,
    publisher: PublisherId,
    subscription: SubscriptionId,
}

impl Scene {
    /// Once they all know each other.
    fn new(graph: Graph, types: [&str; 2], prepare: impl FnOnce(&Player)) -> Scene {
        let player = graph.player();
        prepare(&player);
        let publisher = player.advertise("/in", types[0], &RELIABLE).unwrap();
        let subscription = player.subscribe("/out", types[1], &ALL).unwrap();
        eventually(|| player.publishers(subscription).unwrap() == 1);
        // What it answers before its publisher knows of us reaches nobody.
        eventually(|| graph.endpoint(Kind::Publisher, "/out").matched == Some(1));
        graph.met("/in", &player, publisher);
        Scene { graph, player, publisher, subscription }
    }

    /// Publishes one, and returns what the node answers.
    fn step(&self, bytes: &[u8]) -> Vec<u8> {
        publish(&self.player, self.publisher, bytes).unwrap();
        self.answer()
    }

    fn answer(&self) -> Vec<u8> {
        let mut answers = Vec::new();
        let mut keep = |one: Received<'_>| {
            assert_eq!(one.subscription, self.subscription);
            answers.push(one.data.to_vec());
        };
        let begun = Instant::now();
        while self.player.receive(Duration::from_millis(500), &mut keep).unwrap() == 0 {
            assert!(begun.elapsed() < LONG);
        }
        assert_eq!(answers.len(), 1);
        answers.remove(0)
    }

    /// Waits until the callbacks of the node's subscription have ended, so many since `before`.
    fn await_ended(&self, ended: u64) {
        let reader = self.graph.subscription("/in");
        let deadline = Instant::now() + LONG;
        let held = |ledger: &bagpipe_ros2ledger::Ledger| {
            Ok(ledger.counts(reader.id)?.done(reader.strength) >= ended)
        };
        let events = [Event::Ended, Event::Taken];
        let waited = self.graph.ledger.wait(&events, &[reader.process], deadline, held).unwrap();
        assert_eq!(waited, Waited::Held);
    }
}

const RELAY: [&str; 8] = [
    "--name",
    "/ns/relay",
    "--sub",
    "/in:std_msgs/msg/String:10:reliable",
    "--pub",
    "/out:std_msgs/msg/String:10:reliable",
    "--relay",
    "/in=/out",
];
const STRINGS: [&str; 2] = ["std_msgs/String", "std_msgs/String"];

fn with<'all>(more: &[&'all str]) -> Vec<&'all str> {
    RELAY.into_iter().chain(more.iter().copied()).collect()
}

/// The text of a serialised std_msgs/String.
fn text(bytes: &[u8]) -> String {
    assert_eq!(bytes[..4], CDR);
    let length = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
    assert_eq!(bytes[8 + length - 1], 0);
    assert!(
        bytes[8 + length..].iter().all(|padding| *padding == 0) && bytes.len().is_multiple_of(4)
    );
    String::from_utf8(bytes[8..8 + length - 1].to_vec()).unwrap()
}

/// As a node hashes it, with the zeros that DDS adds.
fn padded_hash(bytes: &[u8]) -> u64 {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(4), 0);
    hash(&padded)
}

/// What a node wrote of itself at its end.
fn counts(file: &PathBuf) -> Vec<String> {
    let text = std::fs::read_to_string(file).unwrap();
    std::fs::remove_file(file).unwrap();
    text.lines().map(str::to_owned).collect()
}

fn place(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("ros2player-{name}-{}", std::process::id()))
}

#[test]
fn a_relay_answers_with_the_hash_and_the_number_of_its_input() {
    for (program, strength) in
        [("standin_node", Strength::Called), ("standin_node_py", Strength::Taken)]
    {
        let graph = Graph::new();
        let file = place(program);
        let node = graph.start(program, &with(&["--count-to", file.to_str().unwrap()]));
        let scene = Scene::new(graph, STRINGS, |_| ());
        for number in 0..50 {
            let input = message(number, number as usize * 3);
            let expected = format!("{:016x} {}", padded_hash(&input), number + 1);
            assert_eq!(text(&scene.step(&input)), expected);
        }
        let reader = scene.graph.subscription("/in");
        assert_eq!((reader.strength, reader.node.as_str()), (strength, "/ns/relay"));
        scene.await_ended(50);
        assert!(node.end());
        let own = ["sub /in taken 50 called 50", "pub /out published 50"];
        assert_eq!(counts(&file), own);
        let ledger = scene.graph.ledger.endpoints().unwrap();
        let of = |kind| ledger.iter().find(|one| one.kind == kind).unwrap().counts;
        assert_eq!(of(Kind::Subscription).taken, 50);
        assert_eq!(of(Kind::Subscription).done(strength), 50);
        assert_eq!(of(Kind::Publisher).published, 50);
    }
}

#[test]
fn who_waits_for_signs_of_a_publisher_that_publishes_nothing_has_them() {
    // Both at once, since each waits for longer than a busy machine may pause.
    std::thread::scope(|scope| {
        for (graph, name) in Graph::of_each_player().into_iter().zip(["signs", "signs-dds"]) {
            scope.spawn(move || waits_for_signs(&graph, name));
        }
    });
}

fn waits_for_signs(graph: &Graph, name: &str) {
    let file = place(name);
    let asks = ["--presence", "0:4000:manual", "--sub", "/in:std_msgs/msg/String:10:reliable"];
    let words = [&["--name", "/waits", "--count-to", file.to_str().unwrap()], &asks[..]];
    let node = graph.node(&words.concat());
    let player = graph.player();
    let presence = Presence { deadline: None, lease: Some(Duration::from_secs(4)), manual: true };
    let publisher = player.advertise("/in", STRINGS[0], &Qos { presence, ..RELIABLE }).unwrap();
    eventually(|| player.subscribers(publisher).unwrap() == 1);
    // A lease and a half, in which it was taken for dead.
    std::thread::sleep(Duration::from_secs(6));
    publish(&player, publisher, &message(1, 20)).unwrap();
    let reader = graph.subscription("/in");
    eventually(|| graph.ledger.counts(reader.id).unwrap().taken == 1);
    assert!(node.end());
    assert_eq!(counts(&file), ["sub /in taken 1 called 1"]);
}

#[test]
fn under_overload_a_short_queue_loses_what_the_ledger_and_the_node_agree_on() {
    let graph = Graph::new();
    let file = place("overload");
    let more = ["--threads", "3", "--delay-us", "300", "--count-to", file.to_str().unwrap()];
    let node = graph.node(&with(&more));
    let scene = Scene::new(graph, STRINGS, |_| ());
    for number in 0..5000 {
        publish(&scene.player, scene.publisher, &message(number, 20)).unwrap();
    }
    assert!(scene.player.flush(Instant::now() + LONG).unwrap());
    let reader = scene.graph.subscription("/in");
    let counted = || {
        let counts = scene.graph.ledger.counts(reader.id).unwrap();
        (counts.taken, counts.ended)
    };
    eventually(|| {
        let (taken, ended) = counted();
        std::thread::sleep(Duration::from_millis(100));
        ended == taken && counted() == (taken, ended)
    });
    assert!(node.end());
    let own = counts(&file);
    let taken = counted().0;
    assert_eq!(own[0], format!("sub /in taken {taken} called {taken}"));
    assert!((10..4000).contains(&taken), "{taken}");
}

#[test]
fn a_relay_of_stamps_copies_the_headers() {
    for (datatype, node) in [("sensor_msgs/Imu", "Imu"), ("sensor_msgs/JointState", "JointState")] {
        let graph = Graph::new();
        let input = format!("/in:sensor_msgs/msg/{node}:10:reliable");
        let output = "/out:geometry_msgs/msg/PoseStamped:10:reliable";
        let arguments = ["--sub", &input, "--pub", output, "--relay-stamp", "/in=/out"];
        let _node = graph.node(&arguments);
        let scene = Scene::new(graph, [datatype, "geometry_msgs/PoseStamped"], |_| ());
        let stamped = |second: u32, nanosecond: u32| {
            let fields = [second.to_le_bytes(), nanosecond.to_le_bytes(), [0; 4], [0; 4]];
            [&CDR[..], &fields.concat()].concat()
        };
        let answer = scene.step(&stamped(1_700_000_000, 999_999_999));
        assert_eq!(answer.len(), 4 + 16 + 56);
        assert_eq!(answer[..12], stamped(1_700_000_000, 999_999_999)[..12]);
        assert_eq!(f64::from_le_bytes(answer[20..28].try_into().unwrap()), 1.0);
    }
}

#[test]
fn with_simulated_time_an_answer_has_the_clock_that_was_taken() {
    let graph = Graph::new();
    let _node = graph.node(&with(&["--use-sim-time"]));
    let newest = Qos { history: History::KeepLast(1), ..RELIABLE };
    let clock = std::cell::Cell::new(None);
    let scene = Scene::new(graph, STRINGS, |player| {
        clock.set(Some(player.advertise("/clock", "rosgraph_msgs/Clock", &newest).unwrap()));
    });
    let clock = clock.get().unwrap();
    let reader = scene.graph.met("/clock", &scene.player, clock);
    for tick in 0..20_u32 {
        let time = [&CDR[..], &(100 + tick).to_le_bytes(), &(7 * tick).to_le_bytes()].concat();
        publish(&scene.player, clock, &time).unwrap();
        eventually(|| scene.graph.ledger.counts(reader.id).unwrap().ended > u64::from(tick));
        let answer = text(&scene.step(b"\0\x01\0\0now"));
        let expected = format!(
            "{:016x} {} {}.{:09}",
            padded_hash(b"\0\x01\0\0now"),
            tick + 1,
            100 + tick,
            7 * tick
        );
        assert_eq!(answer, expected);
    }
}

#[test]
fn it_drops_each_third_and_dies_in_the_callback_of_the_tenth() {
    let graph = Graph::new();
    let node = graph.node(&with(&["--drop-every", "3", "--die-after", "10"]));
    let scene = Scene::new(graph, STRINGS, |_| ());
    for number in 1..10 {
        publish(&scene.player, scene.publisher, &message(number, 10)).unwrap();
        if number % 3 == 0 {
            scene.await_ended(number);
            let nothing = scene.player.receive(Duration::ZERO, &mut |_| panic!("{number}"));
            assert_eq!(nothing.unwrap(), 0);
        } else {
            assert!(text(&scene.answer()).ends_with(&format!(" {number}")));
        }
    }
    publish(&scene.player, scene.publisher, &message(10, 10)).unwrap();
    let reader = scene.graph.subscription("/in");
    let deadline = Instant::now() + LONG;
    let waited =
        scene.graph.ledger.wait(&[Event::Ended], &[reader.process], deadline, |_| Ok(false));
    assert_eq!(waited.unwrap(), Waited::Ended(reader.process));
    let counts = scene.graph.ledger.counts(reader.id).unwrap();
    assert_eq!((counts.taken, counts.started, counts.ended), (10, 10, 9));
    assert!(!node.ended());
}

#[test]
fn arguments_that_make_no_sense_are_refused_with_the_usage() {
    for (arguments, why) in [
        (&["--sub", "/in"][..], "no topic with its type"),
        (&["--name"][..], "no value: --name"),
        (&["--fast", "1"][..], "no option: --fast"),
        (&["--threads", "0"][..], "no number of threads"),
        (&["--relay", "/in=/out"][..], "--relay needs a --sub /in"),
    ] {
        let graph = Graph::new();
        let output = std::process::Command::new(built().join("standin_node"))
            .args(arguments)
            .envs(graph.environment())
            .output()
            .unwrap();
        let errors = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{errors}");
        assert!(errors.contains(why), "{errors}");
    }
}

#[test]
fn a_node_that_comes_late_has_what_is_kept_for_it() {
    let graph = Graph::new();
    let player = graph.player();
    let kept = Qos { durability: Durability::TransientLocal, ..RELIABLE };
    let publisher = player.advertise("/map", "std_msgs/String", &kept).unwrap();
    for number in 0..3 {
        publish(&player, publisher, &message(number, 10)).unwrap();
    }
    assert!(player.flush(Instant::now() + LONG).unwrap());
    let _node = graph.node(&["--sub", "/map:std_msgs/msg/String:5:reliable:transient_local"]);
    let reader = graph.subscription("/map");
    eventually(|| graph.ledger.counts(reader.id).unwrap().ended == 3);
}

/// A node that takes ten of the player's and ten of another player's, as that node's middleware gives a
/// message's publisher: how many of them are known to be the first one's, and of how many it is not
/// known.
fn of_two_players(graph: Graph, origins: &[&str]) -> (u64, u64) {
    let relay = with(&[&["--count-to", "/dev/null"], origins].concat());
    let _node = graph.node(&relay);
    let scene = Scene::new(graph, STRINGS, |_| {});
    let other = scene.graph.player();
    let others = other.advertise("/in", STRINGS[0], &RELIABLE).unwrap();
    scene.graph.ledger.own(&scene.player.gid(scene.publisher).unwrap()).unwrap();
    assert_ne!(scene.player.gid(scene.publisher), other.gid(others));
    scene.graph.met("/in", &other, others);
    for number in 0..10 {
        scene.step(&message(number, 60));
        publish(&other, others, &message(100 + number, 60)).unwrap();
        scene.answer();
    }
    let counts = scene.graph.subscription("/in").counts;
    assert_eq!(counts.taken, 20);
    (counts.taken_own, counts.taken_unknown)
}

#[test]
fn what_a_node_takes_of_a_player_is_counted_apart_from_what_it_takes_of_another() {
    for graph in Graph::of_each_player() {
        assert_eq!(of_two_players(graph, &[]), (10, 0));
    }
    for graph in Graph::of_each_player() {
        assert_eq!(of_two_players(graph, &["--origins", "gid"]), (10, 0));
    }
    assert_eq!(of_two_players(Graph::new(), &["--origins", "none"]), (0, 20));
}
