//! What the stack has answered so far, on the topics that a lock-step play waits for.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_ros1::Incoming;

use crate::pairing::Pairing;
use crate::stamp::{has_header, stamp};
use crate::time::Time;
use crate::world::Said;

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
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Heard {
    /// Messages, the warm-up's included.
    pub(crate) count: u64,
    /// The nodes that said them.
    pub(crate) publishers: BTreeSet<String>,
    /// Whether there was one without a header stamp.
    pub(crate) unstamped: bool,
    /// Their stamps, if anybody goes by them.
    pub(crate) pairing: Option<Pairing>,
}

impl Answers {
    /// Listens for these topics, each of which is once there: name and whether anybody goes by
    /// its messages' stamps.
    pub(crate) fn new<'a>(topics: impl Iterator<Item = (&'a str, bool)>) -> Answers {
        let (mut places, mut heard) = (BTreeMap::new(), Vec::new());
        for (place, (topic, stamped)) in topics.enumerate() {
            places.insert(topic.to_owned(), place);
            heard.push(Heard { pairing: stamped.then(Pairing::default), ..Heard::default() });
        }
        Answers { places, heard: Mutex::new(heard), more: Condvar::new(), latest: None }
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
        let heard = &mut all[place];
        heard.count += 1;
        let publisher = incoming.header.text("callerid");
        if !heard.publishers.contains(publisher) {
            heard.publishers.insert(publisher.to_owned());
        }
        if let Some(pairing) = &mut heard.pairing {
            let headed = has_header(incoming.header.text("message_definition"));
            match stamp(incoming.data).filter(|_| headed) {
                Some(stamp) => pairing.hear(stamp),
                None => heard.unstamped = true,
            }
        }
        drop(all);
        self.more.notify_all();
    }

    /// Looks at what was heard on a topic until now; `None` if nobody listens for it.
    pub(crate) fn of<T>(&self, topic: &str, look: impl FnOnce(&mut Heard) -> T) -> Option<T> {
        let mut all = self.heard.lock().unwrap_or_else(PoisonError::into_inner);
        self.places.get(topic).map(|place| look(&mut all[*place]))
    }

    /// Waits until what was heard on a topic satisfies, at most for `limit`; whether it did.
    pub(crate) fn wait(
        &self,
        topic: &str,
        time: &Time,
        limit: Duration,
        mut satisfied: impl FnMut(&mut Heard) -> bool,
    ) -> bool {
        let Some(&place) = self.places.get(topic) else { return false };
        let mut over = false;
        // The last look is after the last message; what satisfies is looked for once, since that
        // may use it up.
        time.wait_while(&self.heard, &self.more, limit, |all| {
            over = satisfied(&mut all[place]);
            !over
        });
        over
    }
}
