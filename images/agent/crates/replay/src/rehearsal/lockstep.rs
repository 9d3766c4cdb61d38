//! In lock-step: how long each answer is waited for.

use std::sync::Arc;

use bagpipe_graph::Share;

use super::realtime::bag_of_times;
use super::{AnswerBy, ByHand, MS, Mode, Rehearsal, graph_of, ms, request, say, step, window};
use crate::answers::Answers;
use crate::lockstep::Lockstep;
use crate::outcome::StepReport;
use crate::plan::Plan;
use crate::play::{Pace, Player};
use crate::simulate::Turns;
use crate::world::{LatestMessage, Moment, World};
use crate::{Meter, ReplayError, Stage};

/// A play in lock-step of which each answer is awaited for 250 ms.
fn rehearsal(by_hand: &Arc<ByHand>, optional: bool) -> Rehearsal {
    let mut request = request(by_hand, window(0, 9_000));
    request.mode = Mode::Lockstep;
    request.steps = vec![step(AnswerBy::Count, ms(250))];
    request.steps[0].optional = optional;
    Rehearsal::new(by_hand, request)
}

impl Rehearsal {
    /// /a's words are answered after so many milliseconds each, if at all.
    fn answers_after<const N: usize>(&self, delays: [Option<u64>; N]) {
        let (by_hand, recorder) = (Arc::clone(&self.by_hand), self.recorder.clone());
        let delays = std::sync::Mutex::new(delays.into_iter());
        self.log.read_by(move |_| {
            let Some(Some(delay)) = delays.lock().unwrap().next() else { return };
            let recorder = recorder.clone();
            by_hand.at(by_hand.passed() + ms(delay), move || say(&recorder, "/answer"));
        });
    }

    fn play_steps(&self, times: &[u64]) -> (Pace, StepReport) {
        self.play(&bag_of_times(times), |player, plan, watch| {
            let schedule = player.schedule(0, watch.now());
            let pace = player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap();
            (pace, player.end_steps().0.remove(0))
        })
    }
}

// Promise: no-output-at-the-deadline
#[test]
fn the_next_message_goes_out_with_the_answer_or_at_its_deadline() {
    for optional in [false, true] {
        let by_hand = ByHand::new();
        let rehearsal = rehearsal(&by_hand, optional);
        rehearsal.answers_after([Some(33), None, Some(0), Some(125), None, Some(2)]);
        let (pace, report) = rehearsal.play_steps(&[0, 100, 200, 300, 400, 500]);
        assert_eq!(rehearsal.moments(), [0, 33, 283, 283, 408, 658].map(ms));
        assert_eq!(pace.took, ms(660));
        let silent = if optional { (0, 2) } else { (2, 0) };
        assert_eq!((report.released, report.answered), (6, 4));
        assert_eq!((report.no_output, report.skipped), silent);
        assert_eq!((report.waited_seconds, report.slowest_seconds), (0.033 + 0.125 + 0.002, 0.125));
    }
}

// Promise: no-output-at-the-deadline
#[test]
fn an_answer_counts_up_to_its_deadline_and_not_a_moment_longer() {
    for (after, answered) in [(249, 1), (250, 1), (251, 0)] {
        let by_hand = ByHand::new();
        let rehearsal = rehearsal(&by_hand, false);
        rehearsal.answers_after([Some(after)]);
        let (pace, report) = rehearsal.play_steps(&[0]);
        assert_eq!((report.answered, report.no_output), (answered, 1 - answered));
        assert_eq!(pace.took, ms(after.min(250)));
    }
}

#[test]
fn the_deadline_counts_from_the_release_also_where_the_subscribers_take_their_time() {
    let by_hand = ByHand::new();
    let rehearsal = rehearsal(&by_hand, false);
    let reader = Arc::clone(&by_hand);
    rehearsal.log.read_by(move |_| reader.sleep(ms(100)));
    let (pace, report) = rehearsal.play_steps(&[0, 1]);
    assert_eq!((pace.took, report.no_output), (ms(500), 2));
}

#[test]
fn the_case_s_deadline_holds_while_an_answer_is_awaited() {
    let by_hand = ByHand::new();
    let mut rehearsal = rehearsal(&by_hand, false);
    rehearsal.request.case_deadline = by_hand.moment(ms(150));
    let error = rehearsal.play(&bag_of_times(&[0, 1]), |player, plan, watch| {
        watch.enter(Stage::Play);
        let schedule = player.schedule(0, watch.now());
        player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap_err()
    });
    assert_eq!(error.to_string(), "the case's deadline passed during the play");
    assert_eq!(by_hand.passed(), ms(150));
}

#[test]
fn a_wait_is_metered_to_the_nanosecond() {
    let by_hand = ByHand::new();
    let meter = Arc::new(Meter::default());
    let topic = bagpipe_graph::TopicInfo { topic: "/a".to_owned(), ..Default::default() };
    let lockstep = Lockstep::new(
        &[step(AnswerBy::Count, ms(40))],
        &[topic],
        &*graph_of("http://127.0.0.1:9/"),
    )
    .unwrap();
    let mut lockstep = lockstep.metered(&meter);
    let answers = Arc::new(Answers::new(lockstep.awaited()));
    for answered in [true, false] {
        let due = lockstep.release(0, &[], None, &answers)[0];
        if answered {
            let answers = Arc::clone(&answers);
            let after = std::time::Duration::from_nanos(12_345_678);
            by_hand.at(after, move || {
                answers.of("/answer", |received| received.count += 1);
            });
        }
        lockstep.wait(due, by_hand.now(), &answers, &by_hand.time(), || Ok(())).unwrap();
    }
    let read = meter.read();
    assert_eq!((read.waited_nanoseconds, read.unanswered), (12_345_678, 1));
    assert_eq!(by_hand.passed(), std::time::Duration::from_nanos(52_345_678));
}

/// A world of three moments, each of which it thinks about for 100 ms.
struct Thinker(Arc<ByHand>, u64);

impl World for Thinker {
    fn next(
        &mut self,
        _: Vec<LatestMessage>,
        _: &dyn Fn() -> bool,
    ) -> Result<Option<Moment>, ReplayError> {
        if self.1 == 3 {
            return Ok(None);
        }
        self.0.sleep(ms(100));
        self.1 += 1;
        let frame = [&6u32.to_le_bytes()[..], &2u32.to_le_bytes(), b"hi"].concat();
        Ok(Some(Moment { time: self.1 * MS, messages: vec![(0, frame)] }))
    }
}

#[test]
fn a_simulated_play_takes_what_the_world_and_the_answers_take() {
    let by_hand = ByHand::new();
    let rehearsal = rehearsal(&by_hand, false);
    rehearsal.answers_after([Some(20), None, Some(30)]);
    let (answers, recorder) = (&rehearsal.answers, &rehearsal.recorder);
    let mut world = Thinker(Arc::clone(&by_hand), 0);
    let topic = bagpipe_graph::TopicInfo { topic: "/a".to_owned(), ..Default::default() };
    let plan = Plan::of_topics(vec![topic]);
    let asked = request(&by_hand, window(0, 9_000));
    let pace = rehearsal.play(&bag_of_times(&[0]), |player: &mut Player<'_, _>, _, watch| {
        Turns::new(&mut world, answers, recorder, &plan, &asked).play(player, watch).unwrap()
    });
    assert_eq!(rehearsal.moments(), [100, 220, 570].map(ms));
    assert_eq!((pace.took, pace.late, pace.last), (ms(600), ms(0), Some(3 * MS)));
}
