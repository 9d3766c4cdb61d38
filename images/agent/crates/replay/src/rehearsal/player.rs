//! What a player counts, in what pieces messages go out at full speed, and when the stack may end.

use std::collections::BTreeSet;
use std::sync::Arc;

use bagpipe_graph::{Incoming, Publisher, Share, Sink};

use super::bags::{bag_of_words, words};
use super::realtime::{bag, bag_of_times};
use super::{
    AnswerBy, ByHand, Cancellation, MS, Mode, Rehearsal, Window, ms, request, step, window,
};
use crate::play::Played;
use crate::{ReplayError, Stage};

/// Of /a two in the warm-up and two in the window, of /b one and three.
const MESSAGES: [(usize, u64, &str); 8] = [
    (0, 100, "a1"),
    (1, 200, "b1"),
    (0, 300, "a2"),
    (1, 1_000, "b2"),
    (1, 1_100, "b3"),
    (0, 1_200, "a3"),
    (0, 1_300, "a4"),
    (1, 1_400, "b4"),
];

/// A play of `MESSAGES` in a mode, the last second of them as the window.
fn rehearsal(mode: Mode) -> Rehearsal {
    let by_hand = ByHand::new();
    let whole = Window { lead_in_start: 0, ..window(1_000, 2_000) };
    let mut request = request(&by_hand, whole);
    request.mode = mode;
    Rehearsal::new(&by_hand, request)
}

impl Rehearsal {
    /// Plays the warm-up and the window. What was played, by topic.
    fn play_both(&self) -> Vec<Played> {
        self.play(&bag(&MESSAGES), |player, plan, watch| {
            for (share, range) in
                [(Share::LeadIn, plan.lead_in.clone()), (Share::Counted, plan.counted.clone())]
            {
                let schedule = player
                    .schedule(if share == Share::LeadIn { 0 } else { 1_000 * MS }, watch.now());
                player.play(range, schedule, share, watch).unwrap();
            }
            assert_eq!(watch.sent, 8);
            player.played().to_vec()
        })
    }
}

#[test]
fn what_was_played_is_counted_by_topic_in_the_warm_up_and_in_the_window() {
    for mode in [Mode::Realtime, Mode::Max, Mode::Lockstep] {
        let played = rehearsal(mode).play_both();
        let counts = [Played { lead_in: 2, counted: 2 }, Played { lead_in: 1, counted: 3 }];
        assert_eq!(played, counts, "{mode:?}");
    }
}

#[test]
fn at_full_speed_consecutive_messages_of_a_connection_go_out_at_the_last_one_s_time() {
    let rehearsal = rehearsal(Mode::Max);
    rehearsal.play_both();
    let times = [100, 200, 300, 1_100, 1_100, 1_300, 1_300, 1_400];
    assert_eq!(rehearsal.log.bag_times(), times.map(|at| at * MS));
    let expected = MESSAGES.map(|(_, _, word)| word.to_owned()).to_vec();
    assert_eq!(
        rehearsal.log.words().into_iter().map(|(_, word)| word).collect::<Vec<_>>(),
        expected
    );
}

#[test]
fn with_a_clock_each_message_goes_out_at_its_own_time_also_at_full_speed() {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(1_000, 2_000));
    (request.mode, request.use_sim_time) = (Mode::Max, true);
    let rehearsal = Rehearsal::new(&by_hand, request);
    rehearsal.play_window(&bag(&MESSAGES));
    let times = [1_000, 1_100, 1_200, 1_300, 1_400].map(|at| at * MS);
    assert_eq!(rehearsal.log.bag_times(), times);
    assert_eq!(rehearsal.log.ticks(), times.map(|at| (ms(0), at)));
}

#[test]
fn what_was_latched_before_the_warm_up_goes_out_and_is_part_of_it() {
    let latched = [words("/a", "/t", true), words("/b", "/t", false)];
    let file = bag_of_words(&latched, &[(0, 100, "map"), (1, 200, "old"), (1, 1_000, "b")]);
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(1_000, 2_000)));
    let played = rehearsal.play(&file, |player, _, watch| {
        player.play_latched(watch).unwrap();
        player.played().to_vec()
    });
    assert_eq!(rehearsal.log.words(), [(ms(0), "map".to_owned())]);
    assert_eq!(played, [Played { lead_in: 1, counted: 0 }, Played::default()]);
}

