//! Several bags as one.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};

use crate::{Bag, BagError, BagWriter, ChunkedFile, Connection, WriterOptions};

/// All messages of all bags in one bag, by time; messages of the same time keep the order of
/// the bags, and of each bag's own timeline. A connection that several bags declare alike
/// (topic, type, definition, publisher, latching) is one.
pub fn merge<F: ChunkedFile>(bags: &[Bag<F>], options: WriterOptions) -> Result<Vec<u8>, BagError> {
    let mut writer = BagWriter::new(options);
    let mut known: HashMap<Key<'_>, u32> = HashMap::new();
    let mut ids: Vec<HashMap<u32, u32>> = Vec::with_capacity(bags.len());
    let mut timelines = Vec::with_capacity(bags.len());
    for bag in bags {
        timelines.push(bag.timeline(|_| true)?);
        let id = |each| *known.entry(key(each)).or_insert_with(|| writer.add_connection(each));
        let mut id = id;
        ids.push(bag.connections().iter().map(|each| (each.id, id(each))).collect());
    }
    let mut next: BinaryHeap<Reverse<(u64, usize, usize)>> = timelines
        .iter()
        .enumerate()
        .filter_map(|(bag, timeline)| Some(Reverse((timeline.time(0)?, bag, 0))))
        .collect();
    while let Some(Reverse((_, bag, place))) = next.pop() {
        if let Some(message) = timelines[bag].get(place) {
            let id = ids[bag].get(&message.connection);
            let id = id.ok_or(BagError::UnknownConnection(message.connection))?;
            writer.write(*id, message.time, message.data)?;
        }
        if let Some(time) = timelines[bag].time(place + 1) {
            next.push(Reverse((time, bag, place + 1)));
        }
    }
    writer.finish()
}

/// What makes two connections the same.
type Key<'a> = (&'a str, &'a str, &'a str, &'a str, Option<&'a str>, bool);

fn key(each: &Connection) -> Key<'_> {
    let caller = each.caller_id.as_deref();
    (&each.topic, &each.datatype, &each.md5sum, &each.definition, caller, each.latching)
}
