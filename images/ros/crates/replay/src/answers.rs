//! What the stack has answered so far, on the topics that a lock-step play waits for.

use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_ros::Incoming;

use crate::simulate::Said;
use crate::stamp::{has_header, stamp};

/// The answers, shared by the recorder, which hears them, and the player, which waits.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    /// Fixed from the beginning; empty unless the play is in lock-step.
    places: BTreeMap<String, usize>,
    heard: Mutex<Vec<Heard>>,
    more: Condvar,
    /// The latest message on each topic since somebody asked, if anybody ever does.
    latest: Option<Mutex<BTreeMap<String, Said>>>,
}

/// What was heard on one topic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Heard {
    /// Messages, the warm-up's included.
    pub(crate) count: u64,
    /// The latest header stamp in nanoseconds, if the messages have one.
    pub(crate) stamp: Option<u64>,
}

impl Answers {
    /// Listens for these topics.
    pub(crate) fn new<'a>(topics: impl Iterator<Item = &'a str>) -> Answers {
        let places: BTreeMap<_, _> =
            topics.enumerate().map(|(place, topic)| (topic.to_owned(), place)).collect();
        let heard = Mutex::new(vec![Heard::default(); places.values().max().map_or(0, |n| n + 1)]);
        Answers { places, heard, more: Condvar::new(), latest: None }
    }

    /// Keeps the latest message on each topic as well, for a simulator.
    pub(crate) fn keeping(self) -> Answers {
        Answers { latest: Some(Mutex::default()), ..self }
    }

    /// What was said last on each topic since this was asked before, by topic.
    pub(crate) fn take_latest(&self) -> Vec<Said> {
        let Some(latest) = &self.latest else { return Vec::new() };
        let mut latest = latest.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *latest).into_values().collect()
    }

    /// Takes a message in; others than answers are none of its business.
    pub(crate) fn hear(&self, incoming: &Incoming<'_>) {
        let Some(&place) = self.places.get(incoming.topic) else { return };
        if let Some(latest) = &self.latest {
            let said = Said {
                topic: incoming.topic.to_owned(),
                datatype: incoming.header.text("type").to_owned(),
                data: incoming.data.to_vec(),
            };
            let mut latest = latest.lock().unwrap_or_else(PoisonError::into_inner);
            latest.insert(said.topic.clone(), said);
        }
        let mut all = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        all[place].count += 1;
        if has_header(incoming.header.text("message_definition")) {
            all[place].stamp = all[place].stamp.max(stamp(incoming.data));
        }
        drop(all);
        self.more.notify_all();
    }

    /// What was heard on a topic until now.
    pub(crate) fn heard(&self, topic: &str) -> Heard {
        let all = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        self.places.get(topic).map(|place| all[*place]).unwrap_or_default()
    }

    /// Waits until what was heard on a topic satisfies, at most for `limit`; whether it did.
    pub(crate) fn wait(
        &self,
        topic: &str,
        limit: Duration,
        satisfied: impl Fn(Heard) -> bool,
    ) -> bool {
        let Some(&place) = self.places.get(topic) else { return false };
        let all = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.more.wait_timeout_while(all, limit, |all| !satisfied(all[place]));
        // A poisoned lock is as good as another: the figures are whole.
        let (all, _) = waited.unwrap_or_else(PoisonError::into_inner);
        satisfied(all[place])
    }
}
