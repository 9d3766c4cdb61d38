//! A case, as the worker's HELLO describes it.

pub(crate) mod failure;
pub(crate) mod folder;
mod maps;

use std::collections::BTreeMap;
use std::num::NonZeroU32;
use std::time::Duration;

use bagpipe_log::Late;
use rmpv::Value;
use serde::{Deserialize, Serialize};

use crate::case::maps::{AsMap, as_map, as_maps, as_named_maps, as_some_map};

/// What to replay, into what, and for how long at most: docs/reference/hello-case.json, with which
/// tests/integration/test_hello_case.py compares it.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Case {
    pub id: String,
    #[serde(default)]
    pub job: String,
    /// What runs it, by name.
    #[serde(default, deserialize_with = "some")]
    pub engine: Option<String>,
    /// The URI of what is played.
    #[serde(default)]
    pub source: String,
    #[serde(deserialize_with = "as_map")]
    pub window: Window,
    /// Topics to play; empty: all of the bag's.
    #[serde(default)]
    pub topics: Vec<String>,
    #[serde(deserialize_with = "as_map")]
    pub stack: Stack,
    #[serde(default, deserialize_with = "as_map")]
    pub playback: Playback,
    /// What a simulator speaks on, in place of a bag.
    #[serde(default, deserialize_with = "as_some_map", skip_serializing_if = "Option::is_none")]
    pub simulator: Option<Simulator>,
    #[serde(default, deserialize_with = "as_map")]
    pub record: Record,
    #[serde(default, deserialize_with = "as_map")]
    pub deadlines: Deadlines,
    #[serde(default, deserialize_with = "as_map")]
    pub faults: Faults,
}

/// What may be left out, but not be nil.
fn some<'de, D: serde::Deserializer<'de>>(value: D) -> Result<Option<String>, D::Error> {
    String::deserialize(value).map(Some)
}

/// What the job thinks of its stack's faults.
#[derive(Debug, Clone, Default, Deserialize, Serialize)]
#[serde(default)]
pub struct Faults {
    /// Causes that end nothing.
    pub allow: Vec<String>,
}

impl Faults {
    /// Whether a cause ends nothing.
    pub fn allows(&self, cause: &str) -> bool {
        self.allow.iter().any(|allowed| allowed == cause)
    }
}

/// A simulator at the worker's end of the pipe.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Simulator {
    /// By these places STEP names its topics.
    #[serde(deserialize_with = "as_maps")]
    pub publications: Vec<Advertised>,
}

/// A topic that a simulator speaks on.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Advertised {
    pub topic: String,
    #[serde(rename = "type")]
    pub datatype: String,
    pub md5sum: String,
    pub definition: String,
    #[serde(default)]
    pub latching: bool,
    /// Whether its messages are recorded.
    #[serde(default = "yes")]
    pub recorded: bool,
}

fn yes() -> bool {
    true
}

/// Nanoseconds of bag time.
#[derive(Debug, Clone, Copy, Deserialize, Serialize)]
pub struct Window {
    pub lead_in_start: u64,
    pub start: u64,
    pub end: u64,
}

/// The software under test.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Stack {
    pub command: Vec<String>,
    #[serde(default)]
    pub environment: BTreeMap<String, String>,
    #[serde(default)]
    pub parameters: BTreeMap<String, Value>,
    #[serde(default)]
    pub remap: BTreeMap<String, String>,
    /// In ROS 2, by recorded topic.
    #[serde(default, deserialize_with = "as_named_maps")]
    pub qos: BTreeMap<String, Qos>,
    /// In ROS 2, what plays.
    #[serde(default)]
    pub player: Player,
    /// In ROS 2, nodes with a life cycle that have to be active.
    #[serde(default)]
    pub active: Vec<String>,
    /// In ROS 2, whether nodes wait for room in sockets when they publish.
    #[serde(default = "yes")]
    pub flow_control: bool,
    /// In ROS 1, whose master it is.
    #[serde(default)]
    pub master: Master,
}

/// Whose master ROS 1's nodes find: the agent's own, or the image's rosmaster.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "lowercase")]
pub enum Master {
    #[default]
    Agent,
    Image,
}

impl TryFrom<String> for Master {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "agent" => Ok(Self::Agent),
            "image" => Ok(Self::Image),
            _ => Err(format!("master is {name:?} in stack, not agent or image")),
        }
    }
}

/// How ROS 2's topics are played: by the image's librcl, on DDS alone, or as it can be.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "lowercase")]
pub enum Player {
    #[default]
    Auto,
    Rcl,
    Dds,
}

