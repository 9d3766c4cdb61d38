//! The ledger, of connections and words that are given.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use bagpipe_graph::{LinkState, Publication};

use super::scripted::{Scripted, Words, left, link};
use crate::ledger::{ledger, present};
use crate::outcome::{Ledger, LedgerSubscriber, LedgerTopic, Strength};
use crate::play::Played;
use crate::prove::Proof;

/// A topic's connections, and how many messages of the lead-in and of the window were played.
type Topic<'a> = (&'a str, &'a [LinkState], (u64, u64));

/// The ledger of topics whose nodes have been asked once; all that is connected was in time.
fn of(topics: &[Topic<'_>], words: &Words) -> Ledger {
    let played: Vec<Played> =
        topics.iter().map(|(_, _, (lead_in, counted))| played(*lead_in, *counted)).collect();
    let topics: Vec<Arc<dyn Publication>> = topics
        .iter()
        .map(|(topic, links, _)| Scripted::new(topic, links) as Arc<dyn Publication>)
        .collect();
    let mut proof = Proof::new(words.audit());
    proof.ask(&topics);
    ledger(&topics, &played, &present(&topics), &proof)
}

fn played(lead_in: u64, counted: u64) -> Played {
    Played { lead_in, counted }
}

/// A line: who received and lost how much, of how many bytes, as sure as that.
fn line(
    node: &str,
    (received, dropped): (u64, u64),
    bytes: u64,
    strength: Strength,
) -> LedgerSubscriber {
    let node = node.to_owned();
    LedgerSubscriber { node, received, dropped, bytes, strength, ..LedgerSubscriber::default() }
}

// Promise: ledger-says-no-more
#[test]
fn each_topic_has_its_lines_and_the_sums_are_of_the_worst_and_of_all() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 103, Some(4));
    words.say("/two", ("/a", 2), 98, None);
    words.say("/one", ("/b", 3), 7, Some(0));
    let found = of(
        &[
            ("/a", &[link(1, "/one", (3, 100)), link(2, "/two", (3, 100))], (3, 100)),
            ("/b", &[link(3, "/one", (0, 7)), link(4, "/silent", (0, 7))], (2, 7)),
            ("/c", &[], (5, 60)),
        ],
        &words,
    );
    let topic = |topic: &str, (lead_in, sent), subscribers| LedgerTopic {
        topic: topic.to_owned(),
        datatype: format!("{}_msgs/String", &topic[1..]),
        sent,
        lead_in,
        subscribers,
    };
    let expected = Ledger {
        sent: 107,
        lead_in: 5,
        // The worst of /a has 95, the worst of /b nothing that is known; of /c nobody was there.
        received: 95,
        dropped: 4 + 5 + 7,
        strength: Some(Strength::Sent),
        topics: vec![
            topic(
                "/a",
                (3, 100),
                vec![
                    line("/one", (96, 4), 1_000, Strength::Received),
                    line("/two", (95, 5), 1_000, Strength::Taken),
                ],
            ),
            topic(
                "/b",
                (2, 7),
                vec![
                    line("/one", (7, 0), 70, Strength::Received),
                    line("/silent", (0, 7), 70, Strength::Sent),
                ],
            ),
            topic("/c", (0, 0), Vec::new()),
        ],
    };
    assert_eq!(found, expected);
}

#[test]
fn a_node_that_came_back_has_one_line_as_weak_as_its_weakest_connection() {
    let words = Words { outlives: true, ..Words::default() };
    words.say("/one", ("/a", 1), 40, None);
    words.say("/one", ("/a", 2), 55, Some(0));
    let links = [left(link(1, "/one", (0, 40))), link(2, "/one", (0, 60))];
    let found = of(&[("/a", &links, (0, 100))], &words);
    assert_eq!(found.topics[0].subscribers, [line("/one", (95, 5), 1_000, Strength::Received)]);
    assert_eq!(found.strength, Some(Strength::Received));
    // What it was sent twice it did not receive twice.
    words.say("/one", ("/a", 2), 90, Some(0));
    let links = [left(link(1, "/one", (0, 40))), link(2, "/one", (0, 90))];
    let found = of(&[("/a", &links, (0, 100))], &words);
    assert_eq!(found.topics[0].subscribers, [line("/one", (100, 0), 1_300, Strength::Received)]);
}

#[test]
fn nodes_that_share_a_name_make_up_for_nothing_that_the_other_lost() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 100, Some(0));
    words.say("/one", ("/a", 2), 60, Some(0));
    let links = [link(1, "/one", (0, 100)), LinkState { instance: 1, ..link(2, "/one", (0, 100)) }];
    let found = of(&[("/a", &links, (0, 100))], &words);
    let lines = [(100, 0), (60, 40)].map(|it| line("/one", it, 1_000, Strength::Received));
    assert_eq!((found.received, found.dropped), (60, 40));
    assert_eq!(found.topics[0].subscribers, lines);
}

