//! What a lock-step player holds on to besides its answers: simulated time, and what has come.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use bagpipe_graph::{
    Audit, Cancelled, GraphError, HANGS, Node, Outlet, Publication, Seen, SendError, Share,
    TopicInfo,
};

use super::realtime::bag;
use super::scripted::Words;
use super::{AnswerBy, ByHand, Mode, Rehearsal, ms, request, say, step, window};
use crate::lockstep::Lockstep;
use crate::plan::Plan;
use crate::play::Player;
use crate::recorder::Recorder;
use crate::replay::begin_to_count;
use crate::step::Stepper;

/// A node that counts how often it is swept, and for how long at most.
struct Swept {
    subscribed: Vec<String>,
    exact: bool,
    sweeps: Mutex<Vec<Duration>>,
    /// Who is handed a message by each sweep.
    receives: Option<Recorder>,
}

impl Node for Swept {
    fn name(&self) -> &str {
        "/player"
    }

    fn advertise(&self, _: TopicInfo) -> Result<Arc<dyn Publication>, GraphError> {
        unreachable!("nothing is advertised")
    }

    fn subscribe(&self, _: &str) -> Result<(), GraphError> {
        Ok(())
    }

    fn look(&self) -> Result<Seen, GraphError> {
        Ok(Seen::default())
    }

    fn restarted(&self, _: u64) -> String {
        String::new()
    }

    fn subscribed_topics(&self) -> Vec<String> {
        self.subscribed.clone()
    }

    fn publishers_of(&self, _: &str) -> usize {
        0
    }

    fn sweep(&self, limit: Duration) {
        self.sweeps.lock().unwrap().push(limit);
        self.receives.iter().for_each(|recorder| say(recorder, "/answer"));
    }

    fn counts_publishes(&self) -> bool {
        self.exact
    }

    fn audit(&self, _: Duration) -> Box<dyn Audit> {
        Words::default().audit()
    }
}

/// What is done with a topic, in order; it fails at the given call.
#[derive(Default)]
struct Noted {
    calls: Mutex<Vec<String>>,
    fails_at: Option<usize>,
}

impl Noted {
    fn call(&self, what: String) -> Result<(), SendError> {
        let mut calls = self.calls.lock().unwrap();
        calls.push(what);
        if self.fails_at == Some(calls.len()) {
            let (node, topic) = ("/n".to_owned(), "/clock".to_owned());
            return Err(SendError::Stalled { node, topic, waited: ms(5), why: HANGS });
        }
        Ok(())
    }
}

impl Outlet for Noted {
    fn topic(&self) -> &str {
        "/clock"
    }

    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(&self, share: Share, frames: &[&[u8]], _: Cancelled<'_>) -> Result<(), SendError> {
        self.call(format!("send {share:?} {frames:?}"))
    }

    fn await_unread(&self, window: u64, _: Cancelled<'_>) -> Result<(), SendError> {
        self.call(format!("read but {window}"))
    }
}

fn rehearsal() -> Rehearsal {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 9_000));
    request.mode = Mode::Lockstep;
    request.steps = vec![step(AnswerBy::Count, ms(250))];
    Rehearsal::new(&by_hand, request)
}

/// A stepper of /a, which is answered on /answer.
fn stepper<'a>(rehearsal: &'a Rehearsal, node: &'a dyn Node) -> Stepper<'a> {
    let topic = TopicInfo { topic: "/a".to_owned(), ..TopicInfo::default() };
    let plan = Plan::of_topics(vec![topic]);
    let lockstep = rehearsal.lockstep(&plan).unwrap();
    Stepper::new(node, lockstep, Arc::clone(&rehearsal.answers), &rehearsal.recorder)
}

fn node(subscribed: &[&str], exact: bool) -> Swept {
    let subscribed = subscribed.iter().map(|topic| (*topic).to_owned()).collect();
    Swept { subscribed, exact, sweeps: Mutex::default(), receives: None }
}

#[test]
fn what_has_come_is_taken_in_when_time_moves_on_if_anything_may_have() {
    for (subscribed, exact, sweeps) in [
        (&["/answer"][..], false, 0),
        (&["/answer", "/other"], false, 3),
        (&["/answer"], true, 5),
        (&[], false, 0),
        (&[], true, 5),
    ] {
        let (rehearsal, node) = (rehearsal(), node(subscribed, exact));
        let mut stepper = stepper(&rehearsal, &node);
        // The first time is left for nothing, and a time that is the same is not left: but what is published is
        // worked off where it is known.
        [5, 5, 6, 6, 9, 3].into_iter().for_each(|time| stepper.leave(time));
        assert_eq!(*node.sweeps.lock().unwrap(), vec![ms(100); sweeps], "{subscribed:?} {exact}");
    }
}

