//! What there is much of in one case: topics, messages of one moment, threads of a node.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::collections::BTreeMap;
use std::time::Instant;

use bagpipe_log::RecordingWriter;
use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};
use bagpipe_replay::{Mode, Progress, Stage, Strength};
use bagpipe_ros2ledger::Kind;
use scene::{Ask, MS, Scene, imu, recorded, recording, stamped};
use standin::hash;

const TOPICS: usize = 1000;

/// Arguments of a node that answers each of these topics on one of its own.
fn relay(inputs: &[String], more: &[&str]) -> Vec<String> {
    let topics = inputs.iter().flat_map(|input| {
        let output = format!("/out{input}");
        let relay = format!("{input}={output}");
        let input = format!("{input}:sensor_msgs/msg/Imu:10:reliable");
        let output = format!("{output}:std_msgs/msg/String:10:reliable");
        [["--sub".to_owned(), input], ["--pub".to_owned(), output], ["--relay".to_owned(), relay]]
    });
    let more = more.iter().map(|&one| one.to_owned());
    topics.flatten().chain(more).collect()
}

fn borrowed(all: &[String]) -> Vec<&str> {
    all.iter().map(String::as_str).collect()
}

#[test]
fn a_thousand_topics_are_played_and_recorded_in_one_case() {
    let scene = Scene::new();
    let inputs: Vec<String> = (0..TOPICS).map(|one| format!("/in_{one}")).collect();
    let _relay = scene.start("standin_node", &borrowed(&relay(&inputs, &["--name", "/relay"])));
    scene.await_subscriptions(TOPICS);
    let mcap = recording(&borrowed(&inputs), 5 * TOPICS as u64, 100);
    // So many are found one after the other, and a busy machine pauses in between.
    let topics = borrowed(&inputs);
    let ask = Ask { topics: &topics, ..Ask::default() };
    let replayed = scene.play(&mcap, &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (5000, 5000, 0));
    assert_eq!(ledger.strength, Some(Strength::Called));
    assert_eq!(ledger.topics.len(), TOPICS);
    let mut answers: BTreeMap<String, usize> = BTreeMap::new();
    recorded(&replayed).into_iter().for_each(|(topic, ..)| *answers.entry(topic).or_default() += 1);
    let expected = inputs.iter().map(|input| (format!("/out{input}"), 5)).collect();
    assert_eq!(answers, expected);
}

/// Messages of which so many at a time have one stamp, on the topics in an order that differs.
fn of_equal_stamps(topics: &[String], moments: u64) -> Mcap {
    let mut writer = McapWriter::new(WriterOptions::default());
    let ids: Vec<u32> = topics
        .iter()
        .map(|topic| RecordingWriter::add_connection(&mut writer, &imu(topic)))
        .collect();
    for number in 0..moments * ids.len() as u64 {
        let moment = number / ids.len() as u64;
        let id = ids[(number + moment) as usize % ids.len()];
        let time = (1000 + moment) * MS;
        RecordingWriter::write(&mut writer, id, time, &stamped(time, number, 100)).unwrap();
    }
    Mcap::open(RecordingWriter::finish(Box::new(writer)).unwrap()).unwrap()
}

/// How a node is played to in lock-step, and what it answers on one topic to messages of equal stamps.
struct Stepped {
    answers: Vec<(String, u64, Vec<u8>)>,
    warnings: Vec<String>,
}

fn in_lock_step(program: &str, moments: u64, more: &[&str]) -> Stepped {
    let scene = Scene::new();
    let inputs: Vec<String> = (0..4).map(|one| format!("/in_{one}")).collect();
    let subscribed = inputs.iter().flat_map(|input| {
        let topic = format!("{input}:sensor_msgs/msg/Imu:10:reliable");
        ["--sub".to_owned(), topic, "--relay".to_owned(), format!("{input}=/out")]
    });
    let own = ["--name", "/relay", "--pub", "/out:std_msgs/msg/String:100:reliable"];
    let own = own.iter().chain(more).map(|&one| one.to_owned());
    let arguments: Vec<String> = subscribed.chain(own).collect();
    let _relay = scene.start(program, &borrowed(&arguments));
    scene.await_subscriptions(4);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&of_equal_stamps(&inputs, moments), &ask).unwrap();
    let ledger = &replayed.ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (4 * moments, 4 * moments, 0));
    Stepped { answers: recorded(&replayed), warnings: replayed.playback.warnings }
}

/// The hash of the message that an answer is to.
fn answered(answer: &[u8]) -> String {
    String::from_utf8(answer[8..24].to_vec()).unwrap()
}

