//! Nodes with a life cycle that have to be active before the play, and as long as it lasts.
//!
//! A node's own service has the truth, also of one that was made active before we came. It is not
//! asked during the play, where each question is a callback of the node's: what changes then is what
//! the node publishes of its transitions. Who has answered knows of the subscription to these, which
//! was made before, so that none is missed.

use std::sync::{Mutex, MutexGuard, PoisonError};

use bagpipe_graph::GraphError;
use bagpipe_ros2player::{
    Asked, Durability, History, Player, Presence, Qos, Reliability, SubscriptionId,
};

use crate::error::failed;

/// The state of a node that does its work.
const ACTIVE: u8 = 3;
/// As nodes publish their transitions, with more room than one's life has.
const EVENTS: Qos = Qos {
    history: History::KeepLast(100),
    reliability: Reliability::Reliable,
    durability: Durability::Volatile,
    presence: Presence::NONE,
};

/// The nodes that a job names.
#[derive(Default)]
pub(crate) struct LifeCycles {
    /// Each with the subscription to its transitions.
    all: Mutex<Vec<(SubscriptionId, LifeCycle)>>,
}

#[derive(Debug)]
struct LifeCycle {
    node: String,
    known: Known,
    /// A transition that came since the node was asked last, to this state.
    since: Option<u8>,
    /// Whether the play has begun, so that it has to stay active.
    held: bool,
}

/// What is known of a node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Known {
    Nothing,
    Asked,
    State(u8),
}

impl LifeCycles {
    fn all(&self) -> MutexGuard<'_, Vec<(SubscriptionId, LifeCycle)>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Subscribes to the transitions of these nodes.
    pub(crate) fn follow(&self, player: &Player, nodes: &[String]) -> Result<(), GraphError> {
        for node in nodes {
            let topic = format!("{node}/transition_event");
            let datatype = "lifecycle_msgs/msg/TransitionEvent";
            let subscription = player.subscribe(&topic, datatype, &EVENTS).map_err(failed)?;
            self.all().push((subscription, LifeCycle::new(node)));
        }
        Ok(())
    }

    /// Takes the questions for the nodes' states on by a step, until the play has begun.
    pub(crate) fn ask(&self, player: &Player) -> Result<(), GraphError> {
        let mut all = self.all();
        for (number, (_, one)) in all.iter_mut().enumerate().filter(|(_, (_, one))| !one.held) {
            one.take(player.ask_state(number, &one.node).map_err(failed)?);
        }
        Ok(())
    }

    /// What is missing of them, as what is waited for.
    pub(crate) fn absent(&self) -> Vec<String> {
        self.all().iter().filter_map(|(_, one)| one.absent()).collect()
    }

    /// That the play begins; what is missing then, as [`LifeCycles::absent`] has it.
    pub(crate) fn hold(&self) -> Vec<String> {
        let mut all = self.all();
        all.iter_mut().for_each(|(_, one)| one.held = true);
        all.iter().filter_map(|(_, one)| one.absent()).collect()
    }

    /// Takes in a message; `None` if its subscription is none of these. Why the play is to end, if it
    /// is.
    pub(crate) fn event(&self, of: SubscriptionId, data: &[u8]) -> Option<Option<String>> {
        let mut all = self.all();
        let (_, one) = all.iter_mut().find(|(subscription, _)| *subscription == of)?;
        Some(one.event(goal(data)))
    }
}

impl LifeCycle {
    fn new(node: &str) -> LifeCycle {
        LifeCycle { node: node.to_owned(), known: Known::Nothing, since: None, held: false }
    }

    /// Takes in how far the question is. An answer that a transition has overtaken says nothing: the
    /// next one does.
    fn take(&mut self, asked: Asked) {
        match asked {
            Asked::Nobody => self.known = Known::Nothing,
            Asked::Now => {
                self.since = None;
                if self.known == Known::Nothing {
                    self.known = Known::Asked;
                }
            }
            Asked::Before => {}
            Asked::Answered(state) => self.known = Known::State(self.since.unwrap_or(state)),
        }
    }

    /// Takes in a transition to this state, or to one that can't be read.
    fn event(&mut self, goal: Option<u8>) -> Option<String> {
        let goal = goal.unwrap_or_default();
        self.since = Some(goal);
        if !matches!(self.known, Known::State(_)) {
            return None;
        }
        self.known = Known::State(goal);
        (self.held && goal != ACTIVE).then(|| {
            format!(
                "{}, which stack.ros2.active names, has left the state active: it is {}",
                self.node,
                name(goal)
            )
        })
    }

    fn absent(&self) -> Option<String> {
        let node = &self.node;
        let why = match self.known {
            Known::State(ACTIVE) => return None,
            Known::State(state) => format!("it is {}", name(state)),
            Known::Asked => format!("it does not answer on {node}/get_state"),
            Known::Nothing => format!("nobody serves {node}/get_state"),
        };
        Some(format!("{node} to be active ({why})"))
    }
}

