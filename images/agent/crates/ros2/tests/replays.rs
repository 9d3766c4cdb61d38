//! Recordings of ROS 2 played into nodes of other processes over Cyclone DDS: all that is sent is
//! taken and called back, all that is published is recorded, and lock-step is the same each time.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::fs::File;
use std::io::Write as _;
use std::os::unix::fs::FileExt as _;
use std::path::Path;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use bagpipe_log::Connection;
use bagpipe_replay::{AnswerBy, Mode, Progress, Stage, Strength};
use bagpipe_ros2player::{GraphNode, Player, PlayerOptions};
use scene::{
    Ask, DEFAULT, MS, RELAY, Scene, assert_window_answered, imu, joined, recorded, recording,
    recording_of,
};
use standin::{Node as Process, eventually, hash};

/// The same with a queue that no pause of the machine fills in real time.
fn deep_relay() -> [&'static str; 8] {
    RELAY.map(|one| if one == RELAY[3] { "/in:sensor_msgs/msg/Imu:2000:reliable" } else { one })
}

#[test]
fn at_full_speed_nothing_is_lost_and_all_that_is_answered_is_recorded() {
    for (program, strength) in
        [("standin_node", Strength::Called), ("standin_node_py", Strength::Taken)]
    {
        let scene = Scene::new();
        let _relay = scene.start(program, &RELAY);
        let mcap = recording(&["/in"], 5000, 1000);
        let replayed = scene.play(&mcap, &Ask::default()).unwrap();
        let ledger = &replayed.ledger;
        assert_eq!((ledger.sent, ledger.received, ledger.dropped), (5000, 5000, 0), "{program}");
        assert_eq!(ledger.strength, Some(strength));
        assert_eq!(ledger.topics[0].subscribers[0].node, "/relay");
        assert_eq!(recorded(&replayed).len(), 5000);
    }
}

// Promise: credit-overwrites-nothing
#[test]
fn the_slowest_of_several_nodes_governs_and_each_has_its_line() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let slow =
        ["--name", "/slow", "--sub", "/in:sensor_msgs/msg/Imu:1:best_effort", "--delay-us", "300"];
    let _slow = scene.start("standin_node", &slow);
    // The play begins once a subscriber is there for each topic: the slow one's own.
    let other =
        ["--name", "/other", "--sub", "/also:sensor_msgs/msg/Imu:3:reliable", "--threads", "3"];
    let _other = scene.start("standin_node", &other);
    scene.await_subscriptions(3);
    let replayed = scene.play(&recording(&["/in", "/also"], 1000, 2000), &Ask::default()).unwrap();
    let lines: Vec<(&str, &str, u64, u64)> = replayed
        .ledger
        .topics
        .iter()
        .flat_map(|topic| {
            topic
                .subscribers
                .iter()
                .map(|line| (topic.topic.as_str(), line.node.as_str(), line.received, line.dropped))
        })
        .collect();
    let expected =
        [("/in", "/relay", 500, 0), ("/in", "/slow", 500, 0), ("/also", "/other", 500, 0)];
    assert_eq!(lines, expected);
    assert_eq!(replayed.ledger.strength, Some(Strength::Called));
}

/// How often nodes woke who waits for what they count: a word of the ledger's header.
fn wakes(scene: &Scene) -> u32 {
    let [(_, path), _] = scene.ledger.environment("/ledger.so".as_ref(), None);
    let mut word = [0; 4];
    File::open(path).unwrap().read_exact_at(&mut word, 64).unwrap();
    u32::from_le_bytes(word)
}

#[test]
fn a_slow_node_wakes_the_agent_once_for_each_half_of_its_queue() {
    let scene = Scene::new();
    let slow =
        ["--name", "/slow", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable", "--delay-us", "300"];
    let _slow = scene.start("standin_node", &slow);
    scene.await_subscriptions(1);
    let replayed = scene.play(&recording(&["/in"], 1000, 100), &Ask::default()).unwrap();
    assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (1000, 0));
    // Each of its 1,000 takes would, and so would the ends of the last ten callbacks.
    let wakes = wakes(&scene);
    assert!(wakes <= 250, "{wakes}");
    // But for the first ten, each went out behind a wake, as one of ten at most, or at a look 20 ms after the
    // one before it: then the node was slow, and had taken no half of its queue in that time.
    let looks = (replayed.playback.played_seconds / 0.020) as u32;
    assert!(10 + 10 * wakes + 5 * looks >= 1000, "{wakes} wakes, {looks} looks");
}