#[test]
fn in_lock_step_messages_of_equal_stamps_keep_their_order() {
    let first = in_lock_step("standin_node", 50, &["--delay-us", "300"]).answers;
    let played = |one: u64| {
        let time = (1000 + one / 4) * MS;
        (time, format!("{:016x}", hash(&stamped(time, one, 100))))
    };
    let answers: Vec<(u64, String)> =
        first.iter().map(|(_, time, bytes)| (*time, answered(bytes))).collect();
    assert_eq!(answers, (0..200).map(played).collect::<Vec<_>>());
    let again = |program, more: &[&str]| in_lock_step(program, 50, more).answers;
    assert_eq!(again("standin_node_py", &[]), first);
    // Of an executor of several threads, the end of each callback is known as well.
    assert_eq!(again("standin_node", &["--threads", "4", "--delay-us", "300"]), first);
}

#[test]
fn in_lock_step_what_a_node_makes_of_a_message_comes_before_the_next_one_of_the_same_time() {
    let scene = Scene::new();
    let inputs = ["/in_0", "/in_1"].map(str::to_owned);
    // Two nodes, of which the player awaits the first one's callbacks by itself.
    let first = ["--name", "/first", "--sub", "/in_0:sensor_msgs/msg/Imu:10:reliable"];
    let near = ["--pub", "/near:std_msgs/msg/String:10:reliable", "--relay", "/in_0=/near"];
    let _first = scene.start("standin_node", &[first, near].concat());
    let between = ["--name", "/between", "--sub", "/near:std_msgs/msg/String:10:reliable"];
    let mid = ["--pub", "/mid:std_msgs/msg/String:10:reliable", "--relay", "/near=/mid"];
    let between = [&between[..], &mid, &["--delay-us", "2000"]].concat();
    let _between = scene.start("standin_node", &between);
    let second = ["--name", "/second", "--sub", "/mid:std_msgs/msg/String:10:reliable"];
    let both = ["--sub", "/in_1:sensor_msgs/msg/Imu:10:reliable", "--relay", "/in_1=/out"];
    let out = ["--pub", "/out:std_msgs/msg/String:100:reliable", "--relay", "/mid=/out"];
    let _second = scene.start("standin_node", &[&second[..], &both, &out].concat());
    scene.await_subscriptions(4);
    let ask = Ask { mode: Mode::Lockstep, ..Ask::default() };
    let replayed = scene.play(&of_equal_stamps(&inputs, 20), &ask).unwrap();
    let answers = recorded(&replayed);
    let answers: Vec<String> = answers
        .iter()
        .filter(|(topic, ..)| topic == "/out")
        .map(|(.., bytes)| answered(bytes))
        .collect();
    // Which topic is first alternates; that of /in_0 comes by /mid, as another message.
    let played = (0..40).map(|one: u64| {
        let hash = format!("{:016x}", hash(&stamped((1000 + one / 2) * MS, one, 100)));
        let by_mid = (one + one / 2).is_multiple_of(2);
        (!by_mid).then_some(hash)
    });
    assert_eq!(answers.len(), 40);
    for (number, (answer, direct)) in answers.iter().zip(played).enumerate() {
        assert!(direct.is_none_or(|direct| direct == *answer), "{number}");
    }
}

#[test]
fn in_lock_step_threads_that_show_no_end_are_waited_for_a_moment_and_lose_nothing() {
    let threads = ["--threads", "4", "--delay-us", "300"];
    let stepped = in_lock_step("standin_node_py", 10, &threads);
    let [why] = &stepped.warnings[..] else { panic!("{:?}", stepped.warnings) };
    let (count, rest) = why.split_once(' ').unwrap();
    assert!((2..=4).contains(&count.parse::<u32>().unwrap()), "{why}");
    assert_eq!(
        rest,
        "threads of /relay have waited for messages or taken some, and when a callback ends is not \
         reported: lock-step may go on before that, and two runs may differ; give it one thread"
    );
    let mut answers: Vec<String> = stepped.answers.iter().map(|one| answered(&one.2)).collect();
    let of = |one: u64| format!("{:016x}", hash(&stamped((1000 + one / 4) * MS, one, 100)));
    let mut expected: Vec<String> = (0..40).map(of).collect();
    answers.sort();
    expected.sort();
    assert_eq!(answers, expected);
}

#[test]
fn in_lock_step_one_thread_that_shows_no_end_is_waited_for_though_it_sleeps() {
    // Longer than threads of which none is known to work.
    let stepped = in_lock_step("standin_node_py", 3, &["--delay-us", "400000"]);
    let times: Vec<u64> = stepped.answers.iter().map(|one| one.1 / MS).collect();
    assert_eq!(times, (0..12).map(|one| 1000 + one / 4).collect::<Vec<_>>());
    assert_eq!(stepped.warnings, [] as [String; 0]);
}

