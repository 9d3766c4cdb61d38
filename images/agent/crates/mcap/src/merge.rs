//! Several recordings as one, and parts of them.

use std::borrow::Borrow;
use std::collections::HashMap;

use bagpipe_log::{Place, Timeline};

use crate::carry::Carrier;
use crate::{Mcap, McapError, WriterOptions};

/// What rosbag2 writes into each file of a folder about that folder.
const OF_A_FOLDER: &str = "rosbag2";

/// Messages of several recordings, read and not yet written.
#[derive(Default)]
pub(crate) struct Together<'m> {
    read: Vec<Read<'m>>,
}

/// Where the bytes of a recording's messages are, where these lie, and its channels' new numbers.
type Read<'m> = (&'m Mcap, Vec<&'m [u8]>, Vec<Place>, HashMap<u32, u32>);

impl<'m> Together<'m> {
    /// Adds messages of one more recording.
    pub fn add(&mut self, recording: &'m Mcap, of: Timeline<'m>, ids: HashMap<u32, u32>) {
        let (chunks, places) = of.into_parts();
        self.read.push((recording, chunks, places, ids));
    }

    /// Writes all by time; those of the same time in the order of the recordings and as they lie
    /// there. Returns how many.
    pub fn write(self, carrier: &mut Carrier) -> Result<u64, McapError> {
        let mut order: Vec<(u64, usize, usize)> = Vec::new();
        for (of, (_, _, places, _)) in self.read.iter().enumerate() {
            order.extend(places.iter().enumerate().map(|(at, place)| (place.time, of, at)));
        }
        order.sort_unstable();
        for (time, of, at) in &order {
            let (recording, chunks, places, ids) = &self.read[*of];
            carrier.message((recording, chunks, ids), &places[*at], *time)?;
        }
        Ok(order.len() as u64)
    }
}

/// All messages of all recordings in one, by time; messages of the same time keep the order of
/// the recordings, and of each recording's own messages. Channels that several recordings
/// declare alike (topic, type, definition, encoding, metadata) are one. Attachments and metadata
/// of all are kept, but for what rosbag2 wrote about a folder of several files.
///
/// # Errors
/// As [`Mcap::timeline`] and [`crate::McapWriter::write_stamped`].
pub fn merge<M: Borrow<Mcap>>(
    recordings: &[M],
    options: WriterOptions,
) -> Result<Vec<u8>, McapError> {
    let mut carrier = Carrier::new(options);
    let mut together = Together::default();
    for recording in recordings.iter().map(Borrow::borrow) {
        let ids = carrier.channels(recording, |_| true);
        carrier.surroundings(recording, |name| recordings.len() == 1 || name != OF_A_FOLDER)?;
        together.add(recording, recording.timeline(|_| true)?, ids);
    }
    together.write(&mut carrier)?;
    carrier.writer.finish()
}
