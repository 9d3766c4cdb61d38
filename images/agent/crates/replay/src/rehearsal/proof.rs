//! What is asked of the nodes, what is believed of it, and where they are seen.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use bagpipe_graph::{FarEnd, LinkState, Publication, Received};

use super::scripted::{Scripted, Words, left, link};
use super::{ByHand, ms};
use crate::outcome::Strength;
use crate::patience::{Patience, Settled};
use crate::prove::{Known, Place, Proof};

/// The other end of a connection: how much is unread, and whether all callbacks have ended.
fn end(id: u64, unread: u64, called_back: Option<bool>) -> FarEnd {
    FarEnd { id, unread, called_back, inode: None }
}

/// A proof of one topic with these connections.
fn proof_of(
    words: &Words,
    links: &[LinkState],
) -> (Proof, Arc<Scripted>, [Arc<dyn Publication>; 1]) {
    let topic = Scripted::new("/a", links);
    let topics = [Arc::clone(&topic) as Arc<dyn Publication>];
    (Proof::new(words.audit()), topic, topics)
}

fn received(messages: u64, drops: Option<u64>) -> Option<Received> {
    Some(Received { messages, drops })
}

#[test]
fn each_node_is_asked_once_for_all_its_open_connections() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 4, Some(1));
    // Of a connection that nobody asked for, and of one on another topic.
    words.say("/one", ("/a", 77), 9, None);
    words.say("/one", ("/b", 3), 5, None);
    let topics: [Arc<dyn Publication>; 2] = [
        Scripted::new("/a", &[link(1, "/one", (0, 4)), left(link(2, "/one", (0, 2)))]),
        Scripted::new("/b", &[link(3, "/one", (0, 5)), link(4, "/two", (0, 5))]),
    ];
    let mut proof = Proof::new(words.audit());
    proof.ask(&topics);
    let on = |topic: &str, links: &[u64]| (topic.to_owned(), links.to_vec());
    let expected = [
        ("/one".to_owned(), BTreeMap::from([on("/a", &[1]), on("/b", &[3])])),
        ("/two".to_owned(), BTreeMap::from([on("/b", &[4])])),
    ];
    assert_eq!(*words.asked.lock().unwrap(), expected);
    assert_eq!(proof.known(0, 1).now, received(4, Some(1)));
    assert_eq!(proof.known(1, 3).now, received(5, None));
    for (topic, link) in [(0, 2), (0, 77), (1, 4), (1, 77)] {
        assert_eq!(proof.known(topic, link), Known::default(), "{topic} {link}");
    }
}

#[test]
fn a_node_that_no_longer_answers_keeps_what_it_reported() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 4, None);
    let (mut proof, _, topics) = proof_of(&words, &[link(1, "/one", (0, 9))]);
    proof.ask(&topics);
    words.is_silent("/one");
    proof.ask(&topics);
    assert_eq!(proof.known(0, 1).now, received(4, None));
}

#[test]
fn of_who_is_gone_figures_may_outlive_it_and_its_place_does_not() {
    for outlives in [false, true] {
        let words = Words { outlives, ..Words::default() };
        words.say("/one", ("/a", 1), 3, None);
        let (mut proof, topic, topics) = proof_of(&words, &[link(1, "/one", (0, 9))]);
        topic.ends_are(&[end(1, 0, Some(true))]);
        proof.ask(&topics);
        let known = proof.known(0, 1);
        assert_eq!((known.now, known.place), (received(3, None), Place::Back));
        topic.links_are(&[left(link(1, "/one", (0, 9)))]);
        words.say("/one", ("/a", 1), 5, None);
        proof.ask(&topics);
        let known = proof.known(0, 1);
        let expected = if outlives { (5, Place::Unknown) } else { (3, Place::Back) };
        assert_eq!((known.now, known.place), (received(expected.0, None), expected.1));
    }
}

// Promise: ledger-says-no-more
#[test]
fn where_somebody_was_says_nothing_of_what_was_sent_to_it_since() {
    for (lead_in, counted, place) in
        [(2, 9, Place::Back), (3, 9, Place::Unknown), (2, 10, Place::Unknown)]
    {
        let topic = Scripted::new("/a", &[link(1, "/one", (2, 9))]);
        topic.ends_are(&[end(1, 0, Some(true))]);
        let sent_meanwhile = Arc::clone(&topic);
        let words = Words {
            meanwhile: Some(Arc::new(move || {
                sent_meanwhile.links_are(&[link(1, "/one", (lead_in, counted))]);
            })),
            ..Words::default()
        };
        words.say("/one", ("/a", 1), 11, None);
        let topics = [topic as Arc<dyn Publication>];
        let mut proof = Proof::new(words.audit());
        proof.ask(&topics);
        assert_eq!(proof.known(0, 1).place, place);
    }
}

