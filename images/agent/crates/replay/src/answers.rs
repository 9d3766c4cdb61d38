//! What the stack has answered so far, on the topics that a lock-step play waits for.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_graph::Incoming;

use crate::pairing::Pairing;
use crate::time::Time;
use crate::world::LatestMessage;

/// The answers, shared by the recorder, which receives them, and the player, which waits.
#[derive(Debug, Default)]
pub(crate) struct Answers {
    /// Fixed from the beginning; empty unless the play is in lock-step.
    places: BTreeMap<String, usize>,
    received: Mutex<Vec<ReceivedAnswers>>,
    more: Condvar,
    /// The latest message on each topic since somebody asked, if anybody ever does.
    latest: Option<Mutex<BTreeMap<String, LatestMessage>>>,
}

/// What was received on one topic.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct ReceivedAnswers {
    /// Messages, the warm-up's included.
    pub(crate) count: u64,
    /// The nodes that published them.
    pub(crate) publishers: BTreeSet<String>,
    /// Whether there was one without a header stamp.
    pub(crate) unstamped: bool,
    /// Their stamps, if anybody goes by them.
    pub(crate) pairing: Option<Pairing>,
}

impl Answers {
    /// Waits for answers on these topics, each of which is given once: its name, and whether
    /// answers are matched by their stamps.
    pub(crate) fn new<'a>(topics: impl Iterator<Item = (&'a str, bool)>) -> Answers {
        let (mut places, mut received) = (BTreeMap::new(), Vec::new());
        for (place, (topic, stamped)) in topics.enumerate() {
            places.insert(topic.to_owned(), place);
            received.push(ReceivedAnswers {
                pairing: stamped.then(Pairing::default),
                ..ReceivedAnswers::default()
            });
        }
        Answers { places, received: Mutex::new(received), more: Condvar::new(), latest: None }
    }

    /// Keeps the latest message on each topic as well, for a simulator.
    pub(crate) fn keeping(self) -> Answers {
        Answers { latest: Some(Mutex::default()), ..self }
    }

    /// The latest message on each topic since the previous call, by topic.
    pub(crate) fn take_latest(&self) -> Vec<LatestMessage> {
        let Some(latest) = &self.latest else { return Vec::new() };
        let mut latest = latest.lock().unwrap_or_else(PoisonError::into_inner);
        std::mem::take(&mut *latest).into_values().collect()
    }

    /// Takes a message in, and ignores it if it is not on an answer's topic.
    pub(crate) fn receive(&self, incoming: &Incoming<'_>) {
        let Some(&place) = self.places.get(incoming.topic) else { return };
        if let Some(latest) = &self.latest {
            let message = LatestMessage {
                topic: incoming.topic.to_owned(),
                datatype: incoming.publisher.datatype.clone(),
                data: incoming.data.to_vec(),
            };
            let mut latest = latest.lock().unwrap_or_else(PoisonError::into_inner);
            latest.insert(message.topic.clone(), message);
        }
        let mut all = self.received.lock().unwrap_or_else(PoisonError::into_inner);
        let received = &mut all[place];
        received.count += 1;
        let publisher = incoming.publisher.node.as_deref().unwrap_or_default();
        if !received.publishers.contains(publisher) {
            received.publishers.insert(publisher.to_owned());
        }
        if let Some(pairing) = &mut received.pairing {
            match incoming.publisher.read_stamp.and_then(|read| read(incoming.data)) {
                Some(stamp) => pairing.receive(stamp),
                None => received.unstamped = true,
            }
        }
        drop(all);
        self.more.notify_all();
    }

    /// Looks at what was received on a topic until now; `None` if nobody waits for its messages.
    pub(crate) fn of<T>(
        &self,
        topic: &str,
        look: impl FnOnce(&mut ReceivedAnswers) -> T,
    ) -> Option<T> {
        let mut all = self.received.lock().unwrap_or_else(PoisonError::into_inner);
        self.places.get(topic).map(|place| look(&mut all[*place]))
    }

    /// Waits until what was received on a topic satisfies, at most for `limit`; whether it did.
    pub(crate) fn wait(
        &self,
        topic: &str,
        time: &Time,
        limit: Duration,
        mut satisfied: impl FnMut(&mut ReceivedAnswers) -> bool,
    ) -> bool {
        let Some(&place) = self.places.get(topic) else { return false };
        let mut over = false;
        // The last look is after the last message; what satisfies is looked for once, since that
        // may use it up.
        time.wait_while(&self.received, &self.more, limit, |all| {
            over = satisfied(&mut all[place]);
            !over
        });
        over
    }
}

