//! Publishers that the recorder never meets, as nodes of another domain: what they publish is missed, whoever else
//! publishes the topic, and whenever they came; and nobody's own messages are, beside one that publishes nothing.

use std::time::Duration;

use bagpipe_replay::{Mode, Progress, ReplayError, Replayed, Stage};

use crate::other_types::await_topic;
use crate::scene::{Ask, DEFAULT, RELAY, Scene, recorded, recording};
use crate::standin::{Graph, Node};

const TALK: &str = "/talk:std_msgs/msg/String:1000:reliable";
const KEPT: &str = "/talk:std_msgs/msg/String:10:reliable:transient_local";
const ASK: Ask<'static> =
    Ask { mode: Mode::Realtime, record: &["/talk"], drain: Duration::from_secs(1), ..DEFAULT };

/// A node that publishes /talk so often, in µs.
fn talker<'a>(name: &'a str, every_us: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["--name", name, "--pub", TALK, "--every-us", every_us][..], more].concat()
}

/// How many messages are missed, and of whom.
fn missed(played: Result<Replayed, ReplayError>, nodes: &str) -> u64 {
    let error = match played {
        Err(error) => error,
        Ok(replayed) => panic!("passed with {} recorded", recorded(&replayed).len()),
    };
    assert_eq!(error.reason(), "RecordingIncomplete");
    let text = error.to_string();
    let sentence =
        format!(" messages of /talk did not reach the recorder, which {nodes} did not know");
    let Some((before, _)) = text.split_once(&sentence) else { panic!("{text}") };
    before.rsplit(|one: char| !one.is_ascii_digit()).next().unwrap().parse().unwrap()
}

struct Apart {
    scene: Scene,
    elsewhere: Graph,
    _relay: Option<Node>,
}

impl Apart {
    fn new() -> Apart {
        let scene = Scene::new();
        let relay = scene.start("standin_node", &RELAY);
        Apart { scene, elsewhere: Graph::new(), _relay: Some(relay) }
    }

    /// A node that counts here, and is in another domain.
    fn far(&self, arguments: &[&str]) -> Node {
        self.elsewhere.start_counting("standin_node", arguments, &self.scene.ledger)
    }

    fn near(&self, arguments: &[&str]) -> Node {
        self.scene.start("standin_node", arguments)
    }

    /// Plays so many messages, 1 ms apart; somebody comes when the play has begun.
    fn play(
        &self,
        messages: u64,
        comes: impl Fn() -> Option<Node>,
    ) -> Result<Replayed, ReplayError> {
        let mut came = None;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && came.is_none() {
                came = comes();
            }
        };
        self.scene.play_while(&recording(&["/in"], messages, 100), &ASK, &mut seen)
    }
}

fn nobody() -> Option<Node> {
    None
}

#[test]
fn what_was_recorded_before_the_play_makes_up_for_nothing_that_a_stranger_publishes_in_it() {
    let apart = Apart::new();
    let _near = apart.near(&talker("/near", "1000", &[]));
    let _far = apart.far(&talker("/far", "1000", &[]));
    let missing = missed(apart.play(1000, nobody), "/far");
    assert!((900..3000).contains(&missing), "{missing}");
}

#[test]
fn who_comes_during_the_play_makes_up_for_nothing_that_a_stranger_publishes() {
    let apart = Apart::new();
    let _far = apart.far(&talker("/far", "2000", &[]));
    apart.scene.await_published("/talk", 1);
    let missing =
        missed(apart.play(3000, || Some(apart.near(&talker("/near", "500", &[])))), "/far, /near");
    assert!((1300..6000).contains(&missing), "{missing}");
}

#[test]
fn a_stranger_of_more_than_two_seconds_is_believed_to_have_met_nobody() {
    let apart = Apart { _relay: None, ..Apart::new() };
    let _near = apart.near(&talker("/near", "100000", &["--loses", "60:10"]));
    let _far = apart.far(&talker("/far", "1000", &[]));
    apart.scene.await_published("/talk", 1);
    let played = std::thread::scope(|scope| {
        let late = scope.spawn(|| {
            std::thread::sleep(Duration::from_secs(4));
            apart.near(&RELAY)
        });
        let played = apart.play(3000, nobody);
        drop(late.join().unwrap());
        played
    });
    let missing = missed(played, "/far");
    assert!(missing > 2900, "{missing}");
}