#[test]
fn who_came_after_the_last_message_is_no_subscriber_of_the_case() {
    let links = [link(1, "/one", (0, 100)), link(2, "/late", (0, 0))];
    let topic: Arc<dyn Publication> = Scripted::new("/a", &links);
    let other: Arc<dyn Publication> = Scripted::new("/b", &[link(2, "/two", (0, 0))]);
    let topics = [topic, other];
    assert_eq!(present(&topics), [BTreeSet::from([1, 2]), BTreeSet::from([2])]);
    let proof = Proof::new(Words::default().audit());
    let present = [BTreeSet::from([1]), BTreeSet::new()];
    let found = ledger(&topics, &[played(1, 100), played(1, 50)], &present, &proof);
    assert_eq!(found.topics[0].subscribers, [line("/one", (0, 100), 1_000, Strength::Sent)]);
    assert_eq!((found.topics[1].sent, found.topics[1].lead_in), (0, 0));
    assert_eq!((found.sent, found.lead_in, found.dropped), (100, 1, 100));
}

#[test]
fn who_has_called_back_for_all_has_nothing_left_to_call_back_for() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 9, Some(0));
    words.say("/two", ("/a", 2), 9, Some(0));
    let topic: Arc<dyn Publication> =
        Scripted::new("/a", &[link(1, "/one", (0, 9)), link(2, "/two", (0, 9))]);
    let mut proof = Proof::new(words.audit());
    let topics = [topic];
    proof.ask(&topics);
    proof.answered(0, &link(1, "/one", (0, 9)));
    let mut found = ledger(&topics, &[played(0, 9)], &present(&topics), &proof);
    let of = |found: &Ledger| {
        let lines = found.topics[0].subscribers.iter();
        lines.map(|line| (line.strength, line.queue, line.waited_seconds)).collect::<Vec<_>>()
    };
    assert_eq!(of(&found), [(Strength::Called, Some(0), None), (Strength::Received, None, None)]);
    assert_eq!(found.strength, Some(Strength::Received));
    found.add_waits(&BTreeMap::from([("/two".to_owned(), 0.25)]));
    let expected = [(Strength::Called, Some(0), None), (Strength::Received, None, Some(0.25))];
    assert_eq!(of(&found), expected);
}

#[test]
fn without_a_subscriber_nothing_is_proved() {
    let found = of(&[("/a", &[], (0, 5))], &Words::default());
    assert_eq!((found.strength, found.sent, found.received, found.dropped), (None, 0, 0, 0));
}

#[test]
fn who_was_waited_for_the_longest_set_the_pace_if_for_a_tenth_of_the_play() {
    let held = |id, node, seconds, room| LinkState {
        held_up: Duration::from_secs_f64(seconds),
        room,
        ..link(id, node, (0, 100))
    };
    let words = Words::default();
    words.say("/one", ("/a", 1), 100, Some(0));
    words.say("/two", ("/b", 2), 90, Some(0));
    let pace = |seconds: (f64, f64)| {
        let links = [
            ("/a", &[held(1, "/one", seconds.0, None)][..], (0, 100)),
            ("/b", &[held(2, "/two", seconds.1, Some(10))], (0, 100)),
        ];
        of(&links, &words).pace(4.0)
    };
    let one = "/one set the pace: the play waited 3.000 of 4.000 s until it had taken more of /a, and \
               it took 25.0 a second";
    let two = "/two set the pace: the play waited 2.500 of 4.000 s until it had taken more of /b, of \
               which at most 10 may wait at it, and it took 22.5 a second";
    assert_eq!(pace((3.0, 2.5)).as_deref(), Some(one));
    assert_eq!(pace((2.0, 2.5)).as_deref(), Some(two));
    assert!(pace((0.4, 0.3)).is_some());
    assert_eq!(pace((0.399, 0.3)), None);
    assert_eq!(of(&[("/a", &[link(1, "/one", (0, 0))], (0, 0))], &words).pace(0.0), None);
}

#[test]
fn a_node_that_came_back_was_waited_for_in_both_of_its_stays() {
    let held = |id, ms, room| LinkState {
        held_up: Duration::from_millis(ms),
        room,
        ..link(id, "/one", (0, 50))
    };
    let links = [left(held(1, 250, Some(10))), held(2, 500, Some(7))];
    let found = of(&[("/a", &links, (0, 100))], &Words::default());
    let line = &found.topics[0].subscribers[0];
    assert_eq!((line.held_up_seconds, line.room), (0.75, Some(7)));
}