#[test]
fn time_goes_in_steps_where_a_clock_is_shown_in_lock_step_and_advances_with_who_says_so() {
    // In lock-step a time is sent again once it was read.
    for (mode, use_sim_time, ticks) in [
        (Mode::Lockstep, true, 2),
        (Mode::Lockstep, false, 0),
        (Mode::Max, true, 1),
        (Mode::Realtime, false, 0),
    ] {
        let by_hand = ByHand::new();
        let mut request = request(&by_hand, window(1_000, 2_000));
        (request.mode, request.use_sim_time) = (mode, use_sim_time);
        let rehearsal = Rehearsal::new(&by_hand, request);
        let (shows, advanced) = rehearsal.play(&bag(&MESSAGES), |player, _, watch| {
            player.advance(1_234 * MS, watch).unwrap();
            (player.shows_time(), rehearsal.clock.now())
        });
        assert_eq!(shows, use_sim_time, "{mode:?}");
        assert_eq!(advanced, 1_234 * MS);
        assert_eq!(rehearsal.log.ticks(), vec![(ms(0), 1_234 * MS); ticks]);
    }
}

#[test]
fn a_time_on_which_no_message_depends_waits_for_nobody() {
    for mode in [Mode::Max, Mode::Lockstep] {
        let by_hand = ByHand::new();
        let mut request = request(&by_hand, window(1_000, 2_000));
        (request.mode, request.use_sim_time) = (mode, true);
        let rehearsal = Rehearsal::new(&by_hand, request);
        rehearsal.log.let_clock_wait();
        rehearsal.cancels(ms(170), Cancellation::Terminated);
        rehearsal.play(&bag(&MESSAGES), |player, _, watch| {
            let mut show = || player.show_clock(watch).map_err(|error| error.reason());
            assert_eq!([show(), show()], [Ok(()), Ok(())]);
            assert_eq!(by_hand.passed(), ms(100));
            // Who needs it waits until somebody wants an end.
            let shown = player.show_clock_to_all(watch).map_err(|error| error.reason());
            assert_eq!((shown, by_hand.passed()), (Err("Terminated"), ms(170)));
        });
    }
}

#[test]
fn who_answered_each_message_is_known_of_the_topic_that_was_answered() {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 9_000));
    (request.mode, request.steps) = (Mode::Lockstep, vec![step(AnswerBy::Count, ms(250))]);
    let rehearsal = Rehearsal::new(&by_hand, request);
    let recorder = rehearsal.recorder.clone();
    rehearsal.log.read_by(move |_| {
        let publisher = &Publisher { node: Some("/lane".to_owned()), ..Publisher::default() };
        recorder.clone().message(Incoming { topic: "/answer", publisher, link: 1, data: &[0; 4] });
    });
    let answered = rehearsal.play(&bag_of_times(&[0, 100]), |player, plan, watch| {
        let schedule = player.schedule(0, watch.now());
        player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap();
        player.answered()
    });
    assert_eq!(answered, [(0, BTreeSet::from(["/lane".to_owned()]))]);
}

/// Plays three messages as a share, of which the stack ends at one. Whether it may.
fn may_end_at(word: &'static str, share: Share, mode: Mode) -> bool {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 9_000));
    request.mode = mode;
    let rehearsal = Rehearsal::new(&by_hand, request);
    let (cancelled, clock) = (Arc::clone(&rehearsal.cancelled), Arc::clone(&by_hand));
    rehearsal.log.read_by(move |read| {
        if read == word {
            *cancelled.lock().unwrap() = Some(Cancellation::StackExited);
        }
        clock.sleep(ms(20));
    });
    let ended = rehearsal.play(&bag_of_times(&[0, 100, 200]), |player, plan, watch| {
        watch.enter(if share == Share::LeadIn { Stage::LeadIn } else { Stage::Play });
        let schedule = player.schedule(0, watch.now());
        player.play(plan.counted.clone(), schedule, share, watch)?;
        watch.check().map(|()| watch.stack_has_exited())
    });
    match ended {
        Ok(exited) => exited,
        Err(ReplayError::StackExited { .. }) => false,
        Err(other) => panic!("{other}"),
    }
}

#[test]
fn the_stack_may_end_with_the_last_message_of_the_window_and_none_before() {
    for mode in [Mode::Realtime, Mode::Lockstep] {
        let counted = ["0", "100", "200"].map(|word| may_end_at(word, Share::Counted, mode));
        assert_eq!(counted, [false, false, true], "{mode:?}");
        assert!(!may_end_at("200", Share::LeadIn, mode), "{mode:?}");
    }
}
