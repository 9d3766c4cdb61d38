//! Whether a recording is what it says that it is.

use std::collections::BTreeMap;

use crate::{Connection, Loss};

/// What a look at every record has found.
#[derive(Debug)]
pub struct Checked {
    /// Whole messages.
    pub messages: u64,
    /// What is damaged, if anything is.
    pub loss: Option<Loss>,
    /// Sentences about what contradicts itself; none for a sound recording.
    pub problems: Vec<String>,
}

impl Checked {
    /// True when nothing is lost and nothing contradicts itself.
    pub fn sound(&self) -> bool {
        self.loss.is_none() && self.problems.is_empty()
    }
}

/// A sentence for each connection of another type than its topic's first one has: no subscriber
/// can take all messages of such a topic.
pub fn mixed_types(connections: &[Connection]) -> Vec<String> {
    let mut types: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    let mut problems = Vec::new();
    let shown = |(datatype, md5sum): (&str, &str)| {
        if md5sum.is_empty() { datatype.to_owned() } else { format!("{datatype} ({md5sum})") }
    };
    for each in connections {
        let found = (&*each.datatype, &*each.md5sum);
        let first = *types.entry(&each.topic).or_insert(found);
        if first != found {
            problems.push(format!("topic {} is {} and {}", each.topic, shown(first), shown(found)));
        }
    }
    problems
}