/// Over Fast DDS threads of a real executor miss that messages wait, and sleep until another one comes.
#[test]
fn a_node_that_takes_no_more_until_another_one_comes_gets_it_where_it_has_room() {
    let scene = Scene::new();
    let dozing = [
        ["--name", "/dozing", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"],
        ["--delay-us", "300", "--doze-every", "7"],
    ];
    let _dozing = scene.start("standin_node", dozing.as_flattened());
    scene.await_subscriptions(1);
    let replayed = scene.play(&recording(&["/in"], 200, 100), &Ask::default()).unwrap();
    assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (200, 0));
}

#[test]
fn messages_of_a_mebibyte_arrive_one_after_the_other() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let replayed = scene.play(&recording(&["/in"], 60, 1 << 20), &Ask::default()).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (60, 60, 0));
    assert_eq!(recorded(&replayed).len(), 60);
}

#[test]
fn in_realtime_the_lead_in_is_counted_apart() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &deep_relay());
    let ask = Ask { mode: Mode::Realtime, lead_in: 100 * MS, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 300, 100), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.lead_in, ledger.sent, ledger.received, ledger.dropped), (100, 200, 200, 0));
    assert_window_answered(&replayed, 100..300, 100);
}

/// A lock-step play of two inputs, of which the slower one decides the answer's time.
fn in_lock_step(program: &str, by: AnswerBy) -> Vec<(String, u64, Vec<u8>)> {
    let scene = Scene::new();
    let relay = [&RELAY[..], &["--use-sim-time"]].concat();
    let _relay = scene.start(program, &relay);
    let second = [
        "--name",
        "/second",
        "--sub",
        "/more:sensor_msgs/msg/Imu:2:reliable",
        "--pub",
        "/out2:geometry_msgs/msg/PoseStamped:1:reliable",
        "--relay-stamp",
        "/more=/out2",
        "--delay-us",
        "200",
    ];
    let _second = scene.start(program, &second);
    scene.await_subscriptions(3);
    let steps = match by {
        AnswerBy::Count => &[("/in", "/out")][..],
        AnswerBy::Stamp => &[("/more", "/out2")][..],
    };
    let ask = Ask { mode: Mode::Lockstep, steps, by, use_sim_time: true, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in", "/more"], 400, 100), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (400, 400, 0));
    assert_eq!(replayed.playback.steps[0].answered, 200);
    recorded(&replayed)
}

#[test]
fn two_lock_step_runs_record_the_same_messages_at_the_same_times() {
    let first = in_lock_step("standin_node", AnswerBy::Count);
    assert_eq!(first.len(), 400);
    // Each answer has the time of its input, though one of the two is awaited by no step.
    let times: Vec<u64> = first.iter().map(|(_, time, _)| time / MS).collect();
    assert_eq!(times, (1000..1400).collect::<Vec<_>>());
    let runs = std::env::var("BAGPIPE_RUNS").map_or(1, |runs| runs.parse().unwrap());
    for _again in 0..runs {
        assert_eq!(in_lock_step("standin_node", AnswerBy::Count), first);
    }
    assert_eq!(in_lock_step("standin_node", AnswerBy::Stamp), first);
    // A node without tracepoints is seen to come back for more.
    assert_eq!(in_lock_step("standin_node_py", AnswerBy::Count), first);
}

/// Three nodes, of which each passes on what the one before it publishes.
fn chain_of_nodes(scene: &Scene) -> Vec<Process> {
    let links = [
        ("/a", "/in:sensor_msgs/msg/Imu", "/b"),
        ("/b", "/b:std_msgs/msg/String", "/c"),
        ("/c", "/c:std_msgs/msg/String", "/out"),
    ];
    let node = |(name, from, to): (&str, &str, &str)| {
        let (topic, _) = from.split_once(':').unwrap();
        let subscription = format!("{from}:2:reliable");
        let publisher = format!("{to}:std_msgs/msg/String:2:reliable");
        let relay = format!("{topic}={to}");
        let [name, from, to] = [["--name", name], ["--sub", &subscription], ["--pub", &publisher]];
        let does = ["--relay", &relay, "--delay-us", "500"];
        scene.start("standin_node", &[&name[..], &from, &to, &does].concat())
    };
    let nodes = links.map(node).into();
    scene.await_subscriptions(3);
    nodes
}

#[test]
fn what_nobody_awaits_belongs_to_the_step_that_caused_it_through_a_chain_of_nodes() {
    let scene = Scene::new();
    let _nodes = chain_of_nodes(&scene);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 200, 50), &ask).unwrap();
    // First: it would explain the times.
    assert_eq!(replayed.playback.warnings, [] as [String; 0]);
    let times: Vec<u64> = recorded(&replayed).iter().map(|(_, time, _)| time / MS).collect();
    assert_eq!(times, (1000..1200).collect::<Vec<_>>());
}

