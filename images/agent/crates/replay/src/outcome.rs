//! What a replay yields: the RESULT map's keys, and the recorded bag.

use serde::{Deserialize, Serialize};

use crate::AnswerBy;
use crate::machine::Machine;

/// A replay that was done. Serialises to the keys of the RESULT map, without the bag.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Replayed {
    /// What was delivered.
    pub ledger: Ledger,
    /// What was recorded.
    pub recorded: Recorded,
    /// How it was played.
    pub playback: Playback,
    /// How long each part took.
    pub timings: Timings,
    /// How the machine was meanwhile; `None` where nothing was played.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub machine: Option<Machine>,
    /// The recording: a bag 2.0, also when it is empty.
    #[serde(skip)]
    pub recorded_bag: Vec<u8>,
}

/// How far along its way a message is known to have come. The weakest comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Strength {
    /// It was written to the subscriber's socket; the subscriber has not reported anything.
    #[default]
    Sent,
    /// Its process has read it, and may keep it in a queue.
    Received,
    /// The node has taken it for its callback, which may still be to come.
    Taken,
    /// Its callback has run.
    Called,
}

impl Strength {
    /// Its name in RESULT.
    pub fn name(self) -> &'static str {
        match self {
            Strength::Sent => "sent",
            Strength::Received => "received",
            Strength::Taken => "taken",
            Strength::Called => "called",
        }
    }
}

/// The proof of delivery. Lossless means: for every subscriber of every topic `received`
/// equals the topic's `sent` and `dropped` is 0.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Ledger {
    /// Sum of the topics' `sent`.
    pub sent: u64,
    /// Sum of the topics' `lead_in`.
    pub lead_in: u64,
    /// Sum over the topics of what their worst subscriber received.
    pub received: u64,
    /// Sum over all subscribers of all topics.
    pub dropped: u64,
    /// The weakest of the subscribers' proofs; `None` without a subscriber.
    pub strength: Option<Strength>,
    /// Each published topic.
    pub topics: Vec<LedgerTopic>,
}

/// One published topic.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LedgerTopic {
    /// The name that it was published under.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub datatype: String,
    /// Messages of the window that were played; 0 if nobody ever subscribed.
    pub sent: u64,
    /// Messages before the window that were played; 0 if nobody ever subscribed.
    pub lead_in: u64,
    /// Every node that was connected before the last message was played.
    pub subscribers: Vec<LedgerSubscriber>,
}

/// One node's share of a topic: `received + dropped == sent`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LedgerSubscriber {
    /// The node's name.
    pub node: String,
    /// Messages of the window that came as far as `strength` says, by its own statistics.
    pub received: u64,
    /// Messages of the window that did not.
    pub dropped: u64,
    /// Bytes of messages of the window written to its socket, without length prefixes.
    pub bytes: u64,
    /// What `received` proves.
    pub strength: Strength,
    /// Messages known to wait in its queue; `None` if that can't be known.
    pub queue: Option<u64>,
    /// How long the node's threads could have run from the window's start until its messages were
    /// received, and had no processor; summed over threads, `None` if that can't be known.
    pub waited_seconds: Option<f64>,
    /// How long the play waited until it had room for more, in seconds, from the first message of the
    /// window on.
    #[serde(default)]
    pub held_up_seconds: f64,
    /// The most messages that may wait at it; `None` where no queue of its own bounds them.
    #[serde(default)]
    pub room: Option<u64>,
}

/// What was recorded.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Recorded {
    /// Messages in the bag.
    pub messages: u64,
    /// Bytes of their data.
    pub bytes: u64,
    /// The most bytes that the recording held.
    pub high_water_bytes: u64,
    /// Each recorded topic.
    pub topics: Vec<RecordedTopic>,
}

/// One recorded topic.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecordedTopic {
    /// Its name.
    pub topic: String,
    /// Its type.
    #[serde(rename = "type")]
    pub datatype: String,
    /// Messages in the bag.
    pub messages: u64,
}

/// How the window was played.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Playback {
    /// The rate that was asked for; without meaning in `max`.
    pub asked_rate: f64,
    /// Bag seconds per second, from the window's start to its last message; the asked
    /// rate if that is no time at all.
    pub achieved_rate: f64,
    /// How much later than due the latest message left, in seconds; 0 in `max`.
    pub late_max_seconds: f64,
    /// How long playing the window took, in seconds.
    pub played_seconds: f64,
    /// In lock-step, what came of each answer, the lead-in included.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub steps: Vec<StepReport>,
    /// What the user should know of the way it was played, as sentences.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// In `max`, which subscriber set the pace, as a sentence; `None` where none did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pace: Option<String>,
}

/// What came of the steps with one answer: `released == answered + no_output + skipped`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StepReport {
    /// The inputs that lead to the answer.
    pub triggers: Vec<String>,
    /// The answer's topic.
    pub answer: String,
    /// How an answer was recognised.
    pub by: AnswerBy,
    /// How often the inputs were complete, so that an answer was due.
    pub released: u64,
    /// How often it came in time.
    pub answered: u64,
    /// How often it did not.
    pub no_output: u64,
    /// How often it did not, where the input may be skipped.
    pub skipped: u64,
    /// By stamp: messages on the answer's topic that no input was waiting for.
    pub unmatched: u64,
    /// The time from the inputs' release to the answer, summed over those that came.
    pub waited_seconds: f64,
    /// The longest of these times.
    pub slowest_seconds: f64,
}

/// How long each part took, in seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Timings {
    /// Until the subscribers were there.
    pub subscribe: f64,
    /// Latched messages and warm-up, until they were received.
    pub lead_in: f64,
    /// The window.
    pub play: f64,
    /// Until the last message was received and the outputs had ended.
    pub drain: f64,
}

/// A recording's figures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Figures {
    pub(crate) messages: u64,
    /// Bytes of the messages.
    pub(crate) bytes: u64,
    /// The most bytes that the bag has had.
    pub(crate) held: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strengths_are_named_in_result_as_elsewhere_and_the_weakest_comes_first() {
        let all = [Strength::Sent, Strength::Received, Strength::Taken, Strength::Called];
        assert!(all.is_sorted());
        for strength in all {
            let name = serde_json::to_string(&strength).unwrap();
            assert_eq!(name, format!("\"{}\"", strength.name()));
        }
    }
}
