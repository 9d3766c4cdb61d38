//! After the last message: what ends the recording, and when.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use bagpipe_graph::{Node, Publication};

use super::realtime::bag_of_times;
use super::scripted::{Scripted, Words};
use super::{ByHand, MS, Mode, Rehearsal, ms, request, window};
use crate::drain::Drain;
use crate::plan::Plan;
use crate::play::Player;
use crate::processes::{Processes, Rest};
use crate::prove::Proof;
use crate::{Cancellation, ReplayError, Stage};

fn rehearsal() -> Rehearsal {
    let by_hand = ByHand::new();
    let request = request(&by_hand, window(1_000, 2_000));
    Rehearsal::new(&by_hand, request)
}

impl Rehearsal {
    /// Listens until nobody works any more, by what is seen of the nodes at each time; when it
    /// ended.
    fn listen(&self, seen: impl Fn(Duration) -> Rest) -> Result<Duration, ReplayError> {
        let node = self.node();
        let drain = self.drain(&*node);
        self.play(&bag_of_times(&[1_000]), |player, _, watch| {
            watch.enter(Stage::Drain);
            let look = |_| seen(self.by_hand.passed());
            drain.await_quiet(watch.now(), look, player, watch)
        })?;
        Ok(self.by_hand.passed())
    }

    fn drain<'a>(&'a self, node: &'a dyn Node) -> Drain<'a> {
        let since = self.by_hand.moment(ms(0));
        Drain { node, request: &self.request, recorder: &self.recorder, since }
    }
}

// Promise: recording-ends-by-nodes
#[test]
fn a_recording_ends_after_300_ms_in_which_nothing_came_and_nobody_worked() {
    assert_eq!(rehearsal().listen(|_| Rest::Still).unwrap(), ms(300));
    let rehearsal = rehearsal();
    rehearsal.says(ms(205), "/answer");
    // Looked at every 10 ms.
    assert_eq!(rehearsal.listen(|_| Rest::Still).unwrap(), ms(510));
}

// Promise: recording-ends-by-nodes
#[test]
fn who_works_in_silence_is_waited_for_and_300_ms_more() {
    let works_until = |end| move |now| if now < ms(end) { Rest::Working } else { Rest::Still };
    // Looked at every 50 ms: last seen at work at 950.
    assert_eq!(rehearsal().listen(works_until(1_000)).unwrap(), ms(1_250));
    let sleeps = |now| if now < ms(1_000) { Rest::Asleep } else { Rest::Still };
    // Who sleeps has published nothing all the while.
    assert_eq!(rehearsal().listen(sleeps).unwrap(), ms(1_000));
}

#[test]
fn outputs_or_work_without_end_are_awaited_until_the_deadline() {
    let rehearsal_of_outputs = rehearsal();
    (0..50).for_each(|at| rehearsal_of_outputs.says(ms(100 * at), "/answer"));
    assert_eq!(rehearsal_of_outputs.listen(|_| Rest::Still).unwrap(), ms(2_000));
    for rest in [Rest::Working, Rest::Asleep] {
        assert_eq!(rehearsal().listen(|_| rest).unwrap(), ms(2_000));
    }
}

#[test]
fn a_deadline_that_has_passed_leaves_300_ms_to_answer_the_last_message() {
    for rest in [Rest::Working, Rest::Still] {
        let mut rehearsal = rehearsal();
        rehearsal.request.drain_deadline = ms(5);
        assert_eq!(rehearsal.listen(|_| rest).unwrap(), ms(300));
    }
}

#[test]
fn time_in_which_the_machine_stood_still_is_no_silence() {
    let rehearsal = rehearsal();
    rehearsal.by_hand.stall(ms(100), ms(1_000));
    // 1 s of the sleep of 1.01 s was nobody's.
    assert_eq!(rehearsal.listen(|_| Rest::Still).unwrap(), ms(1_300));
}

#[test]
fn a_stack_that_ends_meanwhile_ends_it_and_a_passed_deadline_fails_it() {
    let rehearsal = rehearsal();
    rehearsal.cancels(ms(205), Cancellation::StackExited);
    // Seen at 210, at the beginning of a sleep.
    assert_eq!(rehearsal.listen(|_| Rest::Working).unwrap(), ms(220));

    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(1_000, 2_000));
    request.case_deadline = by_hand.moment(ms(150));
    let error = Rehearsal::new(&by_hand, request).listen(|_| Rest::Working).unwrap_err();
    assert_eq!(error.reason(), "CaseDeadlineExceeded");
    assert_eq!(by_hand.passed(), ms(150));
}