#[test]
fn a_node_that_gets_no_processor_for_a_while_is_waited_for_and_trusted_after() {
    let scene = Scene::new();
    let nodes = chain_of_nodes(&scene);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = std::thread::scope(|threads| {
        threads.spawn(|| {
            scene.await_published("/out", 50);
            nodes[1].signal("STOP");
            // Longer than what may never come is waited for.
            std::thread::sleep(Duration::from_millis(2500));
            nodes[1].signal("CONT");
        });
        scene.play(&recording(&["/in"], 200, 50), &ask).unwrap()
    });
    // First: it would explain the times.
    assert_eq!(replayed.playback.warnings, [] as [String; 0]);
    let times: Vec<u64> = recorded(&replayed).iter().map(|(_, time, _)| time / MS).collect();
    assert_eq!(times, (1000..1200).collect::<Vec<_>>());
}

#[test]
fn what_never_comes_is_waited_for_less_each_time_and_named() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    // It asks for more than is offered, so that nothing reaches it.
    let deaf = ["--name", "/deaf", "--sub", "/out:std_msgs/msg/String:5:reliable:transient_local"];
    let _deaf = scene.start("standin_node", &deaf);
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 100, 50), &ask).unwrap();
    let times: Vec<u64> = recorded(&replayed).iter().map(|(_, time, _)| time / MS).collect();
    assert_eq!(times, (1000..1100).collect::<Vec<_>>());
    let remark = &replayed.playback.warnings[0];
    assert!(remark.starts_with("what /deaf was sent on /out did not all come to it"), "{remark}");
}

#[test]
fn who_renews_a_subscription_within_the_stack_is_waited_for_in_each_step_behind_it() {
    let scene = Scene::new();
    let middle = "/out_mid:std_msgs/msg/String:100:reliable";
    let first = ["--name", "/first", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable"];
    let first = [&first[..], &["--pub", middle, "--relay", "/in=/out_mid"]].concat();
    let second = ["--name", "/second", "--sub", middle, "--relay", "/out_mid=/out_end"];
    let end = ["--pub", "/out_end:std_msgs/msg/String:100:reliable"];
    let renews = ["--renew", "1:10:0", "--delay-us", "2000"];
    let _first = scene.start("standin_node", &first);
    let _second = scene.start("standin_node", &[&second[..], &end, &renews].concat());
    scene.await_subscriptions(2);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&recording(&["/in"], 100, 50), &ask).unwrap();
    assert_eq!(replayed.playback.warnings, [] as [String; 0]);
    let all = recorded(&replayed);
    let times = |topic: &str| -> Vec<u64> {
        all.iter().filter(|one| one.0 == topic).map(|one| one.1 / MS).collect()
    };
    assert_eq!(times("/out_mid"), (1000..1100).collect::<Vec<_>>());
    // Of what is published while it has none nothing comes; what comes is of its own step.
    assert!(times("/out_end").len() >= 90, "{:?}", times("/out_end"));
    let answers = all.iter().filter(|one| one.0 == "/out_end");
    let late: Vec<u64> =
        answers.filter(|one| !is_of_its_step(one, &all)).map(|one| one.1).collect();
    assert_eq!(late, [] as [u64; 0]);
}

