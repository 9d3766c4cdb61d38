//! What a damaged recording has lost.

/// What a damaged or truncated recording has lost.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Loss {
    /// Byte offset of the first damage in the file.
    pub offset: u64,
    /// Bytes that could not be used: unreadable ones, and ones that a record declares and
    /// the file lacks. None where only the end or the summary is missing.
    pub bytes: u64,
    /// Messages that are lost; `None` when nobody can know.
    pub messages: Option<u64>,
    /// What was expected there.
    pub description: String,
}

/// Losses while they are found, one after the other.
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
