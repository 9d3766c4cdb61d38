//! A simulated world, as whoever simulates it sees it.

use crate::ReplayError;

/// What the stack said last on a topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Said {
    /// The topic.
    pub topic: String,
    /// The message's type, as its publisher names it.
    pub datatype: String,
    /// The serialised message.
    pub data: Vec<u8>,
}

/// A moment of simulated time.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Moment {
    /// Nanoseconds; later than the moment before.
    pub time: u64,
    /// In the order in which they go out: a place among the world's topics, and a frame of
    /// `u32` little-endian length and the serialised message.
    pub messages: Vec<(usize, Vec<u8>)>,
}

/// What moves on in answer to the stack.
pub trait World {
    /// The moment after `said`, which is the latest message on each answer's topic since the
    /// last turn; `None` when the world ends. May wait, and then asks `stop` now and then.
    ///
    /// # Errors
    /// Whatever ends the case; [`ReplayError::Cancelled`] after `stop` said so.
    fn next(
        &mut self,
        said: Vec<Said>,
        stop: &dyn Fn() -> bool,
    ) -> Result<Option<Moment>, ReplayError>;

    /// The topics whose messages stay out of the recording.
    fn unrecorded(&self) -> &[String] {
        &[]
    }
}
