//! Deadlines, cancellations and the reports of progress of a replay.

use std::cell::Cell;

use bagpipe_graph::Sink as _;

use super::realtime::bag_of_times;
use super::{ByHand, Rehearsal, ms, request, window};
use crate::{Cancellation, ReplayError, Stage};

const STAGES: [(Stage, &str); 4] = [
    (Stage::Subscribe, "while its subscriptions were awaited"),
    (Stage::LeadIn, "during the warm-up"),
    (Stage::Play, "during the play"),
    (Stage::Drain, "while the last messages were awaited"),
];

fn rehearsal() -> Rehearsal {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 9_000));
    request.case_deadline = by_hand.moment(ms(260));
    Rehearsal::new(&by_hand, request)
}

#[test]
fn the_case_s_deadline_ends_any_stage_at_its_moment_and_names_it() {
    for (stage, words) in STAGES {
        let rehearsal = rehearsal();
        let error = rehearsal.watched(|watch| {
            watch.enter(stage);
            watch.sleep(ms(600_000)).unwrap_err()
        });
        assert_eq!(error.to_string(), format!("the case's deadline passed {words}"));
        assert_eq!(rehearsal.by_hand.passed(), ms(260));
    }
}

#[test]
fn a_sleep_ends_at_its_moment_also_between_two_looks() {
    let rehearsal = rehearsal();
    rehearsal.watched(|watch| {
        for (time, end) in [(0, 0), (1, 1), (19, 20), (20, 40), (21, 61), (133, 194)] {
            watch.sleep(ms(time)).unwrap();
            assert_eq!(rehearsal.by_hand.passed(), ms(end));
        }
    });
}

#[test]
fn the_case_s_deadline_holds_between_two_messages_that_are_far_apart() {
    let rehearsal = rehearsal();
    let error = rehearsal.play(&bag_of_times(&[0, 8_000]), |player, plan, watch| {
        watch.enter(Stage::Play);
        let schedule = player.schedule(0, watch.now());
        player
            .play(plan.counted.clone(), schedule, bagpipe_graph::Share::Counted, watch)
            .unwrap_err()
    });
    assert_eq!(error.reason(), "CaseDeadlineExceeded");
    assert_eq!(error.to_string(), "the case's deadline passed during the play");
    assert_eq!((rehearsal.moments(), rehearsal.by_hand.passed()), (vec![ms(0)], ms(260)));
}

#[test]
fn a_cancellation_is_noticed_within_a_nap() {
    for (stage, words) in STAGES {
        for why in [Cancellation::StackExited, Cancellation::PeerGone, Cancellation::Terminated] {
            let rehearsal = rehearsal();
            rehearsal.cancels(ms(121), why);
            let slept = rehearsal.watched(|watch| {
                watch.enter(stage);
                watch.sleep(ms(200))
            });
            // Who stays until the last message has gone out may leave.
            let may = why == Cancellation::StackExited && stage == Stage::Drain;
            assert_eq!(rehearsal.by_hand.passed(), ms(if may { 200 } else { 140 }));
            match (why, slept) {
                (Cancellation::StackExited, Err(ReplayError::StackExited { during })) => {
                    assert_eq!((may, during), (false, words));
                }
                (_, Err(ReplayError::Cancelled(reason))) => assert_eq!(reason, why),
                (_, slept) => assert!(may && slept.is_ok(), "{slept:?}"),
            }
        }
    }
}

#[test]
fn a_stack_may_end_once_the_last_message_goes_out() {
    let rehearsal = rehearsal();
    rehearsal.cancels(ms(30), Cancellation::StackExited);
    rehearsal.watched(|watch| {
        watch.enter(Stage::Play);
        watch.sleep(ms(20)).unwrap();
        watch.last_goes_out();
        watch.sleep(ms(20)).unwrap();
        assert!(!watch.stack_has_exited());
        watch.check().unwrap();
        assert!(watch.stack_has_exited());
        watch.enter(Stage::Drain);
    });
    let reported = rehearsal.reported.lock().unwrap();
    let last_out = reported.iter().map(|(_, progress)| progress.last_out).collect::<Vec<_>>();
    assert_eq!(last_out, [None, Some(rehearsal.by_hand.moment(ms(20)))]);
}

#[test]
fn what_had_to_stay_may_leave_once_the_last_message_goes_out() {
    for (stage, last_goes_out, ends) in [
        (Stage::LeadIn, false, true),
        (Stage::Play, false, true),
        (Stage::Play, true, false),
        (Stage::Drain, false, false),
    ] {
        let rehearsal = rehearsal();
        rehearsal.recorder.clone().broken("/a rests".to_owned());
        rehearsal.recorder.clone().broken("/b rests".to_owned());
        let checked = rehearsal.watched(|watch| {
            watch.enter(stage);
            if last_goes_out {
                watch.last_goes_out();
            }
            watch.check()
        });
        let sentence = "/a rests; a play proves nothing of a node that is not at work";
        let ended = checked.err().map(|error| (error.reason(), error.to_string()));
        assert_eq!(ended, ends.then(|| ("NodeInactive", sentence.to_owned())), "{stage:?}");
    }
}

#[test]
fn it_looks_up_every_10_ms_however_often_it_is_asked() {
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 9_000)));
    let looks = Cell::new(0);
    let cancelled = || {
        looks.set(looks.get() + 1);
        None
    };
    let (recorder, clock) = (&rehearsal.recorder, &rehearsal.clock);
    let progress = &mut |_| ();
    let mut watch = super::Watch::new(&rehearsal.request, recorder, clock, progress, &cancelled);
    for _ in 0..1_000 {
        assert!(!watch.must_stop());
    }
    assert_eq!(looks.get(), 1);
    for _ in 0..100 {
        by_hand.sleep(ms(1));
        assert!(!watch.must_stop());
    }
    assert_eq!(looks.get(), 11);
}

#[test]
fn progress_is_reported_when_a_stage_begins_and_every_half_second() {
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 9_000)));
    rehearsal.play(&bag_of_times(&[0, 250, 700, 1_300, 1_400]), |player, plan, watch| {
        watch.enter(Stage::Play);
        let schedule = player.schedule(0, watch.now());
        player.play(plan.counted.clone(), schedule, bagpipe_graph::Share::Counted, watch).unwrap();
        watch.enter(Stage::Drain);
        watch.sleep(ms(600)).unwrap();
    });
    let reported = rehearsal.reported.lock().unwrap();
    let reported: Vec<_> = reported
        .iter()
        .map(|(at, progress)| (*at, progress.stage, progress.sent, progress.bag_seconds))
        .collect();
    let expected = [
        (ms(0), Stage::Play, 0, 0.0),
        // It looks up between two naps of 20 ms, which begin with a message.
        (ms(510), Stage::Play, 2, 0.51),
        (ms(1_020), Stage::Play, 3, 1.02),
        (ms(1_400), Stage::Drain, 5, 1.4),
        (ms(1_900), Stage::Drain, 5, 1.9),
    ];
    assert_eq!(reported, expected);
}
