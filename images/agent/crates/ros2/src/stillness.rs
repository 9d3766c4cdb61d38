//! Waiting until the stack has worked off what it was sent, as far as its nodes count.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Event, Ledger, LedgerError, Mark, Quiet};

/// How long something is waited for that may never come: a message that a queue has overwritten, or
/// that a subscription does not match.
const DOUBTFUL: Duration = Duration::from_millis(100);

/// What moves a stack on.
const EVENTS: [Event; 3] = [Event::Taken, Event::Ended, Event::Published];

/// A stack's moments of rest.
#[derive(Default)]
pub(crate) struct Stillness {
    state: Mutex<State>,
}

#[derive(Default)]
struct State {
    mark: Option<Mark>,
    /// Messages of ours on each topic by then, in the order of the topics.
    sent: Vec<u64>,
    /// Node and topic of what did not come once: it is not waited for again.
    given_up: BTreeSet<(String, String)>,
}

impl Stillness {
    /// Waits until nobody has work any more; `topics` are ours with the messages that went out by
    /// now. A callback is waited for as long as `patience`, and what may never come for a moment,
    /// once.
    pub(crate) fn wait(
        &self,
        ledger: &Ledger,
        topics: &[(String, u64)],
        patience: Duration,
    ) -> Result<(), LedgerError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { mark, sent, given_up } = &mut *state;
        let now: Vec<u64> = topics.iter().map(|topic| topic.1).collect();
        let Some(before) = mark else {
            (*mark, *sent) = (Some(ledger.mark()?), now);
            return Ok(());
        };
        sent.resize(now.len(), 0);
        let since: Vec<(&str, u64)> = topics
            .iter()
            .zip(&*sent)
            .map(|(topic, sent)| (topic.0.as_str(), topic.1 - sent))
            .collect();
        let (mut still, mut doubtful) = (None, None);
        let mut left = BTreeSet::new();
        let over = |ledger: &Ledger| {
            left.clear();
            left = match ledger.quiet(before, &since)? {
                Quiet::Still(mark) => {
                    still = Some(mark);
                    return Ok(true);
                }
                Quiet::Working(busy)
                    if busy.iter().any(|one| one.in_hand > 0 || one.untaken == 0) =>
                {
                    doubtful = None;
                    return Ok(false);
                }
                Quiet::Working(busy) => {
                    busy.into_iter().map(|one| (one.node, one.topic.unwrap_or_default())).collect()
                }
                Quiet::Unknown(doubts) => {
                    doubts.into_iter().map(|one| (one.node, one.topic)).collect()
                }
            };
            let begun = *doubtful.get_or_insert_with(Instant::now);
            Ok(left.is_subset(given_up) || begun.elapsed() >= DOUBTFUL)
        };
        ledger.wait(&EVENTS, &[], Instant::now() + patience, over)?;
        *mark = Some(match still {
            Some(mark) => mark,
            None => ledger.mark()?,
        });
        given_up.extend(left);
        *sent = now;
        Ok(())
    }

    /// What was not waited for any more, as sentences.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let remark = |(node, topic): &(String, String)| {
            format!(
                "what {node} was sent on {topic} did not all come to it, so that lock-step does not \
                 wait for it: its queue or its quality of service lets messages go"
            )
        };
        let named =
            state.given_up.iter().filter(|(node, topic)| !node.is_empty() && !topic.is_empty());
        named.map(remark).collect()
    }
}
