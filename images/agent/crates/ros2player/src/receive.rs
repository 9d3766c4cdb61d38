//! What was taken, handed over.

use std::time::{Duration, Instant};

use crate::control::ended;
use crate::layout::{RECORD_MESSAGE, RECORD_TOO_LARGE, Record};
use crate::player::LOOK;
use crate::program::lock;
use crate::ring::{self, Reader};
use crate::{Player, PlayerError, SubscriptionId};

/// A message that was taken.
#[derive(Debug)]
pub struct Received<'ring> {
    /// By which subscription.
    pub subscription: SubscriptionId,
    /// When its publisher published it by its own clock, in nanoseconds since 1970; 0 where the
    /// middleware does not say.
    pub source_timestamp: i64,
    /// The GID of its publisher as the graph has it; `None` where the middleware does not say, or its
    /// publisher had left before its first message was taken.
    pub publisher: Option<[u8; 16]>,
    /// The serialised message with its encapsulation header, where it stands in the ring. Who has
    /// this memory as well can change it meanwhile: copy it before it is judged.
    pub data: &'ring [u8],
}

impl Player {
    /// Hands over all messages that were taken by now, in the order of the takes, and returns how
    /// many; waits for the first, for `limit` at the most. Nobody else receives meanwhile.
    ///
    /// # Errors
    /// The program has ended and nothing of it is left, a message was
    /// [too large](PlayerError::TooLarge), which the next call goes on behind, a subscription can
    /// [take](PlayerError::Take) no more, or the memory is damaged.
    pub fn receive(
        &self,
        limit: Duration,
        into: &mut dyn FnMut(Received<'_>),
    ) -> Result<usize, PlayerError> {
        let until = Instant::now() + limit;
        let mut taken = lock(&self.taken);
        loop {
            let over = self.program.has_ended();
            let count = self.hand_over(&mut taken, into)?;
            if count > 0 {
                return Ok(count);
            }
            if over {
                return Err(ended(&self.program));
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(0);
            }
            taken.sleep(&self.memory, LOOK.min(left))?;
        }
    }

    fn hand_over(
        &self,
        taken: &mut Reader,
        into: &mut dyn FnMut(Received<'_>),
    ) -> Result<usize, PlayerError> {
        let mut count = 0;
        if !taken.look(&self.memory)? {
            return Ok(count);
        }
        // Whatever has put something into the ring by now was listed before.
        let known = lock(&self.subscriptions).len();
        while let Some((record, data)) = taken.next(&self.memory)? {
            if record.kind == RECORD_MESSAGE {
                if usize::from(record.endpoint) >= known {
                    let what = format!("a message of subscription {}", record.endpoint);
                    return Err(taken.damage(&self.memory, what));
                }
                into(Received {
                    subscription: SubscriptionId(record.endpoint),
                    source_timestamp: record.stamp,
                    publisher: (record.publisher != [0; 16]).then_some(record.publisher),
                    data,
                });
            }
            let trouble = (record.kind != RECORD_MESSAGE).then(|| self.trouble(record, data));
            taken.done(&self.memory, record);
            match trouble {
                Some(error) => return Err(error),
                None => count += 1,
            }
        }
        Ok(count)
    }

    /// What a record says that is no message.
    fn trouble(&self, record: Record, data: &[u8]) -> PlayerError {
        let topic = lock(&self.subscriptions).get(usize::from(record.endpoint)).cloned();
        let topic = topic.unwrap_or_else(|| "all that was subscribed to".to_owned());
        if record.kind == RECORD_TOO_LARGE {
            let most = ring::most(self.memory.room()) as u64;
            return PlayerError::TooLarge { topic, length: record.stamp.cast_unsigned(), most };
        }
        PlayerError::Take { topic, reason: String::from_utf8_lossy(data).into_owned() }
    }
}
