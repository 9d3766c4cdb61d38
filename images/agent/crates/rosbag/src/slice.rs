//! A part of a bag as a bag of its own.

use std::collections::HashSet;

use bagpipe_log::{LatchedState, Window, latchers};

use crate::copy::Carrier;
use crate::unpack::unpack;
use crate::{Bag, BagError, BagWriter, ChunkedFile, Connection, WriterOptions};

/// A slice, and how it was made.
#[derive(Debug)]
pub struct Sliced {
    /// The bag.
    pub bytes: Vec<u8>,
    /// Messages in the window.
    pub messages: u64,
    /// Latched messages from before the window that were in force at its start; they stand
    /// first in the slice, at the time of its start.
    pub latched: u64,
    /// Chunks that were carried as they are, without being uncompressed.
    pub whole_chunks: usize,
}

/// The messages of a window and of the connections that `filter` keeps, in the bag's own
/// order; before them what is latched and in force ([`bagpipe_log::LatchedState`]), because a
/// subscriber that joined at the window's start would have got it.
pub fn slice<F: ChunkedFile>(
    bag: &Bag<F>,
    window: Window,
    filter: impl Fn(&Connection) -> bool,
    options: WriterOptions,
) -> Result<Sliced, BagError> {
    let wanted: HashSet<u32> =
        bag.connections.iter().filter(|each| filter(each)).map(|each| each.id).collect();
    let mut carrier = Carrier::new(bag, BagWriter::new(options));
    let latched = carry_latched(&mut carrier, bag, window.start, &wanted)?;
    let inside = |time: u64| window.contains(time);
    let mut parts = Vec::new();
    for (at, chunk) in bag.chunks.iter().enumerate() {
        if window.overlaps(chunk.start, chunk.end)
            && chunk.counts.iter().any(|(id, _)| wanted.contains(id))
        {
            let all = inside(chunk.start)
                && inside(chunk.end)
                && chunk.counts.iter().all(|(id, _)| wanted.contains(id));
            parts.push((at, all));
        }
    }
    let cut: Vec<usize> = parts.iter().filter(|(_, all)| !all).map(|(at, _)| *at).collect();
    unpack(bag, &cut);
    for (at, all) in parts {
        if !(all && carrier.whole(at)?) {
            carrier.messages(at, |id, time| inside(time) && wanted.contains(&id))?;
        }
    }
    let messages = carrier.writer.messages() - latched;
    let whole_chunks = carrier.whole;
    Ok(Sliced { bytes: carrier.writer.finish()?, messages, latched, whole_chunks })
}

/// Writes the latched messages that are in force at `start`; returns how many.
fn carry_latched<F: ChunkedFile>(
    carrier: &mut Carrier<'_, F>,
    bag: &Bag<F>,
    start: u64,
    wanted: &HashSet<u32>,
) -> Result<u64, BagError> {
    if bag.time_range().is_none_or(|(first, _)| first >= start) {
        return Ok(0);
    }
    let timeline = bag.timeline(|each| each.latching && wanted.contains(&each.id))?;
    let latchers = latchers(&bag.connections);
    let mut in_force = LatchedState::default();
    for place in timeline.between(0, start) {
        if let Some(message) = timeline.get(place)
            && let Some(connection) = bag.connection(message.connection)
            && let Some(latcher) = latchers.get(&message.connection)
        {
            in_force.take(latcher, connection.in_force(), message.time, place);
        }
    }
    let in_force = in_force.into_messages();
    for message in in_force.iter().filter_map(|(_, place)| timeline.get(*place)) {
        carrier.message(message.connection, start, message.data)?;
    }
    Ok(in_force.len() as u64)
}
