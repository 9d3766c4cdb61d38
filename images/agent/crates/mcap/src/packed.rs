//! Whether messages were compressed one by one.

use bagpipe_log::MessageEncoding;

use crate::reader::Room;
use crate::{Connection, Mcap};

impl Mcap {
    /// The topic of a channel whose first message in the file was compressed alone
    /// ([`bagpipe_log::MessageEncoding::is_packed`]). Chunks that can't be uncompressed within the
    /// limit are passed over.
    pub fn packed_topic(&self) -> Option<&str> {
        let mut left = self.asked(|each| each.message_encoding == MessageEncoding::Cdr);
        let mut room = Room::default();
        for at in self.holding(&left) {
            if !self.parts[at].holds(|channel| left.has(channel.into())) {
                continue;
            }
            let Ok((bytes, walked)) = self.lent(at, &mut room) else { continue };
            for place in walked.places.iter().filter(|place| left.take(place.connection)) {
                let data = &bytes[place.start as usize + 4..place.end as usize];
                if MessageEncoding::Cdr.is_packed(data) {
                    let of = |each: &&Connection| each.id == place.connection;
                    return self.connections().iter().find(of).map(|each| &*each.topic);
                }
            }
        }
        None
    }
}
