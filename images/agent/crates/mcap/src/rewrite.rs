//! A recording written again: whole, in order, and with all that the seam has no place for.

use crate::carry::Carrier;
use crate::{Mcap, McapError, WriterOptions};

/// The same messages by time, with numbers and publish times, and the same channels, metadata
/// and attachments; what was lost to damage stays lost ([`Mcap::loss`]).
///
/// # Errors
/// As [`Mcap::timeline`] and [`crate::McapWriter::write_stamped`].
pub fn rewrite(recording: &Mcap, options: WriterOptions) -> Result<Vec<u8>, McapError> {
    let mut carrier = Carrier::new(options);
    let ids = carrier.channels(recording, |_| true);
    carrier.surroundings(recording, |_| true)?;
    carrier.messages(recording, recording.timeline(|_| true)?, &ids)?;
    carrier.writer.finish()
}
