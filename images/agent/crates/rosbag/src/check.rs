//! Whether a bag is what it says that it is.

use std::collections::BTreeMap;

use crate::{Bag, BagError, ChunkedFile, Connection, Limits, Loss};

/// What a look at every record has found.
#[derive(Debug)]
pub struct Checked {
    /// Whole messages.
    pub messages: u64,
    /// What is damaged, if anything is.
    pub loss: Option<Loss>,
    /// Sentences about what contradicts itself; none for a sound bag.
    pub problems: Vec<String>,
}

impl Checked {
    /// True when nothing is lost and nothing contradicts itself.
    pub fn sound(&self) -> bool {
        self.loss.is_none() && self.problems.is_empty()
    }
}

/// Reads every record of the bag, uncompresses every chunk, and compares what it finds with
/// what the index says.
pub fn check<F: ChunkedFile>(file: &F) -> Result<Checked, BagError> {
    check_limited(file, Limits::default())
}

/// [`check`] with bounded memory; what needs more is an error.
pub fn check_limited<F: ChunkedFile>(file: &F, limits: Limits) -> Result<Checked, BagError> {
    let scanned = Bag::open_unindexed_limited(file, limits)?;
    let mut problems = Vec::new();
    let messages = scanned.message_count();
    if let Some(old) = &scanned.old {
        // Where something is lost, its end and so the index may be.
        let counted = old.indexed.filter(|_| scanned.loss().is_none()).unwrap_or(messages);
        if counted != messages {
            problems
                .push(format!("the index counts {counted} messages, and the bag holds {messages}"));
        }
    } else {
        match Bag::open_by_index(file, limits) {
            Ok(Some(indexed)) => compare(&indexed, &scanned, &mut problems),
            Ok(None) => {}
            Err(error) => problems.push(format!("the index is unusable: {error}")),
        }
    }
    types(scanned.connections(), &mut problems);
    Ok(Checked { messages, loss: scanned.loss().cloned(), problems })
}

fn compare<F: ChunkedFile>(indexed: &Bag<F>, scanned: &Bag<F>, problems: &mut Vec<String>) {
    let (told, found) = (indexed.chunks(), scanned.chunks());
    if told.is_empty() && found.is_empty() {
        return;
    }
    let by_position: BTreeMap<u64, _> = told.iter().map(|each| (each.position, each)).collect();
    if told.len() != found.len() {
        let (told, found) = (told.len(), found.len());
        problems.push(format!("the index knows {told} chunks, and the bag holds {found}"));
    }
    for chunk in found {
        let Some(told) = by_position.get(&chunk.position) else {
            problems.push(format!("the index has no chunk at byte {}", chunk.position));
            continue;
        };
        let mut counts = told.counts.clone();
        counts.sort_unstable();
        if counts != chunk.counts {
            let (told, found) = (told.messages(), chunk.messages());
            let at = chunk.position;
            problems.push(format!(
                "the index counts {told} messages in the chunk at byte {at}, which holds {found}"
            ));
        } else if (told.start, told.end) != (chunk.start, chunk.end) {
            let at = chunk.position;
            problems.push(format!("the index has wrong times for the chunk at byte {at}"));
        }
    }
}

/// One topic has one type, or no subscriber can take all of its messages.
fn types(connections: &[Connection], problems: &mut Vec<String>) {
    let mut types: BTreeMap<&str, (&str, &str)> = BTreeMap::new();
    for each in connections {
        let found = (&*each.datatype, &*each.md5sum);
        let first = *types.entry(&each.topic).or_insert(found);
        if first != found {
            problems.push(format!(
                "topic {} is {} ({}) and {} ({})",
                each.topic, first.0, first.1, found.0, found.1
            ));
        }
    }
}
