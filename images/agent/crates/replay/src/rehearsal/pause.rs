//! A pause, and how it moves what comes after it.

use std::sync::{Arc, Mutex};

use super::realtime::bag;
use super::{ByHand, MS, Mode, Rehearsal, ms, request, window};
use crate::Pause;

/// Bag time at each question whether to go on, in milliseconds.
type Asked = Arc<Mutex<Vec<u64>>>;

/// A play that stops before each message of /b until it has been asked 26 times.
fn paused(by_hand: &Arc<ByHand>, rate: f64, mode: Mode) -> (Rehearsal, Asked) {
    let mut request = request(by_hand, window(1_000, 2_000));
    (request.rate, request.mode) = (rate, mode);
    let mut rehearsal = Rehearsal::new(by_hand, request);
    let (asked, clock) = (Asked::default(), Arc::clone(&rehearsal.clock));
    let resumed = {
        let asked = Arc::clone(&asked);
        move |topic: &str| {
            assert_eq!(topic, "/b");
            let mut asked = asked.lock().unwrap();
            asked.push(clock.now() / MS);
            asked.len() % 26 == 0
        }
    };
    rehearsal.request.pause =
        Some(Pause { topics: vec!["b".to_owned()], resumed: Arc::new(resumed) });
    (rehearsal, asked)
}

const MESSAGES: [(usize, u64, &str); 5] =
    [(0, 1_000, "a1"), (1, 1_100, "b1"), (0, 1_200, "a2"), (1, 1_300, "b2"), (0, 1_500, "a3")];

#[test]
fn a_pause_moves_all_that_follows_by_its_length_and_bag_time_stands_meanwhile() {
    for (rate, moments) in [(1.0, [0, 350, 450, 800, 1_000]), (2.0, [0, 300, 350, 650, 750])] {
        let by_hand = ByHand::new();
        let (rehearsal, asked) = paused(&by_hand, rate, Mode::Realtime);
        let pace = rehearsal.play_window(&bag(&MESSAGES));
        // Asked every 10 ms, each pause is over after 250 ms.
        assert_eq!(rehearsal.moments(), moments.map(ms));
        assert_eq!(rehearsal.log.bag_times(), MESSAGES.map(|(_, at, _)| at * MS));
        let stands = [[1_100; 26], [1_300; 26]].concat();
        assert_eq!(*asked.lock().unwrap(), stands);
        // Neither late nor played longer for it.
        assert_eq!((pace.late, pace.took), (ms(0), moments.map(ms)[4] - ms(500)));
    }
}

#[test]
fn in_max_and_in_lockstep_a_pause_stands_before_its_message_and_is_no_time_played() {
    for mode in [Mode::Max, Mode::Lockstep] {
        let by_hand = ByHand::new();
        let (rehearsal, asked) = paused(&by_hand, 1.0, mode);
        let pace = rehearsal.play_window(&bag(&MESSAGES));
        assert_eq!(rehearsal.moments(), [0, 250, 250, 500, 500].map(ms));
        // The message before is the last that anybody has had.
        assert_eq!(*asked.lock().unwrap(), [[1_000; 26], [1_200; 26]].concat());
        assert_eq!((pace.late, pace.took), (ms(0), ms(0)));
    }
}
