//! Publish times beside the lengths that take half of their place.
//!
//! A message's frame is its length (u32) and its data, and MCAP has the publish time (u64)
//! before the data: its upper half makes room for the length. Nearly always a message was
//! published within two seconds of when it was recorded, so that the lower half and the other
//! time say the rest; where they don't, the upper half is kept.

/// Where in a message's record its frame begins, which is the publish time's upper half.
pub(crate) const FRAME_IN_RECORD: usize = 27;

/// The publish time of that lower half that is nearest to when the message was recorded.
pub(crate) fn nearest(log_time: u64, lower: u32) -> u64 {
    let distance = lower.wrapping_sub(log_time as u32) as i32;
    log_time.wrapping_add_signed(i64::from(distance))
}

/// The upper halves that do not follow from the nearest time, by where they lay.
#[derive(Debug, Default)]
pub(crate) struct UpperHalves(Vec<(u32, u32)>);

impl UpperHalves {
    /// Keeps that of the message whose frame begins at `start`, if need be. In the order of
    /// the frames.
    #[inline]
    pub fn keep(&mut self, start: u32, log_time: u64, publish_time: u64) {
        if nearest(log_time, publish_time as u32) != publish_time {
            self.0.push((start, (publish_time >> 32) as u32));
        }
    }

    /// Forgets all and keeps the memory.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// The publish time of the message whose frame begins at `start`.
    pub fn publish_time(&self, start: u32, log_time: u64, lower: u32) -> u64 {
        match self.0.binary_search_by_key(&start, |(at, _)| *at) {
            Ok(found) => u64::from(self.0[found].1) << 32 | u64::from(lower),
            Err(_) => nearest(log_time, lower),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{UpperHalves, nearest};

    #[test]
    fn times_come_back_whatever_they_are() {
        let second = 1_000_000_000;
        let now = 1_700_000_000 * second;
        let mut halves = UpperHalves::default();
        let pairs = [
            (now, now),
            (now, now - second),
            (now, now + 2 * second),
            (now, now - 3 * second),
            (now, 0),
            (0, now),
            (0, 0),
            (0, u64::MAX),
            (u64::MAX, 0),
            (u64::MAX, u64::MAX),
            (1 << 32, (1 << 32) - 1),
            ((1 << 32) - 1, 1 << 32),
        ];
        for (at, (log, publish)) in pairs.into_iter().enumerate() {
            halves.keep(at as u32, log, publish);
        }
        for (at, (log, publish)) in pairs.into_iter().enumerate() {
            assert_eq!(halves.publish_time(at as u32, log, publish as u32), publish, "{at}");
        }
        assert_eq!(halves.0.len(), 3, "only what is seconds away is kept: {halves:?}");
        assert_eq!(nearest(now, (now - second) as u32), now - second);
    }
}
