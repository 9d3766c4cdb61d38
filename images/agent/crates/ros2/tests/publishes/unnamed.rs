//! Who publishes what is recorded and does not count, where the graph has no name of it or one that another has.

use std::time::{Duration, Instant};

use bagpipe_replay::{ReplayError, Replayed, Stage};

use crate::other_types::{TALK, TALKS, await_topic, play, play_usual_beside, play_while};
use crate::scene::{RELAY, Scene, recorded};
use crate::standin::{Node, eventually};

/// What warns of those that publish /talk and do not count, where it is recorded as Imu.
fn warnings_of(scene: &Scene) -> String {
    let _relay = scene.start("standin_node", &RELAY);
    publish_warnings(play(scene, &["/out", "/talk"], 1000))
}

fn publish_warnings(played: Result<Replayed, ReplayError>) -> String {
    let all = played.unwrap().playback.warnings.into_iter();
    all.filter(|warning| warning.contains(" publish") && warning.contains("/talk")).collect()
}

#[test]
fn a_namesake_that_counts_and_publishes_something_else_hides_nobody() {
    for counts_first in [true, false] {
        let scene = Scene::new();
        let other = ["--name", "/talks", "--pub", "/other:sensor_msgs/msg/Imu:10:reliable"];
        let first = counts_first.then(|| scene.start("standin_node", &other));
        let _namesake = scene.start_uncounted("standin_node", &TALKS);
        await_topic(&scene, "/talk", 1);
        let _second = first.is_none().then(|| scene.start("standin_node", &other));
        await_topic(&scene, "/other", 1);
        // The graph's lists by node show what one of them has.
        assert!(!warnings_of(&scene).is_empty());
    }
}

#[test]
fn who_counts_and_publishes_another_type_hides_nobody() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    let others = || {
        let silent = scene.start("standin_node", &["--name", "/silent", "--pub", TALK]);
        let words = ["/other", "/talk", "sensor_msgs/Imu"];
        let program = scene.start_uncounted("dds_relay", &words);
        await_topic(&scene, "/talk", 3);
        vec![silent, program]
    };
    let warnings = publish_warnings(play_usual_beside(&scene, others));
    assert!(warnings.contains("publish /talk (at least 1)"), "{warnings}");
}

/// Who offers best effort or volatile messages is not matched by a recorder of the counting publisher's, and the numbers
/// of both are the same.
#[test]
fn who_is_not_matched_is_not_hidden_by_who_counts_and_is() {
    let scene = Scene::new();
    let _talks = scene.start("standin_node", &TALKS);
    let best_effort = "/talk:sensor_msgs/msg/Imu:10:best_effort";
    let words = ["--name", "/talks", "--pub", best_effort, "--every-us", "1000"];
    let _namesake = scene.start_uncounted("standin_node", &words);
    await_topic(&scene, "/talk", 2);
    let warnings = warnings_of(&scene);
    assert!(warnings.contains("publish /talk (at least 1)"), "{warnings}");
}

#[test]
fn nor_by_who_counts_and_keeps_what_it_publishes() {
    let scene = Scene::new();
    let kept = "/talk:sensor_msgs/msg/Imu:10:reliable:transient_local";
    let _talks = scene.start("standin_node", &["--name", "/talks", "--pub", kept]);
    let _program = scene.start_uncounted("dds_relay", &["/in", "/talk", "sensor_msgs/Imu"]);
    await_topic(&scene, "/talk", 2);
    let warnings = warnings_of(&scene);
    assert!(warnings.contains("publish /talk (at least 1)"), "{warnings}");
}

#[test]
fn who_comes_in_the_last_second_of_the_play_is_named() {
    let namesake = [&TALKS[..], &["--every-us", "1000"]].concat();
    let named = ["--name", "/late", "--pub", TALKS[3]];
    for (words, warning) in [
        (&namesake[..], "publish /talk (at least 1)"),
        (&named, "/late publishes /talk in a process that does not count"),
    ] {
        let scene = Scene::new();
        let _talks = scene.start("standin_node", &TALKS);
        let _relay = scene.start("standin_node", &RELAY);
        let scout = scene.graph.player();
        let is_there = || scout.publishers_of("/talk").unwrap().len() == 2;
        let (mut late, mut since) = (None, None);
        let played = play_while(&scene, &["/out", "/talk"], 3000, |progress| {
            if progress.stage == Stage::Play
                && since.get_or_insert_with(Instant::now).elapsed() > Duration::from_secs(2)
            {
                late.get_or_insert_with(|| {
                    let node = scene.start_uncounted("standin_node", words);
                    eventually(is_there);
                    node
                });
            }
        });
        assert!(late.is_some());
        let warnings = played.unwrap().playback.warnings.join("; ");
        assert_eq!(warnings.matches(" publish").count(), 1, "{warnings}");
        assert!(warnings.contains(warning), "{warnings}");
    }
}

#[test]
fn of_a_hundred_topics_each_is_asked_for_in_its_turn() {
    let scene = Scene::new();
    let topics: Vec<String> =
        (0..100).map(|one| format!("/talk_{one}:sensor_msgs/msg/Imu:10:reliable")).collect();
    let publishes = topics.iter().flat_map(|topic| ["--pub", topic]);
    let words: Vec<&str> = ["--name", "/talks"].into_iter().chain(publishes).collect();
    let _talks = scene.start("standin_node", &words);
    let _relay = scene.start("standin_node", &RELAY);
    let best_effort = "/talk_70:sensor_msgs/msg/Imu:10:best_effort";
    let words = ["--name", "/talks", "--pub", best_effort, "--every-us", "1000"];
    let mut namesake = Some(scene.start_uncounted("standin_node", &words));
    await_topic(&scene, "/talk_70", 2);
    let mut since = None;
    let played = play_while(&scene, &["/out", "/talk_.*"], 8000, |progress| {
        // It is gone when all topics are asked for at the end.
        if progress.stage == Stage::Play
            && since.get_or_insert_with(Instant::now).elapsed() > Duration::from_secs(6)
        {
            namesake.take().map(Node::end);
        }
    });
    assert!(namesake.is_none());
    let warnings = played.unwrap().playback.warnings.join("; ");
    assert_eq!(warnings.matches("publish /talk_").count(), 1, "{warnings}");
    assert!(warnings.contains("publish /talk_70 (at least 1)"), "{warnings}");
}

#[test]
fn where_no_gids_are_known_a_program_is_one_more_than_count() {
    for program in [true, false] {
        let scene = Scene::new();
        let talks = [&TALKS[..], &["--origins", "none"]].concat();
        let _talks = scene.start("standin_node", &talks);
        let words = ["/other", "/talk", "sensor_msgs/Imu"];
        let _program = program.then(|| scene.start_uncounted("dds_relay", &words));
        await_topic(&scene, "/talk", 1 + usize::from(program));
        assert_eq!(warnings_of(&scene).contains("publish /talk (at least 1)"), program);
    }
}

#[test]
fn what_a_command_line_publishes_is_found_by_no_pattern() {
    let scene = Scene::new();
    let topic = "/typed:std_msgs/msg/String:1000:reliable";
    let words = ["--name", "/_ros2cli_7", "--pub", topic, "--burst", "100000"];
    let words = [&words[..], &["--every-us", "10000"]].concat();
    let _command_line = scene.start_uncounted("standin_node", &words);
    let _relay = scene.start("standin_node", &RELAY);
    await_topic(&scene, "/typed", 1);
    let replayed = play(&scene, &["/.*"], 1000).unwrap();
    assert!(recorded(&replayed).iter().all(|one| one.0 == "/out"));
}
