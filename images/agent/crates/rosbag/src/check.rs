//! Whether a bag is what it says that it is.

use std::collections::BTreeMap;

use bagpipe_log::{Checked, mixed_types};

use crate::{Bag, BagError, ChunkedFile, Limits};

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
    problems.extend(mixed_types(scanned.connections()));
    Ok(Checked { messages, loss: scanned.loss().cloned(), problems })
}

fn compare<F: ChunkedFile>(indexed: &Bag<F>, scanned: &Bag<F>, problems: &mut Vec<String>) {
    let (listed, found) = (indexed.chunks(), scanned.chunks());
    if listed.is_empty() && found.is_empty() {
        return;
    }
    let by_position: BTreeMap<u64, _> = listed.iter().map(|each| (each.position, each)).collect();
    if listed.len() != found.len() {
        let (listed, found) = (listed.len(), found.len());
        problems.push(format!("the index knows {listed} chunks, and the bag holds {found}"));
    }
    for chunk in found {
        let Some(listed) = by_position.get(&chunk.position) else {
            problems.push(format!("the index has no chunk at byte {}", chunk.position));
            continue;
        };
        let mut counts = listed.counts.clone();
        counts.sort_unstable();
        if counts != chunk.counts {
            let (listed, found) = (listed.messages(), chunk.messages());
            let at = chunk.position;
            problems.push(format!(
                "the index counts {listed} messages in the chunk at byte {at}, which holds {found}"
            ));
        } else if (listed.start, listed.end) != (chunk.start, chunk.end) {
            let at = chunk.position;
            problems.push(format!("the index has wrong times for the chunk at byte {at}"));
        }
    }
}
