//! A part of a recording as a recording of its own.

use std::borrow::Borrow;
use std::collections::BTreeMap;

use bagpipe_log::Window;

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

/// At which time a slice has what was latched before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Latched {
    /// At the slice's start, where a subscriber that joined then would have got it.
    AtStart,
    /// When it was recorded.
    AsRecorded,
}

/// The messages of a window and of the connections that `wanted` keeps, by time, of recordings
/// that follow each other; before them each publisher's last latched message, because a
/// subscriber that joined at the window's start would have got it. Attachments and metadata are
/// about the whole, and stay there.
///
/// # Errors
/// As [`Mcap::timeline`] and [`crate::McapWriter::write_stamped`].
pub fn slice<M: Borrow<Mcap>>(
    recordings: &[M],
    window: Window,
    latched: Latched,
    wanted: impl Fn(&Connection) -> bool,
    options: WriterOptions,
) -> Result<Sliced, McapError> {
    let mut carrier = Carrier::new(options);
    let mut ids = Vec::with_capacity(recordings.len());
    for recording in recordings.iter().map(Borrow::borrow) {
        ids.push(carrier.channels(recording, &wanted));
    }
    let before = Window { start: 0, end: window.start };
    // By topic and publisher; a later recording's message takes the place of an earlier one's.
    let mut in_force = BTreeMap::new();
    for (of, recording) in recordings.iter().map(Borrow::borrow).enumerate() {
        let timeline = recording.timeline_within(before, |each| each.latching && wanted(each))?;
        let publishers: BTreeMap<u32, (&str, Option<&str>)> = recording
            .connections()
            .iter()
            .map(|each| (each.id, (each.topic.as_str(), each.caller_id.as_deref())))
            .collect();
        let (chunks, places) = timeline.into_parts();
        for place in places {
            let data: &[u8] = chunks[place.chunk as usize];
            let known = in_force.entry(publishers.get(&place.connection).copied());
            let found = known.or_insert((place.time, of, place, data));
            if found.0 <= place.time {
                *found = (place.time, of, place, data);
            }
        }
    }
    for (time, of, place, data) in in_force.values() {
        let recording = recordings[*of].borrow();
        let at = if latched == Latched::AtStart { window.start } else { *time };
        carrier.carried((recording, data, &ids[*of]), place, at)?;
    }
    let latched = in_force.len() as u64;
    let mut together = Together::default();
    for (recording, ids) in recordings.iter().map(Borrow::borrow).zip(ids) {
        together.add(recording, recording.timeline_within(window, &wanted)?, ids);
    }
    let messages = together.write(&mut carrier)?;
    Ok(Sliced { bytes: carrier.writer.finish()?, messages, latched })
}
