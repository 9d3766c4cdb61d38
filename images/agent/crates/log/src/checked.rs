//! Whether a recording is what it says that it is.

use std::collections::BTreeMap;

use crate::{Connection, Loss, another_type};

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
    let mut types: BTreeMap<&str, &Connection> = BTreeMap::new();
    let mut problems = Vec::new();
    for each in connections {
        let first = *types.entry(&each.topic).or_insert(each);
        if let Some([one, other]) = another_type(type_of(first), type_of(each)) {
            let topic = &each.topic;
            let (one, other) = (shown(first, &one), shown(each, &other));
            problems.push(format!("topic {topic} is {one} and {other}"));
        }
    }
    problems
}

fn type_of(connection: &Connection) -> [&str; 3] {
    [&connection.datatype, &connection.md5sum, &connection.definition]
}

fn shown(connection: &Connection, what: &str) -> String {
    let datatype = &connection.datatype;
    if what.is_empty() { datatype.clone() } else { format!("{datatype} ({what})") }
}