/// Whether an answer of `/out_end` names the hash of what was on `/out_mid` in its step.
fn is_of_its_step(answer: &(String, u64, Vec<u8>), all: &[(String, u64, Vec<u8>)]) -> bool {
    let asked = all.iter().find(|one| one.0 == "/out_mid" && one.1 == answer.1);
    asked.is_some_and(|asked| answer.2[8..24] == *format!("{:016x}", hash(&asked.2)).as_bytes())
}

#[test]
fn a_node_that_is_killed_has_lost_what_it_did_not_take() {
    let scene = Scene::new();
    let dies = [&RELAY[..], &["--die-after", "50"]].concat();
    let _relay = scene.start("standin_node", &dies);
    let replayed = scene.play(&recording(&["/in"], 200, 100), &Ask::default()).unwrap();
    let line = &replayed.ledger.topics[0].subscribers[0];
    assert_eq!((replayed.ledger.sent, line.received, line.dropped), (200, 50, 150));
    assert_ne!(line.strength, Strength::Called);
}

#[test]
fn who_asks_for_more_than_was_recorded_is_named() {
    let scene = Scene::new();
    let late = ["--name", "/late", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable:transient_local"];
    let _late = scene.start("standin_node", &late);
    scene.await_subscriptions(1);
    let ask = Ask { record: &["/none"], deadline: Duration::from_secs(5), ..Ask::default() };
    let error = scene.play(&recording(&["/in"], 5, 100), &ask).err().unwrap();
    assert_eq!(error.reason(), "NeverSubscribed");
    let sentence = error.to_string();
    assert!(
        sentence.contains("/late subscribes to /in, but it wants what was published"),
        "{sentence}"
    );
}

#[test]
fn a_type_that_the_stack_has_with_other_fields_is_played_to_nobody() {
    let play = |definition: &str| {
        let scene = Scene::new();
        let sub = ["--name", "/reader", "--sub", "/in:std_msgs/msg/String:10:reliable"];
        let _reader = scene.start("standin_node", &sub);
        scene.await_subscriptions(1);
        let (datatype, definition) = ("std_msgs/msg/String".to_owned(), definition.into());
        let channel = Connection { datatype, definition, ..imu("/in") };
        let ask = Ask { record: &["/none"], ..Ask::default() };
        scene.play(&recording_of(&channel, 20, 100), &ask)
    };
    assert_eq!(play("# A text.\nstring data\n").unwrap().ledger.received, 20);
    let error = play("uint64 data\n").err().unwrap();
    assert_eq!(error.reason(), "BagUnreadable");
    let sentence = error.to_string();
    let fields = "field 1 of std_msgs/String: uint64 data, and the stack's packages have it with \
                  field 1 of std_msgs/String: string data";
    assert!(sentence.contains(fields), "{sentence}");
}

#[test]
fn a_subscriber_that_does_not_count_is_there_and_nothing_of_it_is_proved() {
    let scene = Scene::new();
    let _hidden = scene.start_uncounted("standin_node", &RELAY);
    let replayed = scene.play(&recording(&["/in"], 20, 100), &Ask::default()).unwrap();
    let line = &replayed.ledger.topics[0].subscribers[0];
    assert_eq!((line.node.as_str(), line.received, line.strength), ("/relay", 0, Strength::Sent));
}

#[test]
fn a_topic_that_is_published_as_two_types_has_no_whole_recording() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let other = [
        "--name",
        "/other",
        "--sub",
        "/in:sensor_msgs/msg/Imu:10:reliable",
        "--pub",
        "/out:geometry_msgs/msg/PoseStamped:10:reliable",
        "--relay-stamp",
        "/in=/out",
    ];
    let _other = scene.start("standin_node", &other);
    scene.await_subscriptions(2);
    let error = scene.play(&recording(&["/in"], 200, 100), &DEFAULT).err().unwrap();
    assert_eq!(error.reason(), "RecordingIncomplete");
    let sentence = error.to_string();
    assert!(
        sentence.contains(" publishes /out as ") && sentence.contains(", and it is recorded as "),
        "{sentence}"
    );
}

