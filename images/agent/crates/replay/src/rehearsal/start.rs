//! Before the first input: how long is waited for whom.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use bagpipe_graph::{Publication, TopicInfo};

use super::master::LonelyMaster;
use super::scripted::{Scripted, link};
use super::{ByHand, Rehearsal, ReplayRequest, StartWhen, graph_of, ms, request, window};
use crate::discovery::Discovery;
use crate::plan::Plan;
use crate::play::Player;
use crate::subscribe::{Waiting, wait_for_stack};
use crate::{ReplayError, Stage};

/// Waits for a stack to which these topics are to be played, as the request is altered; how that
/// ended, and after how long. Without a master, where no topic needs one, nobody answers.
fn wait(
    topics: &[&str],
    master: Option<&LonelyMaster>,
    alter: impl FnOnce(&mut ReplayRequest, &ByHand),
) -> (Result<(), ReplayError>, Duration) {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 1));
    if let Some(master) = master {
        request.middleware = graph_of(&master.uri);
    }
    alter(&mut request, &by_hand);
    let rehearsal = Rehearsal::new(&by_hand, request);
    let (node, clock, request) = (rehearsal.node(), &rehearsal.clock, &rehearsal.request);
    let info = |topic: &&str| TopicInfo { topic: (*topic).to_owned(), ..TopicInfo::default() };
    let plan = Plan::of_topics(topics.iter().map(info).collect());
    let ended = rehearsal.watched(|watch| {
        watch.enter(Stage::Subscribe);
        let mut discovery = Discovery::start(&*node, &[], watch.time())?;
        let lockstep = rehearsal.lockstep(&plan)?;
        discovery.listen_for(&lockstep, &rehearsal.recorder)?;
        let mut player = Player::advertise(&*node, &plan, clock, request, None)?;
        wait_for_stack(&discovery, &mut player, request, watch)
    });
    (ended, by_hand.passed())
}

#[test]
fn who_never_subscribes_is_waited_for_until_the_deadline() {
    let master = LonelyMaster::start();
    for milliseconds in [700, 1_250] {
        for named in [true, false] {
            let (ended, after) = wait(&["/a", "/b"], Some(&master), |request, _| {
                request.subscribe_deadline = ms(milliseconds);
                if !named {
                    request.topics.clear();
                }
            });
            assert_eq!(after, ms(milliseconds));
            let sentence = format!(
                "nobody subscribed to /a, /b within {:.1} s; the stack's nodes subscribe to \
                 nothing at all",
                milliseconds as f64 / 1e3
            );
            assert_eq!(ended.unwrap_err().to_string(), sentence);
        }
    }
}

#[test]
fn who_is_wanted_and_absent_is_waited_for_until_the_deadline() {
    let (ended, after) = wait(&[], None, |request, _| {
        request.subscribe_deadline = ms(700);
        request.start.nodes = vec!["late".to_owned()];
    });
    let sentence = ended.unwrap_err().to_string();
    assert_eq!((sentence.as_str(), after), ("waited in vain for /late for 0.7 s", ms(700)));
    let (ended, after) = wait(&[], None, |request, _| {
        request.subscribe_deadline = ms(700);
        request.start.subscribers = BTreeMap::from([("/a".to_owned(), 2)]);
    });
    let expected = "waited in vain for 2 subscribers of /a (there are 0) for 0.7 s";
    assert_eq!((ended.unwrap_err().to_string().as_str(), after), (expected, ms(700)));
}

#[test]
fn a_master_that_is_silent_for_5_s_is_gone() {
    let (ended, after) = wait(&[], None, |request, _| {
        request.start.nodes = vec!["/late".to_owned()];
    });
    assert_eq!(ended.unwrap_err().reason(), "RosMasterFailed");
    // Since the first look, at once.
    assert_eq!(after, ms(5_000));
}

#[test]
fn the_case_s_deadline_holds_while_subscribers_are_awaited() {
    let (ended, after) = wait(&[], None, |request, by_hand| {
        request.start.nodes = vec!["/late".to_owned()];
        request.case_deadline = by_hand.moment(ms(300));
    });
    let sentence = "the case's deadline passed while its subscriptions were awaited";
    assert_eq!((ended.unwrap_err().to_string().as_str(), after), (sentence, ms(300)));
}

#[test]
fn once_all_are_there_the_play_begins_after_its_delay() {
    let master = LonelyMaster::start();
    for delay in [0, 700, 705] {
        let (ended, after) = wait(&[], Some(&master), |request, _| request.start.delay = ms(delay));
        ended.unwrap();
        assert_eq!(after, ms(delay));
        // Nobody says which connections there should be: they are waited for as long as can be.
        let (ended, after) = wait(&[], None, |request, _| request.start.delay = ms(delay));
        ended.unwrap();
        assert_eq!(after, ms(2_000 + delay));
    }
}

/// When a wait for any subscribers is over whose only one was first seen after 100 ms, looked at every
/// 10 ms from its beginning on, of which at the last look nobody was to come from `complete` on.
fn over(complete: Duration) -> Duration {
    let begun = Instant::now();
    let topic = Scripted::new("/in", &[]);
    let topics: [Arc<dyn Publication>; 1] = [topic.clone()];
    let mut waiting = Waiting::new(vec![0], Some(StartWhen::default().stable), begun);
    let mut passed = Duration::ZERO;
    loop {
        if passed == ms(100) {
            topic.links_are(&[link(1, "/node", (0, 0))]);
        }
        waiting.complete = passed >= complete;
        if waiting.is_over(&topics, begun + passed, begun + ms(10_000)) {
            return passed;
        }
        passed += ms(10);
    }
}

// Promise: nothing-before-everybody
#[test]
fn with_no_topics_named_it_is_over_once_nobody_is_to_come_or_none_came_for_half_a_second() {
    assert_eq!(over(ms(20_000)), ms(600));
    assert_eq!(over(ms(340)), ms(340));
    // Somebody has to be there.
    assert_eq!(over(ms(0)), ms(100));
}
