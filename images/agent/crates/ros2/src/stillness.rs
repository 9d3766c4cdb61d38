//! Waiting until the stack has worked off what it was sent, as far as its nodes count.

use std::collections::BTreeSet;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{
    Busy, Event, Ledger, LedgerError, Mark, ProcessId, Quiet, Strength, Waited,
};

/// How long something is waited for that may never come, while everybody sleeps: a message that a
/// queue has overwritten, or that a subscription does not match. A node that gets no processor for a
/// while, as where a container's share is used up, is none of these; what is given up is not waited
/// for again.
const DOUBTFUL: Duration = Duration::from_secs(1);
/// How long the end of a callback that may never show is waited for, while everybody sleeps: of a node
/// without tracepoints that has several threads, the last ones come back with the next message only.
const COMES_BACK: Duration = Duration::from_millis(100);
/// Of the time between two looks, which are every 20 ms, so much counts: we may have stood still.
pub(crate) const LOOK: Duration = Duration::from_millis(40);

/// What counts of the time between two looks for who waits for others: where the whole machine
/// stood still, none of them had the rest of it either.
pub(crate) fn counted(passed: Duration) -> Duration {
    passed.min(LOOK)
}

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
    given_up: BTreeSet<Whose>,
    /// Those whose callback did not end: nor is it. Of timers and services the node is not known: in
    /// its place is nothing, and in the topic's the process with how many run, of which one more is
    /// waited for.
    stuck: BTreeSet<Whose>,
}

/// For how long nobody was seen to do anything, and yet not all had come.
#[derive(Default)]
struct Doubt {
    looked: Option<Instant>,
    asleep: Duration,
}

impl Doubt {
    /// Takes in a look at a moment, and whether all slept then.
    fn look(&mut self, now: Instant, asleep: bool) -> Duration {
        let passed = self.looked.replace(now).map_or(Duration::ZERO, |before| now - before);
        if asleep {
            self.asleep += counted(passed);
        }
        self.asleep
    }
}

/// What is left to be done at a look.
#[derive(Default)]
struct Rest {
    /// All of it.
    left: BTreeSet<Whose>,
    /// Of that, what was taken already.
    called: BTreeSet<Whose>,
    /// And what may have ended unseen: all was taken, by a node that shows no end, in a process of
    /// several threads.
    hidden: BTreeSet<Whose>,
}

impl Rest {
    fn of_busy(ledger: &Ledger, busy: &[Busy]) -> Result<Rest, LedgerError> {
        let taken = |one: &&Busy| one.in_hand > 0 || one.untaken == 0;
        let silent = |one: &&Busy| one.strength != Strength::Called && one.untaken == 0;
        let several: BTreeSet<ProcessId> = match busy.iter().any(|one| silent(&one)) {
            true => ledger
                .processes()?
                .iter()
                .filter(|one| one.spinners > 1)
                .map(|one| one.id)
                .collect(),
            false => BTreeSet::new(),
        };
        let hidden = busy.iter().filter(silent).filter(|one| several.contains(&one.process));
        Ok(Rest {
            left: busy.iter().map(of_busy).collect(),
            called: busy.iter().filter(taken).map(of_busy).collect(),
            hidden: hidden.map(of_busy).collect(),
        })
    }

    /// How long nobody may do anything before no more is waited for; `None` while callbacks run.
    fn limit(&self, given_up: &BTreeSet<Whose>, stuck: &BTreeSet<Whose>) -> Option<Duration> {
        let runs = |one: &Whose| !stuck.contains(one) && !self.hidden.contains(one);
        if self.called.iter().any(runs) {
            return None;
        }
        let known = |one: &Whose| given_up.contains(one) || stuck.contains(one);
        let mut unknown = self.left.iter().filter(|one| !known(one)).peekable();
        if unknown.peek().is_none() {
            return Some(Duration::ZERO);
        }
        Some(if unknown.all(|one| self.hidden.contains(one)) { COMES_BACK } else { DOUBTFUL })
    }
}

impl Stillness {
    /// Waits until nobody has work any more; `topics` are ours with the messages that went out by
    /// now through the process `player`. A callback is waited for as long as `patience`, and what may never come for a moment,
    /// once.
    pub(crate) fn wait(
        &self,
        ledger: &Ledger,
        (player, topics): (u32, &[(String, u64)]),
        patience: Duration,
    ) -> Result<(), LedgerError> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let State { mark, sent, given_up, stuck } = &mut *state;
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
        let (mut still, mut doubt, mut rest) = (None, Doubt::default(), Rest::default());
        let over = |ledger: &Ledger| {
            rest = match ledger.quiet(before, &since)? {
                Quiet::Still(mark) => {
                    still = Some(mark);
                    // What was on its way at an earlier look has come.
                    rest = Rest::default();
                    return Ok(true);
                }
                Quiet::Working(busy) => Rest::of_busy(ledger, &busy)?,
                Quiet::Unknown(doubts) => {
                    let all = doubts.into_iter().map(|one| (one.node, one.topic));
                    Rest { left: all.collect(), ..Rest::default() }
                }
            };
            let Some(limit) = rest.limit(given_up, stuck) else {
                doubt = Doubt::default();
                return Ok(false);
            };
            Ok(limit.is_zero()
                || doubt.look(Instant::now(), ledger.all_asleep(&[player])?) >= limit)
        };
        let waited = ledger.wait(&EVENTS, &[], Instant::now() + patience, over)?;
        *mark = Some(match still {
            Some(mark) => mark,
            None => ledger.mark()?,
        });
        if waited == Waited::Late {
            stuck.extend(rest.called.iter().cloned());
        }
        given_up.extend(rest.left.difference(&rest.called).cloned());
        *sent = now;
        Ok(())
    }

    /// What was not waited for any more, as sentences.
    pub(crate) fn remarks(&self) -> Vec<String> {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let remark = |(node, topic): &Whose| {
            format!(
                "what {node} was sent on {topic} did not all come to it, so that lock-step does not \
                 wait for it: its queue or its quality of service lets messages go"
            )
        };
        let named =
            state.given_up.iter().filter(|(node, topic)| !node.is_empty() && !topic.is_empty());
        let endless = state.stuck.iter().map(|(node, topic)| {
            let whose = if node.is_empty() { topic.clone() } else { format!("{node} on {topic}") };
            format!(
                "a callback of {whose} did not end, so that lock-step does not wait for it any more"
            )
        });
        named.map(remark).chain(endless).collect()
    }
}

/// Node and topic.
type Whose = (String, String);

fn of_busy(busy: &Busy) -> Whose {
    let others =
        || format!("process {}, of {} timers and services,", busy.process.pid, busy.in_hand);
    (busy.node.clone(), busy.topic.clone().unwrap_or_else(others))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_time_in_which_all_slept_and_we_looked_makes_a_doubt() {
        let begun = Instant::now();
        let ms = Duration::from_millis;
        let mut doubt = Doubt::default();
        assert_eq!(doubt.look(begun, true), ms(0));
        assert_eq!(doubt.look(begun + ms(20), true), ms(20));
        assert_eq!(doubt.look(begun + ms(40), false), ms(20));
        assert_eq!(doubt.look(begun + ms(55), true), ms(35));
        // A machine that stood still.
        assert_eq!(doubt.look(begun + ms(5_000), true), ms(75));
    }
}