/// A node that publishes by a thread of its own on a topic that is recorded.
fn talker<'a>(publisher: &'a str, options: &[&'a str]) -> Vec<&'a str> {
    [&["--name", "/talker", "--pub", publisher], options].concat()
}

#[test]
fn what_is_kept_for_who_comes_late_is_recorded_whole() {
    let scene = Scene::new();
    let latched = "/out_kept:std_msgs/msg/String:50:reliable:transient_local";
    let _talker = scene.start("standin_node", &talker(latched, &["--burst", "50"]));
    scene.await_published("/out_kept", 50);
    for _ in 0..5 {
        let handed = Arc::new(AtomicU64::new(0));
        let node = joined(&scene.middleware(), handed.clone());
        node.subscribe("/out_kept").unwrap();
        eventually(|| {
            node.look().unwrap();
            node.publishers_of("/out_kept") > 0
        });
        eventually(|| handed.load(Ordering::SeqCst) == 50);
        assert_eq!(node.lacking(), [] as [String; 0]);
    }
}

/// Of a stack that never is quiet, so that waiting for that is in vain.
const REALTIME: Ask<'static> =
    Ask { mode: Mode::Realtime, drain: Duration::from_secs(2), ..DEFAULT };

#[test]
fn who_never_rests_is_compared_with_the_recording() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &deep_relay());
    let often = "/out_often:std_msgs/msg/String:10000:reliable";
    let _talker = scene.start("standin_node", &talker(often, &["--every-us", "500"]));
    let replayed = scene.play(&recording(&["/in"], 500, 100), &REALTIME).unwrap();
    assert_eq!(replayed.ledger.dropped, 0);
    let weak = "/out_often:std_msgs/msg/String:1:best_effort";
    let other = ["--name", "/other", "--pub", weak, "--every-us", "1000"];
    let mut late = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && late.is_none() {
            late = Some(scene.start("standin_node", &other));
        }
    };
    let played = scene.play_while(&recording(&["/in"], 2000, 100), &REALTIME, &mut seen);
    let error = played.err().unwrap();
    assert_eq!(error.reason(), "RecordingIncomplete");
    let sentence = error.to_string();
    assert!(sentence.contains("/other publishes /out_often as best effort"), "{sentence}");
}

#[test]
fn what_another_publishes_on_a_played_topic_later_makes_up_for_no_loss() {
    let scene = Scene::new();
    // It takes at most half of what comes.
    let slow = ["--name", "/slow", "--sub", "/in:sensor_msgs/msg/Imu:1:reliable"];
    let slow = [&slow[..], &["--delay-us", "2000"]].concat();
    let _slow = scene.start("standin_node", &slow);
    let other = "/in:sensor_msgs/msg/Imu:10:reliable";
    let other = ["--name", "/other", "--pub", other, "--every-us", "5000"];
    let mut late = None;
    let mut seen = |progress: Progress| {
        if progress.stage == Stage::Play && late.is_none() {
            late = Some(scene.start("standin_node", &other));
        }
    };
    let ask = Ask { mode: Mode::Realtime, drain: Duration::from_secs(4), ..DEFAULT };
    let replayed = scene.play_while(&recording(&["/in"], 400, 100), &ask, &mut seen).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!(ledger.sent, 400);
    assert!(ledger.dropped >= 150, "{ledger:?}");
}