// Promise: ledger-says-no-more
#[test]
fn who_was_back_with_all_that_was_sent_has_called_it_whatever_it_does_later() {
    for (counted, back_at, sent_later, expected) in [
        (9, [2, 3], 0, Strength::Called),
        // It was back before it had counted all, or something was sent to it since.
        (9, [0, 1], 0, Strength::Taken),
        (8, [2, 3], 0, Strength::Taken),
        (9, [2, 3], 1, Strength::Taken),
    ] {
        let words = Words { outlives: true, ..Words::default() };
        let (mut proof, topic, topics) = proof_of(&words, &[link(1, "/one", (0, 9))]);
        let mut connection = link(1, "/one", (0, 9));
        for round in 0..5 {
            words.say("/one", ("/a", 1), if round == 0 { 7 } else { counted }, None);
            topic.ends_are(&[end(1, 0, Some(back_at.contains(&round)))]);
            if round == 4 {
                connection.counted += sent_later;
                topic.links_are(std::slice::from_ref(&connection));
            }
            proof.ask(&topics);
        }
        assert_eq!(proof.known(0, 1).strength(&connection), expected, "{counted} {back_at:?}");
    }
}

#[test]
fn a_node_is_where_its_connection_shows_it() {
    for (end, place, busy) in [
        (Some(end(1, 7, Some(true))), Place::Unread, true),
        (Some(end(1, 1, None)), Place::Unread, true),
        (Some(end(1, 0, Some(true))), Place::Back, false),
        (Some(end(1, 0, Some(false))), Place::Away, true),
        // Neither its process nor its socket is known, or the end is another connection's.
        (Some(end(1, 0, None)), Place::Unknown, false),
        (Some(end(2, 7, Some(true))), Place::Unknown, false),
        (None, Place::Unknown, false),
    ] {
        let words = Words::default();
        words.say("/one", ("/a", 1), 3, None);
        let (mut proof, topic, topics) = proof_of(&words, &[link(1, "/one", (2, 9))]);
        topic.ends_are(&end.into_iter().collect::<Vec<_>>());
        assert_eq!(proof.see(&topics), BTreeMap::from([((0, 1), 11)]));
        assert_eq!((proof.known(0, 1).place, proof.known(0, 1).now), (place, None), "{end:?}");
        proof.ask(&topics);
        assert_eq!((proof.known(0, 1).place, proof.busy(&topics)), (place, busy), "{end:?}");
        // Who is gone is not looked at.
        topic.links_are(&[left(link(1, "/one", (2, 9)))]);
        topic.ends_are(&[FarEnd { id: 1, unread: 1, called_back: None, inode: None }]);
        assert_eq!(proof.see(&topics), BTreeMap::new());
        assert_eq!((proof.known(0, 1).place, proof.busy(&topics)), (place, false));
    }
}

#[test]
fn a_process_that_has_no_such_socket_is_nowhere_and_one_that_waits_elsewhere_is_away() {
    let (near, _far) = std::os::unix::net::UnixDatagram::pair().unwrap();
    let name = format!("/proc/self/fd/{}", std::os::fd::AsRawFd::as_raw_fd(&near));
    let socket = std::fs::read_link(name).unwrap();
    let socket = socket.to_str().unwrap().trim_start_matches("socket:[").trim_end_matches(']');
    let inode: u32 = socket.parse().unwrap();
    let pid = i32::try_from(std::process::id()).unwrap();
    let words = Words { pids: BTreeMap::from([("/one".to_owned(), pid)]), ..Words::default() };
    let (mut proof, topic, topics) = proof_of(&words, &[link(1, "/one", (0, 1))]);
    for (met, inode, place) in [
        (false, Some(inode), Place::Unknown),
        (true, Some(inode), Place::Away),
        (true, Some(u32::MAX), Place::Unknown),
        (true, None, Place::Unknown),
    ] {
        if met {
            let known = proof.meet(&BTreeSet::from(["/one".to_owned(), "/two".to_owned()]));
            assert_eq!(known, BTreeMap::from([("/one".to_owned(), pid)]));
        }
        topic.ends_are(&[FarEnd { id: 1, unread: 0, called_back: None, inode }]);
        proof.see(&topics);
        assert_eq!(proof.known(0, 1).place, place, "{met} {inode:?}");
    }
}

