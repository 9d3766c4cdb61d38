//! A choice of channels.

/// The channels whose messages are asked for.
#[derive(Debug)]
pub(crate) struct Asked(pub Vec<bool>);

impl Asked {
    #[inline]
    pub fn has(&self, channel: u32) -> bool {
        self.0.get(channel as usize).copied().unwrap_or(false)
    }

    /// The same, for the first time alone.
    pub fn take(&mut self, channel: u32) -> bool {
        self.0.get_mut(channel as usize).is_some_and(std::mem::take)
    }
}