#[cfg(test)]
mod tests {
    use bagpipe_graph::Publisher;

    use super::*;

    fn from(node: Option<&str>) -> Publisher {
        Publisher {
            node: node.map(str::to_owned),
            datatype: "std_msgs/UInt8".to_owned(),
            read_stamp: Some(|data| data.first().map(|byte| u64::from(*byte))),
            ..Publisher::default()
        }
    }

    fn say(answers: &Answers, topic: &str, node: Option<&str>, data: &[u8]) {
        let publisher = &from(node);
        answers.receive(&Incoming { topic, publisher, link: 1, data });
    }

    #[test]
    fn what_is_received_is_counted_by_topic_with_its_publishers() {
        let answers = Answers::new([("/counted", false), ("/stamped", true)].into_iter());
        for (topic, node, data) in [
            ("/counted", Some("/one"), &[][..]),
            ("/counted", Some("/two"), &[1]),
            ("/counted", Some("/one"), &[2]),
            ("/stamped", None, &[3]),
            ("/nobody", Some("/one"), &[4]),
        ] {
            say(&answers, topic, node, data);
        }
        let publishers = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
        let expected = ReceivedAnswers {
            count: 3,
            publishers: publishers(&["/one", "/two"]),
            ..ReceivedAnswers::default()
        };
        assert_eq!(answers.of("/counted", |received| received.clone()), Some(expected));
        let mut pairing = Pairing::default();
        pairing.receive(3);
        let mut expected = ReceivedAnswers {
            count: 1,
            publishers: publishers(&[""]),
            unstamped: false,
            pairing: Some(pairing),
        };
        assert_eq!(answers.of("/stamped", |received| received.clone()), Some(expected.clone()));
        assert_eq!(answers.of("/nobody", |received| received.clone()), None);
        // One that is too short to have a stamp.
        say(&answers, "/stamped", None, &[]);
        (expected.count, expected.unstamped) = (2, true);
        assert_eq!(answers.of("/stamped", |received| received.clone()), Some(expected));
        assert_eq!(answers.take_latest(), []);
    }

    #[test]
    fn the_latest_message_of_each_topic_is_taken_once() {
        let answers = Answers::new([("/b", false), ("/a", false)].into_iter()).keeping();
        for (topic, data) in [("/b", 1), ("/a", 2), ("/b", 3), ("/nobody", 4)] {
            say(&answers, topic, None, &[data]);
        }
        let latest = |topic: &str, data| LatestMessage {
            topic: topic.to_owned(),
            datatype: "std_msgs/UInt8".to_owned(),
            data: vec![data],
        };
        assert_eq!(answers.take_latest(), [latest("/a", 2), latest("/b", 3)]);
        assert_eq!(answers.take_latest(), []);
        say(&answers, "/b", None, &[5]);
        assert_eq!(answers.take_latest(), [latest("/b", 5)]);
    }

    #[test]
    fn who_waits_on_a_topic_that_nobody_answers_on_learns_it_at_once() {
        let by_hand = crate::time::ByHand::new();
        let answers = Answers::new([("/a", false)].into_iter());
        let limit = Duration::from_millis(10);
        assert!(!answers.wait("/b", &by_hand.time(), limit, |_| true));
        assert_eq!(by_hand.passed(), Duration::ZERO);
        assert!(answers.wait("/a", &by_hand.time(), limit, |received| received.count == 0));
        assert!(!answers.wait("/a", &by_hand.time(), limit, |received| received.count == 1));
        assert_eq!(by_hand.passed(), limit);
    }
}