/// Settles with what is known at each round; how it ended, when, and after how many questions.
fn settled(words: &Words, links: &[LinkState]) -> (Settled, u64, usize) {
    let by_hand = ByHand::new();
    let (mut proof, _, topics) = proof_of(words, links);
    let (deadline, busy) = (by_hand.moment(ms(1_000)), by_hand.moment(ms(3_000)));
    let patience = Patience { deadline, busy, stable: ms(500) };
    let pause = || {
        by_hand.sleep(ms(10));
        Ok::<bool, ()>(false)
    };
    let end = proof.settle(&topics, &patience, &by_hand.time(), pause).unwrap();
    let passed = u64::try_from(by_hand.passed().as_millis()).unwrap();
    (end, passed, words.asked.lock().unwrap().len())
}

#[test]
fn all_is_settled_once_every_open_connection_has_counted_what_was_sent() {
    let words = Words::default();
    words.say("/one", ("/a", 1), 11, Some(5));
    let open = link(1, "/one", (2, 9));
    assert_eq!(settled(&words, std::slice::from_ref(&open)), (Settled::Complete, 10, 2));
    words.asked.lock().unwrap().clear();
    // Who is gone is not waited for, and who says nothing is.
    let gone = left(link(2, "/two", (2, 9)));
    assert_eq!(settled(&words, &[open.clone(), gone]), (Settled::Complete, 10, 2));
    words.asked.lock().unwrap().clear();
    let silent = link(2, "/two", (2, 9));
    assert_eq!(settled(&words, &[open, silent]).0, Settled::Stable);
    words.say("/one", ("/a", 1), 10, Some(5));
    assert_eq!(settled(&words, &[link(1, "/one", (2, 9))]).0, Settled::Stable);
}

#[test]
fn of_the_lead_in_only_what_can_t_change_any_more_is_remembered() {
    for (messages, counted, kept) in [(3, 0, true), (2, 0, false), (3, 1, false), (4, 1, true)] {
        let words = Words::default();
        words.say("/one", ("/a", 1), messages, Some(1));
        let (mut proof, _, topics) = proof_of(&words, &[link(1, "/one", (3, counted))]);
        proof.end_lead_in(&topics);
        assert_eq!(proof.known(0, 1).lead_in, None);
        proof.ask(&topics);
        proof.end_lead_in(&topics);
        let expected = if kept { received(messages, Some(1)) } else { None };
        assert_eq!(proof.known(0, 1).lead_in, expected, "{messages} {counted}");
    }
}

#[test]
fn what_was_answered_in_lock_step_is_known_of_that_connection_alone() {
    let (mut proof, _, _) = proof_of(&Words::default(), &[]);
    proof.answered(3, &link(8, "/one", (0, 9)));
    let answered = |topic, link| proof.known(topic, link).answered;
    assert_eq!((answered(3, 8), answered(3, 7), answered(2, 8)), (true, false, false));
}

#[test]
fn answers_make_up_for_no_message_that_a_counted_node_has_not_taken() {
    for (outlives, taken, reached) in [(true, 7, 4), (true, 12, 9), (false, 7, 9)] {
        let words = Words { outlives, ..Words::default() };
        words.say("/one", ("/a", 1), taken, None);
        let connection = link(1, "/one", (3, 9));
        let (mut proof, _, topics) = proof_of(&words, std::slice::from_ref(&connection));
        proof.ask(&topics);
        proof.answered(0, &connection);
        let known = proof.known(0, 1);
        let expected = if reached == 9 { Strength::Called } else { Strength::Taken };
        let is = (known.reached(&connection), known.strength(&connection));
        assert_eq!(is, (reached, expected), "{taken} {outlives}");
    }
}

#[test]
fn at_the_end_those_are_asked_once_more_whose_figures_are_there_anyway() {
    for (outlives, known) in [(true, 5), (false, 3)] {
        let words = Words { outlives, ..Words::default() };
        words.say("/one", ("/a", 1), 3, None);
        let (mut proof, _, topics) = proof_of(&words, &[link(1, "/one", (0, 9))]);
        proof.ask(&topics);
        words.say("/one", ("/a", 1), 5, None);
        proof.ask_again(&topics);
        assert_eq!(proof.known(0, 1).now, received(known, None));
    }
}
