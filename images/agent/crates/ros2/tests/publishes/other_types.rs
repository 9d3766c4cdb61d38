//! Topics of several types, some of whose publishers the graph does not name.

use std::cell::OnceCell;
use std::sync::Mutex;
use std::time::{Duration, Instant};

use bagpipe_mcap::Mcap;
use bagpipe_replay::{Mode, Progress, ReplayError, Replayed, Stage};
use bagpipe_ros2player::GraphPublisher;

use crate::has_met;
use crate::scene::{Ask, DEFAULT, MS, RELAY, Scene, recorded, recording};
use crate::standin::{Node, eventually};

pub(crate) const TALK: &str = "/talk:std_msgs/msg/String:1000:reliable";
/// A node for which /talk is of another type.
const READS: [&str; 4] = ["--name", "/reads", "--sub", TALK];

/// A node that publishes /talk, and counts.
pub(crate) const TALKS: [&str; 4] =
    ["--name", "/talks", "--pub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
/// A program that publishes it as another type, and nothing ever comes for it to pass on.
const PROGRAM: [&str; 3] = ["/other", "/talk", "std_msgs/String"];
/// How long a player waits before a short play, in which it would not get to know a program.
const KNOWN_BY: Duration = Duration::from_secs(3);
const REALTIME: Ask<'static> =
    Ask { mode: Mode::Realtime, drain: Duration::from_secs(1), ..DEFAULT };

pub(crate) fn play(scene: &Scene, record: &[&str], messages: u64) -> Result<Replayed, ReplayError> {
    play_while(scene, record, messages, |_| ())
}

pub(crate) fn play_while(
    scene: &Scene,
    record: &[&str],
    messages: u64,
    mut seen: impl FnMut(Progress),
) -> Result<Replayed, ReplayError> {
    scene.play_while(&recording(&["/in"], messages, 100), &Ask { record, ..REALTIME }, &mut seen)
}

/// Plays once /talks is known to the recorder, which records /talk as its type from then on: what that is
/// otherwise depends on whom a new player gets to know first. Only then others come, and when they are in
/// the graph the node that the play begins with.
fn play_beside(
    scene: &Scene,
    ask: &Ask<'_>,
    messages: u64,
    others: impl FnOnce() -> Vec<Node> + Send,
    mut seen: impl FnMut(Progress),
) -> Result<Replayed, ReplayError> {
    std::thread::scope(|scope| {
        let late = scope.spawn(|| {
            eventually(|| has_met(scene, "/talks"));
            let others = others();
            (others, scene.start("standin_node", &RELAY))
        });
        let played = scene.play_while(&recording(&["/in"], messages, 100), ask, &mut seen);
        drop(late.join().unwrap());
        played
    })
}

/// The same of a usual play of /out and /talk.
pub(crate) fn play_usual_beside(
    scene: &Scene,
    others: impl FnOnce() -> Vec<Node> + Send,
) -> Result<Replayed, ReplayError> {
    play_beside(scene, &Ask { record: &["/out", "/talk"], ..REALTIME }, 1000, others, |_| ())
}

/// Waits until a topic has so many publishers.
pub(crate) fn await_topic(scene: &Scene, topic: &str, publishers: usize) {
    let scout = scene.graph.player();
    eventually(|| scout.publishers_of(topic).unwrap().len() == publishers);
}

fn missed(played: Result<Replayed, ReplayError>) -> String {
    let error = played.err().unwrap();
    assert_eq!(error.reason(), "RecordingIncomplete");
    error.to_string()
}

/// How many messages of a topic were recorded, each as this type.
fn as_type(replayed: &Replayed, topic: &str, datatype: &str) -> usize {
    let mcap = Mcap::open(replayed.recorded_bag.clone()).unwrap();
    let of_topic = mcap.connections().iter().filter(|one| one.topic == topic);
    assert!(of_topic.into_iter().all(|one| one.datatype == datatype));
    recorded(replayed).iter().filter(|one| one.0 == topic).count()
}

const OTHER_TYPE: &str =
    "publish it as std_msgs/msg/String, and it is recorded as sensor_msgs/msg/Imu";

#[test]
fn what_only_a_program_publishes_that_is_no_node_is_recorded_as_its_own_type() {
    // Whoever subscribes as another type, and by a pattern as well as by its name.
    let usual = DEFAULT.stable;
    for (stable, messages, record) in
        [(KNOWN_BY, 20, "/talk"), (usual, 2000, "/talk"), (usual, 1000, "/ta.k")]
    {
        let scene = Scene::new();
        let _reads = scene.start("standin_node", &READS);
        let _relay = scene.start("standin_node", &RELAY);
        let _program = scene.start_uncounted("dds_relay", &["/in", "/talk", "sensor_msgs/Imu"]);
        await_topic(&scene, "/talk", 1);
        let ask = Ask { stable, record: &["/out", record], ..REALTIME };
        let replayed = scene.play(&recording(&["/in"], messages, 100), &ask).unwrap();
        assert!(as_type(&replayed, "/talk", "sensor_msgs/msg/Imu") > 0);
        let warnings = replayed.playback.warnings.join("; ");
        let named = "programs of DDS that are no nodes, or nodes of a name that another has, publish /talk (at least 1)";
        assert!(warnings.contains(named), "{warnings}");
    }
}

#[test]
fn what_is_published_as_another_type_than_a_node_s_is_missed_of_who_does_not_count() {
    // Also in a play that is shorter than the looks.
    for (stable, messages) in [(KNOWN_BY, 20), (DEFAULT.stable, 2000)] {
        let scene = Scene::new();
        let _talks = scene.start("standin_node", &TALKS);
        let other = || {
            let program = scene.start_uncounted("dds_relay", &PROGRAM);
            await_topic(&scene, "/talk", 2);
            vec![program]
        };
        let ask = Ask { stable, record: &["/out", "/talk"], ..REALTIME };
        let text = missed(play_beside(&scene, &ask, messages, other, |_| ()));
        assert!(text.contains("/talk has publishers (at least 1) that do not count"), "{text}");
        assert!(text.contains(OTHER_TYPE), "{text}");
    }
}

#[test]
fn so_it_is_of_a_node_whose_name_another_has() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    let text = missed(play_usual_beside(&scene, || {
        let words = ["--name", "/talks", "--pub", TALK];
        let namesake = scene.start_uncounted("standin_node", &words);
        await_topic(&scene, "/talk", 2);
        vec![namesake]
    }));
    assert!(text.contains("/talk has publishers (at least 1) that do not count"), "{text}");
}

