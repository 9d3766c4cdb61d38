//! Latched messages that are in force at a time: what a subscriber that joins then would get.
//!
//! In ROS 1 that is each publisher's last message, and a recording names the publishers. In ROS 2
//! it is as many as a transient-local publisher's queue is deep, and a recording has one channel
//! for all publishers of a topic, with the profiles of those that the recorder knew when it began;
//! DDS does not show it their depths. So of such a channel as many are in force as its profiles
//! show at the least. Of transforms that would be too few: each of many publishers has one message,
//! which completes the others', and most come up behind the recorder.

use std::collections::HashMap;

use crate::Connection;

/// Of one channel no more are in force, whatever its publishers offered.
pub const MOST_IN_FORCE: u32 = 1000;
/// So many of a channel of transforms whose publishers are not named.
pub const TRANSFORMS_IN_FORCE: u32 = 100;

/// What a job sets of a topic in place of what was recorded; `None`: as recorded.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Late {
    /// Whether late subscribers get earlier messages.
    pub latching: Option<bool>,
    /// How many of them.
    pub depth: Option<u32>,
}

impl Late {
    /// How many messages are in force of a channel that has so many `as_recorded`.
    pub fn in_force(self, as_recorded: u32) -> u32 {
        match self.latching {
            Some(false) => 0,
            None if as_recorded == 0 => 0,
            _ => self.depth.unwrap_or(as_recorded.max(1)),
        }
    }
}

impl Connection {
    /// How many of its last messages a subscriber that joins late gets; 0 where it does not latch.
    pub fn in_force(&self) -> u32 {
        if !self.latching {
            return 0;
        }
        let offered = self.offered_qos.as_deref().map(latched_depths).unwrap_or_default();
        let known = match self.caller_id {
            // The profiles are those of all publishers, of whom this is one.
            Some(_) => offered.into_iter().max().unwrap_or(1),
            None => offered.into_iter().fold(0, u32::saturating_add),
        };
        let transforms = matches!(&*self.datatype, "tf2_msgs/TFMessage" | "tf2_msgs/msg/TFMessage");
        let least = if transforms && self.caller_id.is_none() { TRANSFORMS_IN_FORCE } else { 1 };
        known.clamp(least, MOST_IN_FORCE)
    }
}

/// The depth of each transient-local profile in `offered_qos_profiles`, 1 where it is not known.
pub fn latched_depths(profiles: &str) -> Vec<u32> {
    let mut found: Vec<Offered> = Vec::new();
    for line in profiles.lines() {
        let line = line.trim_start();
        if line.starts_with('-') {
            found.push(Offered::default());
        }
        let Some((key, value)) = line.trim_start_matches(['-', ' ']).split_once(':') else {
            continue;
        };
        // Profiles that are no list are one.
        if found.is_empty() {
            found.push(Offered::default());
        }
        let Some(profile) = found.last_mut() else { continue };
        let value = value.trim().trim_matches(['"', '\'']);
        // Numbers until rosbag2 of Iron, words since.
        match key.trim() {
            "durability" => profile.transient_local = matches!(value, "1" | "transient_local"),
            "history" => profile.keeps_all = matches!(value, "2" | "keep_all"),
            "depth" => profile.depth = value.parse().unwrap_or_default(),
            _ => {}
        }
    }
    found.iter().filter(|profile| profile.transient_local).map(Offered::kept).collect()
}

#[derive(Default)]
struct Offered {
    transient_local: bool,
    keeps_all: bool,
    depth: u32,
}

impl Offered {
    fn kept(&self) -> u32 {
        if self.keeps_all { MOST_IN_FORCE } else { self.depth.max(1) }
    }
}

/// Whose latched message takes the place of whose: topic and name; where no name was recorded the
/// channel's profiles, and which one it is of those that are alike in its recording.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Latcher {
    topic: String,
    name: Result<String, (Option<String>, usize)>,
}

/// The publishers of a recording's connections, which are the same in recordings that follow it.
pub fn latchers(connections: &[Connection]) -> HashMap<u32, Latcher> {
    let mut alike: HashMap<(&str, Option<&str>), usize> = HashMap::new();
    let latcher = |each: &'_ Connection, before: usize| Latcher {
        topic: each.topic.clone(),
        name: each.caller_id.clone().ok_or_else(|| (each.offered_qos.clone(), before)),
    };
    let mut found = HashMap::new();
    for each in connections {
        let before = alike.entry((&each.topic, each.offered_qos.as_deref())).or_default();
        found.insert(each.id, latcher(each, *before));
        *before += usize::from(each.caller_id.is_none());
    }
    found
}

/// Keeps of messages that come in order of time what is in force behind the last of them.
#[derive(Debug)]
pub struct LatchedState<T> {
    found: HashMap<Latcher, (u32, Vec<(u64, T)>)>,
}

impl<T> Default for LatchedState<T> {
    fn default() -> Self {
        Self { found: HashMap::new() }
    }
}

impl<T> LatchedState<T> {
    /// Takes in a message of a publisher of whom `most` are in force.
    pub fn take(&mut self, from: &Latcher, most: u32, time: u64, message: T) {
        if most == 0 {
            return;
        }
        let (kept, messages) = match self.found.get_mut(from) {
            Some(known) => known,
            None => self.found.entry(from.clone()).or_default(),
        };
        *kept = most.max(*kept);
        messages.push((time, message));
        // Seldom, so that each message is moved about once.
        if messages.len() >= 2 * *kept as usize + 16 {
            cut(messages, *kept);
        }
    }

    /// What is in force, by time; messages of the same time as they came.
    pub fn into_messages(self) -> Vec<(u64, T)>
    where
        T: Ord,
    {
        let mut all = Vec::new();
        for (kept, mut messages) in self.found.into_values() {
            cut(&mut messages, kept);
            all.append(&mut messages);
        }
        all.sort_unstable();
        all
    }
}

/// Leaves the last ones by time; of the same time those that came last.
fn cut<T>(messages: &mut Vec<(u64, T)>, kept: u32) {
    messages.sort_by_key(|(time, _)| *time);
    let first = messages.len().saturating_sub(kept as usize);
    messages.drain(..first);
}
