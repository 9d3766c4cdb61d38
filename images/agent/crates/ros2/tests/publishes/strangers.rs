//! Publishers that the recorder never meets, as nodes of another domain: what they publish is missed, whoever else
//! publishes the topic, and whenever they came; and nobody's own messages are, beside one that publishes nothing.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bagpipe_replay::{Mode, Progress, ReplayError, Replayed, Stage};
use bagpipe_ros2ledger::Kind;

use crate::other_types::await_topic;
use crate::scene::{Ask, DEFAULT, RELAY, Scene, recorded, recording};
use crate::standin::{Graph, Node, eventually};
use crate::{STANDING, counts, has_met, losing_midway, losing_midway_from_rest};

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
    /// What /far and /near had published whenever the play reported where it was.
    seen: Mutex<Vec<(Stage, [u64; 2])>>,
}

const FAR: usize = 0;
const NEAR: usize = 1;

impl Apart {
    fn new() -> Apart {
        let scene = Scene::new();
        let relay = scene.start("standin_node", &RELAY);
        Apart { scene, elsewhere: Graph::new(), _relay: Some(relay), seen: Mutex::default() }
    }

    /// What both have published by now.
    fn published(&self) -> [u64; 2] {
        ["/far", "/near"].map(|node| counts(&self.scene, Kind::Publisher, node, "/talk").published)
    }

    fn seen(&self) -> MutexGuard<'_, Vec<(Stage, [u64; 2])>> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What one has published since the play began, by the last report of it.
    fn since_the_begin(&self, one: usize) -> u64 {
        let seen = self.seen();
        let begin = seen.iter().find(|report| report.0 == Stage::Play).unwrap();
        seen.last().unwrap().1[one] - begin.1[one]
    }

    /// The same from its second report to its end: all of that is recorded, if it arrives.
    fn midway(&self, one: usize) -> u64 {
        let seen = self.seen();
        let begin = seen.iter().filter(|report| report.0 == Stage::Play).nth(1).unwrap();
        let end = seen.iter().find(|report| report.0 == Stage::Drain).unwrap();
        end.1[one] - begin.1[one]
    }

    /// A node that counts here, and is in another domain.
    fn far(&self, arguments: &[&str]) -> Node {
        self.elsewhere.start_counting("standin_node", arguments, &self.scene.ledger)
    }

    fn near(&self, arguments: &[&str]) -> Node {
        self.scene.start("standin_node", arguments)
    }

    /// Plays so many messages, 1 ms apart.
    fn play(&self, messages: u64) -> Result<Replayed, ReplayError> {
        self.play_while(messages, &mut |_| {})
    }

    /// The same, and this one comes when the play has begun.
    fn play_when(
        &self,
        messages: u64,
        one: usize,
        comes: impl Fn() -> Node,
    ) -> Result<Replayed, ReplayError> {
        let mut came = None;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && came.is_none() {
                came = Some(comes());
                // A slow start would leave it less of the play than it takes to be missed.
                eventually(|| self.published()[one] > 0);
            }
        };
        self.play_while(messages, &mut seen)
    }

    /// That no less was missed than a stranger published, but for what may be anybody's, and no more than so many.
    fn assert_missing(&self, missing: u64, most: u64) {
        let least = self.since_the_begin(FAR) * 3 / 4;
        assert!(least > 0 && (least..=most).contains(&missing), "{least} {missing} {most}");
    }

    /// The same, and /near loses some midway.
    fn play_losing(&self, messages: u64, near: &Node) -> Result<Replayed, ReplayError> {
        let mut seen = losing_midway_from_rest(&self.scene, near, "/near");
        self.play_as(&Ask { stable: STANDING, ..ASK }, messages, &mut seen)
    }

    fn play_while(
        &self,
        messages: u64,
        seen: &mut dyn FnMut(Progress),
    ) -> Result<Replayed, ReplayError> {
        self.play_as(&ASK, messages, seen)
    }

    fn play_as(
        &self,
        ask: &Ask<'_>,
        messages: u64,
        seen: &mut dyn FnMut(Progress),
    ) -> Result<Replayed, ReplayError> {
        let mut noted = |progress: Progress| {
            self.seen().push((progress.stage, self.published()));
            seen(progress);
        };
        self.scene.play_while(&recording(&["/in"], messages, 100), ask, &mut noted)
    }
}