#[test]
fn in_lock_step_who_has_timers_of_the_machine_s_clock_is_named() {
    let ticks = ["--pub", "/tick:std_msgs/msg/String:100:reliable", "--every-us", "2000"];
    let timed = |program, timer| {
        let more = [&ticks[..], &["--timer", timer]].concat();
        in_lock_step(program, 10, &more).warnings
    };
    for program in ["standin_node", "standin_node_py"] {
        assert_eq!(timed(program, "ros"), [] as [String; 0]);
        let [warning] = &timed(program, "wall")[..] else { panic!("{program}") };
        let begins = "timers of the machine's clock called back ";
        let (calls, rest) = warning.strip_prefix(begins).unwrap().split_once(' ').unwrap();
        assert!(rest.starts_with("times in /relay during the play: "), "{warning}");
        assert!(calls.parse::<u64>().unwrap() > 0, "{warning}");
    }
}

#[test]
fn at_full_speed_nobody_is_named_for_the_clock_of_its_timers() {
    let scene = Scene::new();
    let ticks = ["--name", "/ticks", "--every-us", "1000", "--timer", "wall"];
    let ends = ["--pub", "/tick:std_msgs/msg/String:100:reliable"];
    let input = ["--sub", "/in:sensor_msgs/msg/Imu:10:reliable", "--delay-us", "1000"];
    let _ticks = scene.start("standin_node", &[&ticks[..], &ends, &input].concat());
    let replayed = scene.play(&recording(&["/in"], 100, 50), &Ask::default()).unwrap();
    assert_eq!(replayed.playback.warnings, [] as [String; 0]);
}

#[test]
fn of_a_deep_queue_no_more_is_used_than_any_middleware_carries_without_loss() {
    let scene = Scene::new();
    let queue = "/in:sensor_msgs/msg/Imu:1000:reliable";
    let slow = ["--name", "/slow", "--sub", queue, "--delay-us", "1000"];
    let _slow = scene.start("standin_node", &slow);
    let taken = || {
        let all = scene.ledger.endpoints().unwrap();
        let of_it = all.iter().find(|one| one.kind == Kind::Subscription && one.topic == "/in");
        of_it.map_or(0, |one| one.counts.taken)
    };
    let mut most = 0;
    // What is taken meanwhile makes it less.
    let mut seen = |progress: Progress| most = most.max(progress.sent.saturating_sub(taken()));
    let replayed = scene.play_while(&recording(&["/in"], 1500, 100), &Ask::default(), &mut seen);
    let ledger = replayed.unwrap().ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (1500, 1500, 0));
    assert!((32..=128).contains(&most), "{most} messages waited");
}

#[test]
fn the_slower_of_two_sets_the_pace_and_is_named_with_its_queue() {
    let scene = Scene::new();
    let start = |name, depth, more: &[&str]| {
        let topic = format!("/in:sensor_msgs/msg/Imu:{depth}:reliable");
        scene.start("standin_node", &[&["--name", name, "--sub", &topic][..], more].concat())
    };
    let goes_on = scene.file("goes-on");
    let awaits = format!("85:{}", goes_on.display());
    let _quick = start("/quick", 7, &[]);
    let _slow = start("/slow", 10, &["--delay-us", "1000", "--awaits", &awaits]);
    scene.await_subscriptions(2);
    let taken = |node| {
        let all = scene.ledger.endpoints().unwrap();
        all.iter().find(|one| one.node == node).map_or(0, |one| one.counts.taken)
    };
    let (mut begun, mut reports) = (None, Vec::new());
    let mut seen = |progress: Progress| {
        if progress.stage != Stage::Play {
            return;
        }
        let begun = *begun.get_or_insert_with(Instant::now);
        // All that finds room at the slow one has gone out, and the other has taken it: that one has room
        // for the rest, whatever holds it up. Who waits has seen that when it reports again.
        if taken("/slow") == 85 && taken("/quick") == 95 {
            reports.push(Instant::now());
        }
        // Longer than the other can have been waited for.
        if reports.get(1).is_some_and(|at| at.elapsed() > *at - begun) {
            std::fs::write(&goes_on, "").unwrap();
        }
    };
    let replayed =
        scene.play_while(&recording(&["/in"], 100, 50), &Ask::default(), &mut seen).unwrap();
    let playback = &replayed.playback;
    let pace = playback.pace.clone().unwrap();
    assert!(pace.starts_with("/slow set the pace: the play waited "), "{pace}");
    assert!(
        pace.contains(" more of /in, of which at most 10 may wait at it, and it took "),
        "{pace}"
    );
    let lines = &replayed.ledger.topics[0].subscribers;
    let held: BTreeMap<&str, f64> =
        lines.iter().map(|line| (line.node.as_str(), line.held_up_seconds)).collect();
    let rooms: Vec<Option<u64>> = lines.iter().map(|line| line.room).collect();
    assert_eq!(rooms, [Some(7), Some(10)]);
    assert!(held["/slow"] <= playback.played_seconds, "{held:?}");
    assert!(held["/slow"] > held["/quick"], "{held:?}");
}