impl TryFrom<String> for Player {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "auto" => Ok(Self::Auto),
            "rcl" => Ok(Self::Rcl),
            "dds" => Ok(Self::Dds),
            _ => Err(format!("player is {name:?} in stack, not auto, rcl or dds")),
        }
    }
}

/// Quality of service that a topic is played with; `None`: as it was recorded.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(default)]
pub struct Qos {
    pub reliability: Option<Reliability>,
    pub durability: Option<Durability>,
    pub depth: Option<NonZeroU32>,
}

impl Qos {
    /// What late subscribers get.
    pub fn late(&self) -> Late {
        Late {
            latching: self.durability.map(|wanted| wanted == Durability::TransientLocal),
            depth: self.depth.map(u32::from),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "camelCase")]
pub enum Reliability {
    Reliable,
    BestEffort,
}

impl TryFrom<String> for Reliability {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "reliable" => Ok(Self::Reliable),
            "bestEffort" => Ok(Self::BestEffort),
            _ => Err(format!("reliability is {name:?} in stack.qos, not reliable or bestEffort")),
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "camelCase")]
pub enum Durability {
    Volatile,
    TransientLocal,
}

impl TryFrom<String> for Durability {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "volatile" => Ok(Self::Volatile),
            "transientLocal" => Ok(Self::TransientLocal),
            _ => {
                Err(format!("durability is {name:?} in stack.qos, not volatile or transientLocal"))
            }
        }
    }
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "lowercase")]
pub enum Mode {
    #[default]
    Realtime,
    Max,
    Lockstep,
}

impl TryFrom<String> for Mode {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "realtime" => Ok(Self::Realtime),
            "max" => Ok(Self::Max),
            "lockstep" => Ok(Self::Lockstep),
            _ => Err(format!("playback.mode is {name:?}, not realtime, max or lockstep")),
        }
    }
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(default)]
pub struct Playback {
    pub mode: Mode,
    pub rate: f64,
    /// What to wait for in lock-step.
    #[serde(deserialize_with = "as_maps")]
    pub steps: Vec<Step>,
    /// Nodes that must have subscribed to a played topic before the first message.
    pub wait_for: Vec<String>,
}

/// An input, and the answer that the next one waits for.
#[derive(Debug, Clone, Deserialize, Serialize)]
pub struct Step {
    pub trigger: String,
    pub answer: String,
    /// Seconds.
    pub deadline: f64,
    #[serde(default)]
    pub by: By,
    #[serde(default)]
    pub optional: bool,
}

#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", rename_all = "lowercase")]
pub enum By {
    #[default]
    Count,
    Stamp,
}

impl TryFrom<String> for By {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        match name.as_str() {
            "count" => Ok(Self::Count),
            "stamp" => Ok(Self::Stamp),
            _ => Err(format!("by is {name:?} in playback.steps, not count or stamp")),
        }
    }
}

impl Default for Playback {
    fn default() -> Self {
        Self { mode: Mode::Realtime, rate: 1.0, steps: Vec::new(), wait_for: Vec::new() }
    }
}

#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(default)]
pub struct Record {
    /// Regular expressions that match whole topic names.
    pub topics: Vec<String>,
    pub byte_budget: u64,
}

impl Default for Record {
    fn default() -> Self {
        Self { topics: Vec::new(), byte_budget: 1 << 30 }
    }
}

/// Seconds that each part of the case may take.
#[derive(Debug, Clone, Copy, Deserialize, Serialize)]
#[serde(default)]
pub struct Deadlines {
    /// Until the rosmaster answers.
    pub start: f64,
    /// Until the stack subscribes.
    pub subscribe: f64,
    /// For what is still under way after the last message.
    pub drain: f64,
    /// Until the stack must have ended after it was asked to.
    pub stop: f64,
    /// For everything.
    pub case: f64,
}

impl Default for Deadlines {
    fn default() -> Self {
        Self { start: 30.0, subscribe: 20.0, drain: 10.0, stop: 5.0, case: 600.0 }
    }
}

/// The longest deadline that means anything: a month.
const LONGEST: f64 = 31.0 * 24.0 * 3600.0;

