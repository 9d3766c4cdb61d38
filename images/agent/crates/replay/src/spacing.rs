//! Bursts, in realtime: messages of one topic that were recorded at the same instant.
//!
//! A recorder stamps what it reads from a socket at once with (nearly) one time: of the
//! PR2 recording's 1,598 JointStates, made every 10 ms, 552 carry the time of the one
//! before. Sent back to back they overrun a node with a queue of one, which kept up with
//! the robot itself. So messages of a topic keep a distance of three quarters of their mean
//! period, at most 10 ms: a burst is spread, and since it takes less time than there is, the
//! play catches up with the bag's times. The same holds after a stall of our own. Lateness
//! is reported as such.
//!
//! Measured with the real robot_state_publisher (queue 1) at rate 1, 1,598 messages on two
//! cores: 0, 0 and 0 lost; beside three busy loops 26 and 37, where half the mean period (at
//! most 5 ms) lost 101 and 97.

use std::time::{Duration, Instant};

/// The largest distance kept.
const MOST: Duration = Duration::from_millis(10);
/// The share of the mean period that is kept.
const SHARE: f64 = 0.75;

/// The distances of a range of messages.
#[derive(Debug)]
pub(crate) struct Spacing {
    topics: Vec<Distance>,
}

#[derive(Clone, Copy, Debug)]
struct Distance {
    least: Duration,
    last: Option<Instant>,
}

impl Spacing {
    /// From the messages of each topic and the time in which they are to be played.
    pub(crate) fn new(messages: &[u64], time: Duration) -> Spacing {
        let distance = |count: &u64| Distance {
            least: (time.mul_f64(SHARE / (*count).max(1) as f64)).min(MOST),
            last: None,
        };
        Spacing { topics: messages.iter().map(distance).collect() }
    }

    /// When the next message of these topics may go out, which is due at `due`.
    pub(crate) fn earliest(&self, topics: &[usize], due: Instant) -> Instant {
        let after = |at: &usize| self.topics[*at].last.map(|last| last + self.topics[*at].least);
        topics.iter().filter_map(after).fold(due, Instant::max)
    }

    /// A message of these topics goes out now.
    pub(crate) fn sent(&mut self, topics: &[usize], now: Instant) {
        topics.iter().for_each(|at| self.topics[*at].last = Some(now));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_burst_is_spread_and_a_steady_topic_is_left_alone() {
        let now = Instant::now();
        let (ms, us) = (Duration::from_millis, Duration::from_micros);
        // 100 Hz and 1 kHz for a second.
        let mut spacing = Spacing::new(&[100, 1_000], ms(1_000));
        assert_eq!(spacing.earliest(&[0], now), now);
        spacing.sent(&[0, 1], now);
        assert_eq!(spacing.earliest(&[0], now), now + us(7_500));
        assert_eq!(spacing.earliest(&[0], now + ms(10)), now + ms(10));
        assert_eq!(spacing.earliest(&[1], now), now + us(750));
        assert_eq!(spacing.earliest(&[0, 1], now), now + us(7_500));
    }
}