#[test]
fn who_counts_and_has_published_nothing_as_another_type_is_missed_by_nobody() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    let others = || {
        let start = |name| scene.start("standin_node", &["--name", name, "--pub", TALK]);
        let others = ["/silent", "/talks"].map(start).into();
        await_topic(&scene, "/talk", 3);
        others
    };
    let replayed = play_usual_beside(&scene, others).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}

#[test]
fn what_is_played_as_another_type_is_recorded_as_the_stack_publishes_it() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &RELAY);
    let _program = scene.start_uncounted("dds_relay", &["/other", "/in", "std_msgs/String"]);
    await_topic(&scene, "/in", 1);
    let replayed = play(&scene, &["/out", "/in"], 1000).unwrap();
    assert_eq!(as_type(&replayed, "/in", "std_msgs/msg/String"), 0);
}

#[test]
fn a_topic_of_two_types_that_nobody_publishes_lacks_nothing() {
    let scene = Scene::new();
    let _reads = scene.start("standin_node", &READS);
    let other = ["--name", "/other", "--sub", "/talk:sensor_msgs/msg/Imu:10:reliable"];
    let _other = scene.start("standin_node", &other);
    let _relay = scene.start("standin_node", &RELAY);
    let replayed = play(&scene, &["/out", "/talk"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}

#[test]
fn who_is_killed_before_the_play_hides_no_program() {
    let scene = Scene::new();
    drop(scene.start("standin_node", &TALKS));
    let _again = scene.start("standin_node", &TALKS);
    let scout = scene.graph.player();
    let is_program = |one: GraphPublisher| one.node.is_none();
    let text = missed(play_usual_beside(&scene, || {
        let program = scene.start_uncounted("dds_relay", &PROGRAM);
        eventually(|| scout.publishers_of("/talk").unwrap().into_iter().any(is_program));
        vec![program]
    }));
    assert!(text.contains(OTHER_TYPE), "{text}");
}

#[test]
fn nor_does_who_was_killed_hide_one_of_its_name() {
    let of_type = |datatype: &str| {
        let scene = Scene::new();
        let (killed, scout) = (scene.start("standin_node", &TALKS), scene.graph.player());
        let publishers = || scout.publishers_of("/talk").unwrap().len();
        eventually(|| publishers() == 1);
        drop(killed);
        eventually(|| publishers() == 0);
        let _talks = scene.start("standin_node", &TALKS);
        let talk = format!("/talk:{datatype}:10:reliable");
        play_usual_beside(&scene, || {
            let words = ["--name", "/talks", "--pub", &talk];
            let namesake = scene.start_uncounted("standin_node", &words);
            await_topic(&scene, "/talk", 2);
            vec![namesake]
        })
    };
    let text = missed(of_type("std_msgs/msg/String"));
    assert!(text.contains(OTHER_TYPE), "{text}");
    let warnings = of_type("sensor_msgs/msg/Imu").unwrap().playback.warnings.join("; ");
    let named = "nodes of a name that another has, publish /talk (at least 1)";
    assert!(warnings.contains(named), "{warnings}");
}

#[test]
fn nor_does_who_leaves_in_the_play_hide_whoever_publishes_from_then_on() {
    let namesake: (&str, &[&str]) = ("standin_node", &["--name", "/talks", "--pub", TALK]);
    for scene in [Scene::new(), Scene::on_dds()] {
        for (program, words) in [namesake, ("dds_relay", &PROGRAM)] {
            let mut talks = Some(scene.start("standin_node", &TALKS));
            let _relay = scene.start("standin_node", &RELAY);
            let scout = scene.graph.player();
            let publishes = |one: GraphPublisher| one.datatype == "std_msgs/msg/String";
            let is_there = || scout.publishers_of("/talk").unwrap().into_iter().any(publishes);
            let mut other = None;
            let played = play_while(&scene, &["/out", "/talk"], 3000, |progress| {
                if progress.stage == Stage::Play
                    && let Some(talks) = talks.take()
                {
                    assert!(talks.end());
                    other = Some(scene.start_uncounted(program, words));
                    eventually(is_there);
                }
            });
            let text = missed(played);
            assert!(text.contains(OTHER_TYPE), "{text}");
        }
    }
}

#[test]
fn who_leaves_before_the_end_is_missed() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    let program = Mutex::new(None);
    let other = || {
        *program.lock().unwrap() = Some(scene.start_uncounted("dds_relay", &PROGRAM));
        await_topic(&scene, "/talk", 2);
        Vec::new()
    };
    let plays_since = OnceCell::new();
    let ask = Ask { record: &["/out", "/talk"], ..REALTIME };
    let played = play_beside(&scene, &ask, 5000, other, |progress| {
        let plays = progress.stage == Stage::Play;
        if plays && plays_since.get_or_init(Instant::now).elapsed() > Duration::from_secs(2) {
            program.lock().unwrap().take().map(Node::end);
        }
    });
    assert!(program.into_inner().unwrap().is_none());
    assert!(missed(played).contains(OTHER_TYPE));
}

#[test]
fn who_leaves_before_the_play_is_not_missed() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &["--name", "/talks", "--pub", TALK]);
    let _relay = scene.start("standin_node", &RELAY);
    let _reads = scene.start(
        "standin_node",
        &["--name", "/reads", "--sub", "/talk:sensor_msgs/msg/Imu:1000:reliable"],
    );
    let words = ["/in", "/talk", "sensor_msgs/Imu"];
    let mut program = Some(scene.start_uncounted("dds_relay", &words));
    await_topic(&scene, "/talk", 2);
    let ask = Ask { lead_in: 3000 * MS, record: &["/out", "/talk"], ..REALTIME };
    let played = scene.play_while(&recording(&["/in"], 4000, 100), &ask, &mut |progress| {
        // Whose messages arrive has been seen by the player, too.
        let all = || scene.ledger.endpoints().unwrap();
        let is_known = || all().iter().any(|one| one.topic == "/talk" && one.counts.taken > 0);
        if progress.stage == Stage::LeadIn && is_known() {
            program.take().map(Node::end);
        }
    });
    assert!(program.is_none());
    assert!(recorded(&played.unwrap()).iter().all(|one| one.0 == "/out"));
}