impl Case {
    /// Reads the map of HELLO; the error is a sentence.
    pub fn from_value(value: Value) -> Result<Self, String> {
        if value.is_nil() {
            return Err("HELLO has no case, and an agent's slot runs the cases of a job: the \
                        fifo= of bin_piped is for a program that serves records"
                .to_owned());
        }
        let AsMap(case): AsMap<Self> = rmpv::ext::from_value(value)
            .map_err(|error| format!("the case in HELLO cannot be understood: {error}"))?;
        if case.stack.command.first().is_none_or(String::is_empty) {
            return Err(format!("case {}: stack.command is empty", case.id));
        }
        let Deadlines { start, subscribe, drain, stop, case: whole } = case.deadlines;
        for (name, seconds) in [
            ("start", start),
            ("subscribe", subscribe),
            ("drain", drain),
            ("stop", stop),
            ("case", whole),
        ] {
            if !(0.0..=LONGEST).contains(&seconds) {
                return Err(format!(
                    "case {}: deadlines.{name} is {seconds}, not 0 to {LONGEST} seconds",
                    case.id
                ));
            }
        }
        for (at, step) in case.playback.steps.iter().enumerate() {
            if !(0.0..=LONGEST).contains(&step.deadline) {
                return Err(format!(
                    "case {}: the deadline of playback.steps[{at}] ({} to {}) is {}, not 0 to \
                     {LONGEST} seconds",
                    case.id, step.trigger, step.answer, step.deadline
                ));
            }
        }
        if case.simulator.is_some() && case.playback.mode != Mode::Lockstep {
            return Err(format!("case {}: a simulator plays in lock-step only", case.id));
        }
        Ok(case)
    }

    /// True when the stack runs on the bag's time.
    pub fn use_sim_time(&self) -> bool {
        self.simulator.is_some()
            || self.stack.parameters.get("/use_sim_time") == Some(&Value::Boolean(true))
    }
}

/// Seconds as a duration; checked when the case was read.
pub fn seconds(seconds: f64) -> Duration {
    Duration::try_from_secs_f64(seconds).unwrap_or(Duration::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn map(entries: &[(&str, Value)]) -> Value {
        Value::Map(entries.iter().map(|(key, value)| ((*key).into(), value.clone())).collect())
    }

    fn minimal(command: Vec<Value>, deadlines: Value) -> Value {
        let window =
            map(&[("lead_in_start", 0.into()), ("start", 0.into()), ("end", u64::MAX.into())]);
        map(&[
            ("id", "a".into()),
            ("window", window),
            ("stack", map(&[("command", Value::Array(command))])),
            ("playback", map(&[("mode", "max".into()), ("rate", 2.into())])),
            ("deadlines", deadlines),
            ("of_a_later_version", Value::Nil),
        ])
    }

    #[test]
    fn what_is_left_out_has_defaults() {
        let case = Case::from_value(minimal(vec!["talker".into()], map(&[("stop", 2.into())])));
        let case = case.unwrap();
        assert_eq!((case.playback.mode, case.playback.rate), (Mode::Max, 2.0));
        assert_eq!((case.deadlines.stop, case.deadlines.case), (2.0, 600.0));
        assert_eq!(case.record.byte_budget, 1 << 30);
        assert_eq!(case.window.end, u64::MAX);
        assert!(!case.use_sim_time());
        assert_eq!(case.engine, None);
    }

    #[test]
    fn steps_name_their_topics_and_have_a_deadline() {
        let step = |deadline: f64, by: &str| {
            let words = [("trigger", "/a"), ("answer", "/b"), ("by", by)];
            let mut step: Vec<_> = words.iter().map(|(k, v)| (*k, Value::from(*v))).collect();
            step.push(("deadline", deadline.into()));
            let steps = Value::Array(vec![map(&step)]);
            map(&[("mode", "lockstep".into()), ("steps", steps)])
        };
        let with = |playback: Value| {
            let Value::Map(mut case) = minimal(vec!["talker".into()], map(&[])) else { panic!() };
            case.retain(|(key, _)| key.as_str() != Some("playback"));
            case.push(("playback".into(), playback));
            Case::from_value(Value::Map(case))
        };
        let playback = with(step(0.5, "stamp")).unwrap().playback;
        assert_eq!((playback.mode, playback.steps[0].by), (Mode::Lockstep, By::Stamp));
        assert!(!playback.steps[0].optional);
        let never = with(step(-1.0, "count")).unwrap_err();
        assert!(never.contains("playback.steps[0] (/a to /b) is -1, not 0 to"), "{never}");
        assert!(with(step(1.0, "luck")).unwrap_err().contains("not count or stamp"));
    }

    #[test]
    fn what_makes_no_sense_is_refused_with_a_sentence() {
        let empty = Case::from_value(minimal(vec![], map(&[]))).unwrap_err();
        assert_eq!(empty, "case a: stack.command is empty");
        let never = map(&[("start", f64::INFINITY.into())]);
        let endless = Case::from_value(minimal(vec!["x".into()], never)).unwrap_err();
        assert_eq!(endless, "case a: deadlines.start is inf, not 0 to 2678400 seconds");
        assert!(Case::from_value(7.into()).unwrap_err().starts_with("the case in HELLO"));
        assert!(Case::from_value(Value::Nil).unwrap_err().starts_with("HELLO has no case"));
    }
}
