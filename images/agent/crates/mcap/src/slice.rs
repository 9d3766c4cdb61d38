//! A part of a recording as a recording of its own.

use std::borrow::Borrow;
use std::collections::HashMap;

use bagpipe_log::{LatchedState, Window, latchers};

use crate::carry::Carrier;
use crate::merge::Together;
use crate::{Connection, Mcap, McapError, WriterOptions};

/// A slice, and what is in it.
#[derive(Debug)]
pub struct Sliced {
    /// The recording.
    pub bytes: Vec<u8>,
    /// Messages in the window.
    pub messages: u64,
    /// Latched messages from before the window that were in force at its start; they stand
    /// first in the slice.
    pub latched: u64,
}

/// What a slice has of what was latched before it.
#[derive(Clone, Copy)]
pub struct Latched<'a> {
    /// True: when it was recorded; else at the slice's start, where a subscriber that joined then
    /// would have got it.
    pub as_recorded: bool,
    /// How many messages of a channel are in force.
    pub in_force: &'a dyn Fn(&Connection) -> u32,
}

impl Latched<'_> {
    /// As the recording says, at the slice's start.
    pub const AT_START: Self = Self { as_recorded: false, in_force: &Connection::in_force };
    /// As the recording says, at the times that it says.
    pub const AS_RECORDED: Self = Self { as_recorded: true, in_force: &Connection::in_force };
}

/// The messages of a window and of the connections that `wanted` keeps, by time, of recordings
/// that follow each other; before them what is latched and in force ([`bagpipe_log::LatchedState`]),
/// because a subscriber that joined at the window's start would have got it. Attachments and
/// metadata are about the whole, and stay there.
///
/// # Errors
/// As [`Mcap::timeline`] and [`crate::McapWriter::write_stamped`].
pub fn slice<M: Borrow<Mcap>>(
    recordings: &[M],
    window: Window,
    latched: Latched<'_>,
    wanted: impl Fn(&Connection) -> bool,
    options: WriterOptions,
) -> Result<Sliced, McapError> {
    let mut carrier = Carrier::new(options);
    let mut ids = Vec::with_capacity(recordings.len());
    for recording in recordings.iter().map(Borrow::borrow) {
        ids.push(carrier.channels(recording, &wanted));
    }
    let before = Window { start: 0, end: window.start };
    let mut in_force = LatchedState::default();
    let mut read = Vec::with_capacity(recordings.len());
    for (of, recording) in recordings.iter().map(Borrow::borrow).enumerate() {
        let connections = recording.connections();
        let latchers = latchers(connections);
        let most: HashMap<u32, u32> = connections
            .iter()
            .filter(|each| wanted(each))
            .map(|each| (each.id, (latched.in_force)(each)))
            .filter(|(_, most)| *most > 0)
            .collect();
        let timeline = recording.timeline_within(before, |each| most.contains_key(&each.id))?;
        let (chunks, places) = timeline.into_parts();
        for (at, place) in places.iter().enumerate() {
            if let Some(latcher) = latchers.get(&place.connection) {
                let most = most.get(&place.connection).copied().unwrap_or_default();
                in_force.take(latcher, most, place.time, (of, at));
            }
        }
        read.push((recording, chunks, places));
    }
    let in_force = in_force.into_messages();
    for (time, (of, at)) in &in_force {
        let (recording, chunks, places) = &read[*of];
        let time = if latched.as_recorded { *time } else { window.start };
        carrier.message((recording, chunks, &ids[*of]), &places[*at], time)?;
    }
    let latched = in_force.len() as u64;
    let mut together = Together::default();
    for (recording, ids) in recordings.iter().map(Borrow::borrow).zip(ids) {
        together.add(recording, recording.timeline_within(window, &wanted)?, ids);
    }
    let messages = together.write(&mut carrier)?;
    Ok(Sliced { bytes: carrier.writer.finish()?, messages, latched })
}
