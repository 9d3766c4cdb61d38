//! By bag time: when each message goes out, and what /clock says.

use std::time::Duration;

use bagpipe_graph::Share;
use bagpipe_log::Recording;
use bagpipe_rosbag::{Bag, MemoryChunkedFile};

use super::bags::{bag_of_words, words};
use super::{ByHand, MS, Mode, Rehearsal, Window, ms, request, window};
use crate::play::Pace;

/// A bag of /a and /b: (topic's place, milliseconds, text).
pub(super) fn bag(messages: &[(usize, u64, &str)]) -> Bag<MemoryChunkedFile> {
    bag_of_words(&[words("/a", "/t", false), words("/b", "/t", false)], messages)
}

/// A bag of /a, whose words are their times in milliseconds.
pub(super) fn bag_of_times(times: &[u64]) -> Bag<MemoryChunkedFile> {
    let texts: Vec<String> = times.iter().map(u64::to_string).collect();
    let messages: Vec<_> =
        times.iter().zip(&texts).map(|(time, text)| (0, *time, text.as_str())).collect();
    bag(&messages)
}

impl Rehearsal {
    /// Plays the window, which begins now.
    pub(super) fn play_window(&self, bag: &dyn Recording) -> Pace {
        self.play(bag, |player, plan, watch| {
            let schedule = player.schedule(self.request.window.start, watch.now());
            player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap()
        })
    }

    /// When the words went out.
    pub(super) fn moments(&self) -> Vec<Duration> {
        self.log.words().into_iter().map(|(at, _)| at).collect()
    }
}

#[test]
fn messages_go_out_when_they_are_due_at_any_rate() {
    let bag = bag_of_times(&[1_000, 1_100, 1_250, 2_000]);
    for (rate, moments) in [
        (0.5, [0, 200, 500, 2_000]),
        (1.0, [0, 100, 250, 1_000]),
        (2.0, [0, 50, 125, 500]),
        (4.0, [0, 25, 62, 250]),
    ] {
        let by_hand = ByHand::new();
        let mut request = request(&by_hand, window(1_000, 2_001));
        request.rate = rate;
        let rehearsal = Rehearsal::new(&by_hand, request);
        let pace = rehearsal.play_window(&bag);
        // Four times as fast, 250 ms are 62.5.
        let half = Duration::from_micros(if rate == 4.0 { 500 } else { 0 });
        let moments = moments.map(ms);
        let moments = [moments[0], moments[1], moments[2] + half, moments[3]];
        assert_eq!(rehearsal.moments(), moments);
        assert_eq!((pace.late, pace.took, pace.last), (ms(0), moments[3], Some(2_000 * MS)));
        // Every answer is stamped with the message's own time.
        assert_eq!(rehearsal.log.bag_times(), [1_000, 1_100, 1_250, 2_000].map(|at| at * MS));
    }
}

#[test]
fn after_a_stall_the_play_catches_up_at_the_least_distance_and_says_how_late_it_was() {
    let bag = bag_of_times(&[0, 100, 200, 300, 400, 500, 600, 700, 800, 900]);
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 1_000)));
    by_hand.stall(ms(250), ms(300));
    let pace = rehearsal.play_window(&bag);
    // Due at 300, 400 and 500, in the 10 ms that are the most which is kept.
    let moments = [0, 100, 200, 550, 560, 570, 600, 700, 800, 900];
    assert_eq!(rehearsal.moments(), moments.map(ms));
    assert_eq!((pace.late, pace.took), (ms(250), ms(900)));
}

#[test]
fn a_subscriber_that_takes_its_time_makes_the_next_message_late_and_no_other() {
    let bag = bag_of_times(&[0, 100, 200, 300]);
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 1_000)));
    let reader = std::sync::Arc::clone(&by_hand);
    rehearsal.log.read_by(move |word| reader.sleep(ms(if word == "100" { 130 } else { 0 })));
    let pace = rehearsal.play_window(&bag);
    assert_eq!(rehearsal.moments(), [0, 100, 230, 300].map(ms));
    assert_eq!((pace.late, pace.took), (ms(30), ms(300)));
}

#[test]
fn a_burst_is_played_at_three_quarters_of_the_mean_period() {
    // Ten messages in 40 ms: 3 ms apart. The third to the sixth were recorded at once.
    let bag = bag_of_times(&[0, 5, 12, 12, 12, 12, 25, 30, 35, 40]);
    let by_hand = ByHand::new();
    let rehearsal = Rehearsal::new(&by_hand, request(&by_hand, window(0, 1_000)));
    let pace = rehearsal.play_window(&bag);
    assert_eq!(rehearsal.moments(), [0, 5, 12, 15, 18, 21, 25, 30, 35, 40].map(ms));
    assert_eq!(pace.late, ms(9));
}

