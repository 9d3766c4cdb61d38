//! For whom was waited, and how long.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

/// Waits for connections, by their numbers. From one look to the next the time counts for the connection
/// that was found without room at the earlier one.
#[derive(Debug, Default)]
pub struct Waits {
    now: Option<(u64, Instant)>,
    all: BTreeMap<u64, Duration>,
}

impl Waits {
    /// Takes in that a connection was found without room at this moment.
    pub fn for_room(&mut self, connection: u64, now: Instant) {
        self.end(now);
        self.now = Some((connection, now));
    }

    /// Takes in that nobody is waited for any more.
    pub fn end(&mut self, now: Instant) {
        if let Some((before, since)) = self.now.take() {
            *self.all.entry(before).or_default() += now.saturating_duration_since(since);
        }
    }

    /// How long each was waited for.
    pub fn into_all(self) -> BTreeMap<u64, Duration> {
        self.all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_between_two_looks_is_that_of_who_had_no_room_at_the_first() {
        let begun = Instant::now();
        let at = |ms| begun + Duration::from_millis(ms);
        let mut waits = Waits::default();
        waits.end(at(1));
        waits.for_room(7, at(2));
        waits.for_room(7, at(12));
        waits.for_room(3, at(15));
        waits.end(at(115));
        waits.end(at(900));
        waits.for_room(7, at(1_000));
        waits.end(at(1_001));
        let ms = Duration::from_millis;
        assert_eq!(waits.into_all(), BTreeMap::from([(3, ms(100)), (7, ms(14))]));
    }
}