#[test]
fn what_the_stack_does_at_a_time_is_worked_off_before_its_message_where_a_clock_shows_it() {
    for (use_sim_time, sweeps) in [(false, 3), (true, 6)] {
        let mut rehearsal = rehearsal();
        rehearsal.request.use_sim_time = use_sim_time;
        let bag = bag(&[(0, 5, "a1"), (0, 5, "a2"), (0, 6, "a3")]);
        let plan = Plan::new(&[&bag], &rehearsal.request).unwrap();
        let node = node(&[], true);
        let lockstep = Lockstep::new(&[], &plan.topics, &*rehearsal.request.middleware).unwrap();
        let (answers, recorder) = (Arc::clone(&rehearsal.answers), &rehearsal.recorder);
        let stepper = Some(Stepper::new(&node, lockstep, answers, recorder));
        let outlets = plan.topics.iter().map(|info| rehearsal.log.outlet(&info.topic)).collect();
        let clock = use_sim_time.then(|| rehearsal.log.outlet("/clock"));
        let (clock, outlets) = (&rehearsal.clock, (outlets, clock));
        let mut player = Player::new(&plan, clock, &rehearsal.request, stepper, outlets);
        rehearsal.watched(|watch| {
            let schedule = player.schedule(0, watch.now());
            player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap();
        });
        assert_eq!(node.sweeps.lock().unwrap().len(), sweeps, "{use_sim_time}");
    }
}

#[test]
fn what_comes_late_of_what_was_published_before_the_window_is_not_in_it() {
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 9_000)));
    let node = Swept { receives: Some(rehearsal.recorder.clone()), ..node(&[], true) };
    begin_to_count(&node, &rehearsal.recorder, 0);
    assert_eq!(*node.sweeps.lock().unwrap(), [ms(1_000)]);
    assert_eq!(rehearsal.recorder.messages(), 0);
    say(&rehearsal.recorder, "/answer");
    assert_eq!(rehearsal.recorder.messages(), 1);
}

#[test]
fn what_came_in_a_step_is_recorded_with_its_time() {
    let (rehearsal, node) = (rehearsal(), node(&[], false));
    rehearsal.recorder.count_from(0);
    let mut stepper = stepper(&rehearsal, &node);
    let messages = |time| {
        stepper.leave(time);
        let recorded = rehearsal.recorder.messages();
        say(&rehearsal.recorder, "/answer");
        recorded
    };
    assert_eq!([5, 5, 6, 7].map(messages), [0, 0, 2, 3]);
}

#[test]
fn a_clock_is_sent_again_once_it_was_read_and_read_again() {
    let expected = ["read but 0", "send LeadIn [[7, 8]]", "read but 0"];
    for fails_at in [None, Some(1), Some(2), Some(3)] {
        let (rehearsal, node) = (rehearsal(), node(&[], false));
        let stepper = stepper(&rehearsal, &node);
        let topic = Noted { fails_at, ..Noted::default() };
        let ended = stepper.settle_clock(&topic, &[7, 8], &mut || false);
        assert_eq!(*topic.calls.lock().unwrap(), expected[..fails_at.unwrap_or(3)]);
        let stalled = matches!(ended, Err(SendError::Stalled { .. }));
        assert_eq!(stalled, fails_at.is_some(), "{ended:?}");
    }
}

#[test]
fn a_message_is_complete_when_it_was_answered_and_read() {
    let (rehearsal, node) = (rehearsal(), node(&[], false));
    let mut stepper = stepper(&rehearsal, &node);
    let topic = Noted::default();
    rehearsal.says(ms(40), "/answer");
    rehearsal.watched(|watch| {
        let due = stepper.release(0, &[], watch.now());
        assert_eq!((due.0.len(), due.1), (1, rehearsal.by_hand.moment(ms(0))));
        stepper.complete(due, &topic, watch).unwrap();
    });
    assert_eq!(rehearsal.by_hand.passed(), ms(40));
    assert_eq!(*topic.calls.lock().unwrap(), ["read but 0"]);
    assert_eq!(stepper.answered(), [(0, BTreeSet::from([String::new()]))]);
    let (reports, warnings) = stepper.reports();
    assert_eq!((reports.len(), reports[0].answered, warnings.len()), (1, 1, 0));
}