#[test]
fn who_comes_during_the_play_and_never_meets_the_recorder_is_missed() {
    let apart = Apart::new();
    let missing =
        missed(apart.play(4000, || Some(apart.far(&talker("/far", "1000", &[])))), "/far");
    assert!(missing > 1900, "{missing}");
}

#[test]
fn a_stranger_that_publishes_nothing_hides_no_loss_of_another() {
    let apart = Apart::new();
    let _far = apart.far(&["--name", "/far", "--pub", TALK]);
    let _near = apart.near(&talker("/near", "1000", &["--loses", "4000:500"]));
    let Err(error) = apart.play(4000, nobody) else { panic!("passed") };
    let text = error.to_string();
    // One that is published just then may stand for one of them.
    let some = |lost: u64| text.contains(&format!("{lost} messages of /talk did not reach"));
    assert!(some(500) || some(499), "{text}");
}

#[test]
fn beside_a_stranger_that_publishes_nothing_whoever_is_recorded_whole_lacks_nothing() {
    let apart = Apart::new();
    let _far = apart.far(&["--name", "/far", "--pub", TALK]);
    let _near = apart.near(&talker("/near", "1000", &[]));
    assert!(recorded(&apart.play(2000, nobody).unwrap()).len() >= 2000);
}

#[test]
fn who_publishes_and_does_not_count_makes_up_for_nothing_that_a_stranger_publishes() {
    // Of the stranger's name, or of one of its own.
    for near in ["/far", "/near"] {
        let apart = Apart::new();
        let _far = apart.far(&talker("/far", "2000", &[]));
        let _near = apart.scene.start_uncounted("standin_node", &talker(near, "1000", &[]));
        await_topic(&apart.scene, "/talk", 1);
        apart.scene.await_published("/talk", 1);
        let missing = missed(apart.play(3000, nobody), "/far");
        assert!((1300..3500).contains(&missing), "{missing}");
    }
}

#[test]
fn beside_who_does_not_count_and_does_not_match_whoever_is_recorded_whole_lacks_nothing() {
    for others in [&["--name", "/plain"][..], &["--name", "/late", "--sub", KEPT]] {
        beside_who_does_not_match(others);
    }
}

/// And beside another node, which may subscribe to what no publisher offers.
fn beside_who_does_not_match(others: &[&str]) {
    let apart = Apart::new();
    let _others = apart.near(others);
    let _near = apart.near(&talker("/near", "1000", &[]));
    let best_effort = "/talk:std_msgs/msg/String:10:best_effort";
    let words = ["--name", "/near", "--pub", best_effort, "--every-us", "1000"];
    let _namesake = apart.scene.start_uncounted("standin_node", &words);
    await_topic(&apart.scene, "/talk", 2);
    let replayed = apart.play(2000, nobody).unwrap();
    assert!(recorded(&replayed).len() >= 2000);
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("publish /talk (at least 1)"), "{warnings}");
}

/// A node of the recorder's domain that loses 500 messages, beside one that does not count and publishes more than that.
#[test]
fn who_publishes_and_does_not_count_makes_up_for_nothing_that_another_loses() {
    let apart = Apart::new();
    let _near = apart.near(&talker("/near", "1000", &["--loses", "2000:500"]));
    let words = talker("/other", "1000", &[]);
    let _other = apart.scene.start_uncounted("standin_node", &words);
    await_topic(&apart.scene, "/talk", 2);
    let Err(error) = apart.play(4000, nobody) else { panic!("passed") };
    assert_eq!(error.reason(), "RecordingIncomplete");
    let text = error.to_string();
    let some = |lost: u64| text.contains(&format!("{lost} messages of /talk did not reach"));
    assert!(some(500) || some(499), "{text}");
    assert!(text.contains("of /near it has"), "{text}");
}

#[test]
fn beside_who_does_not_count_whoever_is_recorded_whole_lacks_nothing() {
    let apart = Apart::new();
    let _near = apart.near(&talker("/near", "1000", &[]));
    let _other = apart.scene.start_uncounted("standin_node", &talker("/other", "700", &[]));
    await_topic(&apart.scene, "/talk", 2);
    assert!(recorded(&apart.play(2000, nobody).unwrap()).len() >= 4000);
}
