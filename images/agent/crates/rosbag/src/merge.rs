//! Several bags as one.

use std::borrow::Borrow;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::mem;

use crate::{Bag, BagError, BagWriter, ChunkedFile, Connection, WriterOptions};

/// All messages of all bags in one bag, by time; messages of the same time keep the order of
/// the bags, and of each bag's own messages. A connection that several bags declare alike
/// (topic, type, definition, publisher, latching) is one.
pub fn merge<F: ChunkedFile, B: Borrow<Bag<F>>>(
    bags: &[B],
    options: WriterOptions,
) -> Result<Vec<u8>, BagError> {
    let mut writer = BagWriter::new(options);
    let mut known: HashMap<Key<'_>, u32> = HashMap::new();
    let mut ids: Vec<HashMap<u32, u32>> = Vec::with_capacity(bags.len());
    let mut streams = Vec::with_capacity(bags.len());
    for bag in bags.iter().map(Borrow::borrow) {
        streams.push(bag.messages(|_| true));
        let id = |each| *known.entry(key(each)).or_insert_with(|| writer.add_connection(each));
        let mut id = id;
        ids.push(bag.connections().iter().map(|each| (each.id, id(each))).collect());
    }
    // Of each bag the next message; among equal times the first bag's goes first.
    let mut heads = Vec::with_capacity(bags.len());
    let mut next = BinaryHeap::new();
    for (bag, stream) in streams.iter_mut().enumerate() {
        let head = stream.next().transpose()?;
        next.extend(head.map(|message| Reverse((message.time, bag))));
        heads.push(head);
    }
    while let Some(Reverse((_, bag))) = next.pop() {
        let following = streams[bag].next().transpose()?;
        next.extend(following.map(|message| Reverse((message.time, bag))));
        if let Some(message) = mem::replace(&mut heads[bag], following) {
            let id = ids[bag].get(&message.connection);
            let id = id.ok_or(BagError::UnknownConnection(message.connection))?;
            writer.write(*id, message.time, message.data)?;
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