#[test]
fn who_publishes_uncounted_is_named_and_hides_no_loss() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &deep_relay());
    let hidden = "/out_hidden:std_msgs/msg/String:10:reliable";
    let played = "/in:sensor_msgs/msg/Imu:10:reliable";
    let other = ["--name", "/hidden", "--pub", hidden, "--pub", played, "--burst", "1"];
    let _hidden = scene.start_uncounted("standin_node", &other);
    let looks = scene.graph.player();
    let is_there = |node: &GraphNode| node.name == "/hidden" && node.publishes.len() == 2;
    eventually(|| looks.graph().unwrap().iter().any(is_there));
    drop(looks);
    let ask = Ask { record: &["/out_hidden"], ..REALTIME };
    let replayed = scene.play(&recording(&["/in"], 700, 100), &ask).unwrap();
    let ledger = &replayed.ledger;
    let own = (ledger.sent, ledger.received, ledger.dropped, ledger.strength);
    assert_eq!(own, (700, 700, 0, Some(Strength::Called)));
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("/hidden publishes /out_hidden in a process"), "{warnings}");
    assert!(!warnings.contains("/in too"), "{warnings}");
}

#[test]
fn a_player_of_another_case_in_the_domain_ends_the_case() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    // Named as one of process 1 would be, which runs.
    let options = PlayerOptions {
        node: "bagpipe_player_1_0".into(),
        namespace: "/".into(),
        ..scene.graph.options()
    };
    let _other = Player::start(&options).unwrap();
    let error = scene.play(&recording(&["/in"], 3000, 100), &REALTIME).err().unwrap();
    let sentence = error.to_string();
    assert!(sentence.contains("/bagpipe_player_1_0 of another case"), "{sentence}");
    assert!(sentence.contains("ROS_DOMAIN_ID"), "{sentence}");
}

#[test]
fn a_callback_that_never_ends_is_waited_for_once_and_named() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let hangs = ["--name", "/hangs", "--sub", "/out:std_msgs/msg/String:100:reliable"];
    let hangs = [&hangs[..], &["--delay-us", "60000000"]].concat();
    let _hangs = scene.start("standin_node", &hangs);
    scene.await_subscriptions(2);
    let drain = Duration::from_secs(2);
    let ask = Ask { mode: Mode::Lockstep, drain, ..DEFAULT };
    let replayed = scene.play(&recording(&["/in"], 100, 50), &ask).unwrap();
    assert_eq!(recorded(&replayed).len(), 100);
    let remarks = replayed.playback.warnings.join("; ");
    let names = "a callback of /hangs on /out was not over in the time";
    assert!(remarks.contains(names), "{remarks}");
    // The first step's, and not those of the other ninety-nine.
    assert!(replayed.playback.played_seconds < 20.0, "{}", replayed.playback.played_seconds);
}

#[test]
fn without_a_player_or_a_ledger_no_recording_is_whole() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    scene.await_subscriptions(1);
    let middleware = scene.middleware();
    let node = joined(&middleware, Arc::default());
    assert_eq!(node.lacking(), [] as [String; 0]);
    let pid = middleware.pid().to_string();
    assert!(Command::new("kill").args(["-9", &pid]).status().unwrap().success());
    eventually(|| !node.lacking().is_empty());
    assert!(node.lacking()[0].contains("ended"), "{:?}", node.lacking());

    let node = joined(&scene.middleware(), Arc::default());
    // Any node can write there: a kind of endpoint that does not exist.
    let variables = scene.ledger.environment(Path::new("/unused"), None);
    let memory = &variables.iter().find(|one| one.0 == "BAGPIPE_LEDGER").unwrap().1;
    let length = std::fs::metadata(memory).unwrap().len();
    let mut file = std::fs::OpenOptions::new().write(true).open(memory).unwrap();
    file.write_all(&vec![0xee; usize::try_from(length).unwrap()]).unwrap();
    let lacking = node.lacking();
    assert!(lacking[0].starts_with("what was published can't be known"), "{lacking:?}");
}

#[test]
fn nothing_is_played_before_the_stacks_publishers_know_the_recorder() {
    let late = [&deep_relay()[..], &["--meets-late-ms", "1700"]].concat();
    for mode in [Mode::Max, Mode::Lockstep, Mode::Realtime] {
        let scene = Scene::new();
        let _relay = scene.start("standin_node", &late);
        let ask = Ask { mode, drain: Duration::from_secs(4), ..DEFAULT };
        let replayed = scene.play(&recording(&["/in"], 20, 50), &ask).unwrap();
        assert_eq!(recorded(&replayed).len(), 20, "{mode:?}");
    }
}
