//! A span of time.

/// The times that a part of a recording holds: `start <= time < end`, in nanoseconds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// The first time that is in it.
    pub start: u64,
    /// The first time that is behind it.
    pub end: u64,
}

impl Default for Window {
    fn default() -> Self {
        Self { start: 0, end: u64::MAX }
    }
}

impl Window {
    /// Whether that time is in it.
    #[inline]
    pub fn contains(&self, time: u64) -> bool {
        self.start <= time && time < self.end
    }

    /// Whether a time from `first` to `last`, both included, may be in it.
    #[inline]
    pub fn overlaps(&self, first: u64, last: u64) -> bool {
        first < self.end && self.start <= last
    }
}
