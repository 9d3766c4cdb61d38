//! Losses while they are found.

use bagpipe_log::Loss;

/// All of them, one after the other.
#[derive(Debug, Default, Clone)]
pub(crate) struct Tally(Option<Loss>);

impl Tally {
    /// Adds one; the first names the place.
    pub fn add(&mut self, offset: usize, expected: String, bytes: u64, messages: Option<u64>) {
        match &mut self.0 {
            Some(loss) => {
                loss.bytes = loss.bytes.saturating_add(bytes);
                loss.messages = loss.messages.zip(messages).map(|(a, b)| a.saturating_add(b));
            }
            None => {
                let offset = offset as u64;
                self.0 = Some(Loss { offset, bytes, messages, description: expected });
            }
        }
    }

    /// Adds all of another, whose offsets count from `base`.
    pub fn add_all(&mut self, base: usize, other: Tally) {
        if let Some(loss) = other.0 {
            let at = base + loss.offset as usize;
            self.add(at, loss.description, loss.bytes, loss.messages);
        }
    }

    pub fn is_none(&self) -> bool {
        self.0.is_none()
    }

    pub fn as_ref(&self) -> Option<&Loss> {
        self.0.as_ref()
    }
}