#[test]
fn each_look_is_given_whether_something_was_received_since_the_last() {
    let rehearsal = rehearsal();
    rehearsal.says(ms(120), "/answer");
    let node = rehearsal.node();
    let drain = rehearsal.drain(&*node);
    let mut looks = Vec::new();
    rehearsal.play(&bag_of_times(&[1_000]), |player, _, watch| {
        let look = |received| {
            looks.push((rehearsal.by_hand.passed(), received));
            Rest::Still
        };
        drain.await_quiet(watch.now(), look, player, watch).unwrap();
    });
    let expected: Vec<_> = (50..=400).step_by(50).map(|at| (ms(at), at == 150)).collect();
    assert_eq!(looks, expected);
}

#[test]
fn the_clock_goes_on_while_the_outputs_are_awaited() {
    for (clock_rate, times) in [(100.0, [1_010, 1_020, 1_030]), (0.0, [1_000; 3])] {
        let by_hand = ByHand::new();
        let mut request = request(&by_hand, window(1_000, 2_000));
        (request.use_sim_time, request.clock_rate) = (true, clock_rate);
        let rehearsal = Rehearsal::new(&by_hand, request);
        rehearsal.clock.run(by_hand.now(), 1_000 * MS, 1.0);
        rehearsal.listen(|_| Rest::Still).unwrap();
        let ticks = rehearsal.log.ticks();
        let expected = [ms(10), ms(20), ms(30)].into_iter().zip(times.map(|at| at * MS));
        assert_eq!((ticks.len(), &ticks[..3]), (30, &expected.collect::<Vec<_>>()[..]));
    }
}

#[test]
fn without_a_subscriber_all_is_proved_at_the_second_question() {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 1));
    request.mode = Mode::Max;
    let rehearsal = Rehearsal::new(&by_hand, request);
    let node = rehearsal.node();
    let plan = Plan::of_topics(Vec::new());
    let (clock, request) = (&rehearsal.clock, &rehearsal.request);
    let mut player = Player::advertise(&*node, &plan, clock, request, None).unwrap();
    let audit = node.audit(ms(1));
    let mut proof = Proof::new(audit);
    let mut processes = Processes::meet(Default::default());
    let drain = rehearsal.drain(&*node);
    rehearsal.watched(|watch| {
        drain.prove(&mut proof, &mut player, watch).unwrap();
        assert_eq!(by_hand.passed(), ms(10));
        drain.listen(&mut proof, &mut processes, &mut player, watch).unwrap();
    });
    assert_eq!(by_hand.passed(), ms(310));
}

/// Proves the delivery of a topic that nobody subscribes to, of which `unsent` bytes are still to
/// go out until `gone`; when it ended.
fn proved(rehearsal: &Rehearsal, unsent: u64, gone: Duration) -> Duration {
    let topic = Scripted::new("/a", &[]);
    topic.unsent.store(unsent, Ordering::Relaxed);
    let of_kernel = Arc::clone(&topic);
    rehearsal.by_hand.at(gone, move || of_kernel.unsent.store(0, Ordering::Relaxed));
    let node = rehearsal.node();
    let plan = Plan::of_topics(Vec::new());
    let outlets = (vec![topic as Arc<dyn Publication>], None);
    let mut player = Player::new(&plan, &rehearsal.clock, &rehearsal.request, None, outlets);
    let mut proof = Proof::new(Words::default().audit());
    let drain = rehearsal.drain(&*node);
    rehearsal.watched(|watch| {
        watch.enter(Stage::Drain);
        drain.prove(&mut proof, &mut player, watch).unwrap();
    });
    rehearsal.by_hand.passed()
}

#[test]
fn what_has_not_gone_out_yet_is_waited_for_before_anybody_is_asked() {
    // Looked at every 10 ms; who has nothing more to get is asked twice.
    assert_eq!(proved(&rehearsal(), 0, ms(0)), ms(10));
    for unsent in [1, 7] {
        assert_eq!(proved(&rehearsal(), unsent, ms(35)), ms(50));
    }
}

#[test]
fn what_never_goes_out_is_waited_for_until_the_deadline_or_the_stack_s_end() {
    assert_eq!(proved(&rehearsal(), 1, ms(9_000)), ms(2_000));
    let rehearsal = rehearsal();
    rehearsal.cancels(ms(205), Cancellation::StackExited);
    // Seen at 210, at the beginning of a sleep.
    assert_eq!(proved(&rehearsal, 1, ms(9_000)), ms(220));
}