#[test]
fn a_program_whose_type_is_not_installed_costs_a_pattern_no_other_topic() {
    for scene in [Scene::new(), Scene::on_dds()] {
        let _relay = scene.start("standin_node", &RELAY);
        let odd = ["/other", "/odd", "not_installed_msgs/Thing"];
        let _program = scene.start_uncounted("dds_relay", &odd);
        await_topic(&scene, "/odd", 1);
        let later = ["--name", "/late", "--pub", "/later:std_msgs/msg/String:1000:reliable"];
        let later = [&later[..], &["--burst", "100000", "--every-us", "10000"]].concat();
        let mut late = None;
        let played = play_while(&scene, &["/.*"], 2000, |progress| {
            if progress.stage == Stage::Play {
                late.get_or_insert_with(|| {
                    let node = scene.start("standin_node", &later);
                    await_topic(&scene, "/later", 1);
                    node
                });
            }
        });
        let replayed = played.unwrap();
        assert!(as_type(&replayed, "/later", "std_msgs/msg/String") > 0);
    }
}

#[test]
fn what_is_asked_for_by_its_name_and_can_t_be_recorded_is_missed_though_it_comes_in_the_play() {
    // Also where a pattern is asked for beside it, of which no topic is.
    for record in [&["/out", "/odd"][..], &["/out", "/odd", "/zz.*"]] {
        let scene = Scene::new();
        let _relay = scene.start("standin_node", &RELAY);
        let mut program = None;
        let played = play_while(&scene, record, 2000, |progress| {
            if progress.stage == Stage::Play {
                program.get_or_insert_with(|| {
                    let odd = ["/other", "/odd", "not_installed_msgs/Thing"];
                    let program = scene.start_uncounted("dds_relay", &odd);
                    await_topic(&scene, "/odd", 1);
                    program
                });
            }
        });
        let text = missed(played);
        assert!(text.contains("the graph can't be read to its end"), "{text}");
        assert!(text.contains("not_installed_msgs"), "{text}");
    }
}