#[test]
fn what_was_recorded_before_the_play_makes_up_for_nothing_that_a_stranger_publishes_in_it() {
    let apart = Apart::new();
    let _near = apart.near(&talker("/near", "1000", &[]));
    let _far = apart.far(&talker("/far", "1000", &[]));
    let missing = missed(apart.play(1000), "/far");
    apart.assert_missing(missing, apart.published()[FAR]);
}

// Promise: recording-is-compared
#[test]
fn who_comes_during_the_play_makes_up_for_nothing_that_a_stranger_publishes() {
    let apart = Apart::new();
    let _far = apart.far(&talker("/far", "2000", &[]));
    apart.scene.await_published("/talk", 1);
    let comes = || apart.near(&talker("/near", "500", &[]));
    let missing = missed(apart.play_when(3000, NEAR, comes), "/far, /near");
    apart.assert_missing(missing, apart.published()[FAR] + apart.midway(NEAR));
}

#[test]
fn a_stranger_of_more_than_two_seconds_is_believed_to_have_met_nobody() {
    let apart = Apart { _relay: None, ..Apart::new() };
    let near = apart.near(&talker("/near", "100000", &["--loses", "10"]));
    let _far = apart.far(&talker("/far", "1000", &[]));
    eventually(|| apart.published().iter().all(|published| *published > 0));
    let (mut relay, mut reports, mut loses) = (None, 0, losing_midway(&near));
    let played = apart.play_while(3000, &mut |progress| {
        // There is a recorder, and more than two seconds later the play may begin: reports are 0.5 s apart.
        let is_there = || reports > 0 || has_met(&apart.scene, "/near");
        if progress.stage == Stage::Subscribe && is_there() {
            reports += 1;
            if reports == 6 {
                relay = Some(apart.near(&RELAY));
            }
        }
        loses(progress);
    });
    assert!(relay.is_some());
    let missing = missed(played, "/far");
    apart.assert_missing(missing, apart.published()[FAR]);
}

#[test]
fn who_comes_during_the_play_and_never_meets_the_recorder_is_missed() {
    let apart = Apart::new();
    let comes = || apart.far(&talker("/far", "1000", &[]));
    let missing = missed(apart.play_when(4000, FAR, comes), "/far");
    apart.assert_missing(missing, apart.published()[FAR]);
}

#[test]
fn a_stranger_that_publishes_nothing_hides_no_loss_of_another() {
    let apart = Apart::new();
    let _far = apart.far(&["--name", "/far", "--pub", TALK]);
    let near = apart.near(&talker("/near", "1000", &["--loses", "500"]));
    apart.scene.await_published("/talk", 1);
    let played = apart.play_losing(4000, &near);
    let Err(error) = played else { panic!("passed") };
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
    let recorded = recorded(&apart.play(2000).unwrap()).len() as u64;
    assert!(recorded >= apart.midway(NEAR), "{recorded}");
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
        let missing = missed(apart.play(3000), "/far");
        apart.assert_missing(missing, apart.published()[FAR]);
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
    let replayed = apart.play(2000).unwrap();
    let recorded = recorded(&replayed).len() as u64;
    assert!(recorded >= apart.midway(NEAR), "{recorded}");
    let warnings = replayed.playback.warnings.join("; ");
    assert!(warnings.contains("publish /talk (at least 1)"), "{warnings}");
}

/// A node of the recorder's domain that loses 500 messages, beside one that does not count and publishes more than that.
#[test]
fn who_publishes_and_does_not_count_makes_up_for_nothing_that_another_loses() {
    let apart = Apart::new();
    let near = apart.near(&talker("/near", "1000", &["--loses", "500"]));
    let words = talker("/other", "1000", &[]);
    let _other = apart.scene.start_uncounted("standin_node", &words);
    await_topic(&apart.scene, "/talk", 2);
    let played = apart.play_losing(4000, &near);
    let Err(error) = played else { panic!("passed") };
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
    let recorded = recorded(&apart.play(2000).unwrap()).len() as u64;
    // The other one's are as many and more.
    assert!(recorded >= 2 * apart.midway(NEAR), "{recorded}");
}