/// How `lifecycle_msgs/msg/State` calls a state.
fn name(state: u8) -> String {
    let name = match state {
        1 => "unconfigured",
        2 => "inactive",
        ACTIVE => "active",
        4 => "finalized",
        10 => "configuring",
        11 => "cleaning up",
        12 => "shutting down",
        13 => "activating",
        14 => "deactivating",
        15 => "processing an error",
        other => return format!("in a state that has no name, {other}"),
    };
    name.to_owned()
}

/// The state that a `lifecycle_msgs/msg/TransitionEvent` in CDR leads to: behind a stamp of 8 bytes, the
/// transition and the state where it began, each a number and a text.
fn goal(data: &[u8]) -> Option<u8> {
    let (head, body) = data.split_at_checked(4)?;
    let big_endian = *head.get(1)? & 1 == 0;
    let mut at = 8_usize;
    for _ in 0..2 {
        let length = (at + 1).next_multiple_of(4);
        let bytes = body.get(length..)?.first_chunk::<4>()?;
        let length_of_text =
            if big_endian { u32::from_be_bytes(*bytes) } else { u32::from_le_bytes(*bytes) };
        at = (length + 4).checked_add(length_of_text as usize)?;
    }
    body.get(at).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A message as nodes publish it.
    fn message(start: &str, goal: u8, big_endian: bool) -> Vec<u8> {
        let number = |value: u32| {
            if big_endian { value.to_be_bytes() } else { value.to_le_bytes() }
        };
        let mut body = vec![9; 8];
        for (state, text) in [(5, "to activate"), (2, start), (goal, "x")] {
            body.push(state);
            body.resize(body.len().next_multiple_of(4), 0);
            body.extend(number(text.len() as u32 + 1));
            body.extend(text.as_bytes());
            body.push(0);
        }
        [&[0, u8::from(!big_endian), 0, 0], &body[..]].concat()
    }

    #[test]
    fn where_a_transition_leads_is_behind_texts_of_any_length() {
        for big_endian in [false, true] {
            for start in ["", "a", "ab", "abc", "inactive"] {
                let whole = message(start, 14, big_endian);
                assert_eq!(goal(&whole), Some(14), "{start}");
                // Of what is cut nothing is read beyond its end.
                for end in 0..whole.len() {
                    assert!([None, Some(14)].contains(&goal(&whole[..end])), "{end}");
                }
            }
        }
        let endless = [&[0, 1, 0, 0], &[0; 12][..], &[0xff; 8]].concat();
        assert_eq!(goal(&endless), None);
    }

    fn life_cycle(questions: &[Asked]) -> LifeCycle {
        let mut one = LifeCycle::new("/n");
        questions.iter().for_each(|asked| one.take(*asked));
        one
    }

    #[test]
    fn who_is_not_active_is_missing_with_what_is_known() {
        let absent = |questions: &[Asked]| life_cycle(questions).absent();
        let sentence = |why: &str| Some(format!("/n to be active ({why})"));
        assert_eq!(absent(&[]), sentence("nobody serves /n/get_state"));
        assert_eq!(absent(&[Asked::Now]), sentence("it does not answer on /n/get_state"));
        assert_eq!(absent(&[Asked::Now, Asked::Answered(2)]), sentence("it is inactive"));
        assert_eq!(absent(&[Asked::Now, Asked::Answered(3)]), None);
        // It is asked again, and is what it was until it answers.
        assert_eq!(absent(&[Asked::Now, Asked::Answered(3), Asked::Now, Asked::Before]), None);
        let gone = [Asked::Now, Asked::Answered(3), Asked::Nobody];
        assert_eq!(absent(&gone), sentence("nobody serves /n/get_state"));
        let odd = [Asked::Now, Asked::Answered(77)];
        assert_eq!(absent(&odd), sentence("it is in a state that has no name, 77"));
    }

    #[test]
    fn an_answer_that_a_transition_has_overtaken_does_not_count() {
        let mut one = life_cycle(&[Asked::Now]);
        assert_eq!(one.event(Some(14)), None);
        one.take(Asked::Answered(3));
        assert_eq!(one.absent().as_deref(), Some("/n to be active (it is deactivating)"));
        one.take(Asked::Now);
        one.take(Asked::Answered(3));
        assert_eq!(one.absent(), None);
    }

    #[test]
    fn leaving_ends_the_play_once_it_has_begun_and_not_before() {
        let mut one = life_cycle(&[Asked::Now, Asked::Answered(3)]);
        assert_eq!(one.event(Some(14)), None);
        assert_eq!(one.event(Some(13)), None);
        assert_eq!(one.event(Some(3)), None);
        assert_eq!(one.absent(), None);
        one.held = true;
        assert_eq!(one.event(Some(3)), None);
        let left =
            "/n, which stack.ros2.active names, has left the state active: it is deactivating";
        assert_eq!(one.event(Some(14)).as_deref(), Some(left));
        assert!(one.event(None).is_some_and(|why| why.contains("no name, 0")));
    }
}