/// Plays with a node that has published /talk so before and leaves once it is known to the recorder.
fn beside_who_left_before(topic: &str) -> Result<Replayed, ReplayError> {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    await_topic(&scene, "/talk", 1);
    play_usual_beside(&scene, || {
        let words = ["--name", "/once", "--pub", topic, "--burst", "3"];
        let once = scene.start("standin_node", &words);
        scene.await_published("/talk", 3);
        std::thread::sleep(Duration::from_millis(700));
        assert!(once.end());
        await_topic(&scene, "/talk", 1);
        Vec::new()
    })
}

#[test]
fn what_can_t_be_recorded_is_not_missed_of_who_has_left_before_the_play() {
    for topic in [TALK, "/talk:sensor_msgs/msg/Imu:10:best_effort"] {
        let replayed = beside_who_left_before(topic).unwrap();
        assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
    }
}

#[test]
fn it_is_missed_of_who_is_there_when_the_play_begins_and_leaves_in_it() {
    for (topic, why) in [
        (TALK, OTHER_TYPE.replace("publish it", "publishes /talk")),
        ("/talk:sensor_msgs/msg/Imu:10:best_effort", "publishes /talk as best effort".to_owned()),
    ] {
        let scene = Scene::new();
        let _talks = scene.start("standin_node", &TALKS);
        await_topic(&scene, "/talk", 1);
        let mut once = None;
        let ask = Ask { lead_in: 2000 * MS, record: &["/out", "/talk"], ..REALTIME };
        let _relay = scene.start("standin_node", &RELAY);
        let mut left = false;
        let played = scene.play_while(&recording(&["/in"], 2100, 100), &ask, &mut |progress| {
            if progress.stage == Stage::LeadIn && once.is_none() && !left {
                let words = ["--name", "/once", "--pub", topic, "--every-us", "10000"];
                once = Some(scene.start("standin_node", &words));
                scene.await_published("/talk", 3);
            }
            if progress.stage == Stage::Play {
                left |= once.take().is_some_and(Node::end);
            }
        });
        assert!(left);
        let text = missed(played);
        assert!(text.contains(&format!("/once {why}")), "{text}");
    }
}