#[test]
fn a_burst_at_twice_the_rate_is_half_as_far_apart_and_each_topic_keeps_its_own_distance() {
    // In a second, 100 of /a and 4 of /b, played in half a second: 3.75 ms, and the most, 10 ms.
    let mut messages: Vec<(usize, u64, &str)> = (0..98).map(|at| (0, 10 * at, "a")).collect();
    messages.extend([(0, 1_000, "a1"), (1, 1_000, "b1"), (0, 1_000, "a2"), (1, 1_000, "b2")]);
    messages.extend([(1, 500, "b"), (1, 503, "b")]);
    messages.sort_by_key(|message| message.1);
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 1_001));
    request.rate = 2.0;
    let rehearsal = Rehearsal::new(&by_hand, request);
    let pace = rehearsal.play_window(&bag(&messages));
    let mut words = rehearsal.log.words();
    let last = words.split_off(words.len() - 4);
    let us = Duration::from_micros;
    let expected = [(500_000, "a1"), (500_000, "b1"), (503_750, "a2"), (510_000, "b2")];
    assert_eq!(last, expected.map(|(at, word)| (us(at), word.to_owned())));
    let second: Vec<_> = words.into_iter().filter(|(_, word)| word == "b").collect();
    assert_eq!(second, [(ms(250), "b".to_owned()), (ms(260), "b".to_owned())]);
    assert_eq!(pace.late, ms(10));
}

/// When /clock ticked, and the times on it, in a play at four times the speed.
fn ticks(clock_rate: f64, mode: Mode, messages: &[u64]) -> Vec<(Duration, u64)> {
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(1_000, 3_001));
    (request.use_sim_time, request.clock_rate) = (true, clock_rate);
    (request.rate, request.mode) = (4.0, mode);
    let rehearsal = Rehearsal::new(&by_hand, request);
    rehearsal.play_window(&bag_of_times(messages));
    rehearsal.log.ticks()
}

/// Each of these times, in milliseconds, when it is due at four times the speed.
fn in_time(times: &[u64]) -> Vec<(Duration, u64)> {
    times.iter().map(|at| (Duration::from_micros((at - 1_000) * 250), at * MS)).collect()
}

#[test]
fn in_realtime_the_clock_ticks_when_it_is_due_at_its_own_rate_and_with_each_message() {
    let ticks = |clock_rate, messages: &[u64]| ticks(clock_rate, Mode::Realtime, messages);
    let messages = [1_000, 1_995, 3_000];
    assert_eq!(ticks(0.0, &messages), in_time(&messages));
    // Every 400 ms after the last one.
    let slow = [1_000, 1_400, 1_800, 1_995, 2_395, 2_795, 3_000];
    assert_eq!(ticks(2.5, &messages), in_time(&slow));
    let before = (1_000..1_995).step_by(10);
    let times: Vec<u64> = before.chain((1_995..3_000).step_by(10)).chain([3_000]).collect();
    assert_eq!(ticks(100.0, &messages), in_time(&times));
    // Once where a tick and a message are due together.
    let ten: Vec<u64> = (1_000..=1_100).step_by(10).collect();
    assert_eq!(ticks(100.0, &[1_000, 1_040, 1_100]), in_time(&ten));
}

#[test]
fn in_max_no_time_passes_and_the_clock_steps_with_each_message() {
    let steps = [1_000, 1_995, 3_000].map(|at| (ms(0), at * MS));
    assert_eq!(ticks(100.0, Mode::Max, &[1_000, 1_995, 3_000]), steps);
    let by_hand = ByHand::new();
    let mut request = request(&by_hand, window(0, 9_000));
    request.mode = Mode::Max;
    let rehearsal = Rehearsal::new(&by_hand, request);
    let reader = std::sync::Arc::clone(&by_hand);
    rehearsal.log.read_by(move |_| reader.sleep(ms(7)));
    let pace = rehearsal.play_window(&bag_of_times(&[0, 3_000, 6_000]));
    assert_eq!(rehearsal.moments(), [0, 7, 14].map(ms));
    assert_eq!((pace.late, pace.took, pace.last), (ms(0), ms(21), Some(6_000 * MS)));
}

#[test]
fn the_time_between_the_last_warm_up_message_and_the_window_passes_too() {
    let by_hand = ByHand::new();
    let times = Window { lead_in_start: 1_000 * MS, start: 2_000 * MS, end: 3_000 * MS };
    let mut request = request(&by_hand, times);
    request.rate = 2.0;
    let rehearsal = Rehearsal::new(&by_hand, request);
    rehearsal.play(&bag(&[(0, 1_200, "warm"), (0, 2_100, "one")]), |player, plan, watch| {
        let schedule = player.schedule(1_000 * MS, watch.now());
        player.play(plan.lead_in.clone(), schedule, Share::LeadIn, watch).unwrap();
        assert_eq!(by_hand.passed(), ms(100));
        player.wait_until(2_000 * MS, schedule, watch).unwrap();
        assert_eq!(by_hand.passed(), ms(500));
        let schedule = player.schedule(2_000 * MS, watch.now());
        player.play(plan.counted.clone(), schedule, Share::Counted, watch).unwrap();
    });
    assert_eq!(rehearsal.moments(), [100, 550].map(ms));
}
