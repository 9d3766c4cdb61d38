//! What is in force when the counted part begins: what publishers latch, within a bound.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use bagpipe_graph::Incoming;
use bagpipe_log::Connection;

use super::connection::connection_of;
use super::failure::Failure;
use crate::ordered::settled_name;

/// A message that is latched, and whose.
type LatchedMessage = (Connection, Vec<u8>);

/// What came before the counted part, as far as it may be in force then.
pub(super) struct LatchedState {
    /// The most bytes of either kind.
    room: u64,
    /// In lock-step publishers have names that are the same in every run.
    ordered: bool,
    /// By topic and publisher, what of their messages is in force, and its bytes in all.
    latched: BTreeMap<(String, String), VecDeque<LatchedMessage>>,
    bytes: u64,
    /// Connections whose publishers latch, although their introductions have it otherwise.
    latching: BTreeSet<u64>,
    unlatched: Unlatched,
}

impl LatchedState {
    pub(super) fn within(room: u64, ordered: bool) -> LatchedState {
        LatchedState {
            room,
            ordered,
            latched: BTreeMap::new(),
            bytes: 0,
            latching: BTreeSet::new(),
            unlatched: Unlatched::default(),
        }
    }

    /// Whether its publisher latches, as far as is known.
    pub(super) fn latches(&self, incoming: &Incoming<'_>) -> bool {
        incoming.publisher.latching || self.latching.contains(&incoming.link)
    }

    /// Keeps a message that came before the counted part, where it may be in force then.
    ///
    /// # Errors
    /// All that is in force has no room.
    pub(super) fn take(&mut self, incoming: &Incoming<'_>) -> Result<(), Failure> {
        if self.latches(incoming) {
            return self.latch(connection_of(incoming), incoming.data.to_vec());
        }
        if incoming.publisher.may_latch {
            let connection = connection_of(incoming);
            self.unlatched.keep(incoming.link, connection, incoming.data, self.room);
        }
        Ok(())
    }

    /// That these connections' publishers latch after all, with what each sent last.
    ///
    /// # Errors
    /// It has no room, or had none when it came.
    pub(super) fn latch_after_all(&mut self, links: &BTreeSet<u64>) -> Result<(), Failure> {
        self.latching.extend(links);
        let mut latched = Ok(());
        for &link in links {
            let kept = match self.unlatched.take(link) {
                None => continue,
                Some(None) => Err(self.too_much()),
                Some(Some((connection, data))) => self.latch(connection, data),
            };
            latched = latched.and(kept);
        }
        latched
    }

    /// All that is in force, by topic and publisher, which is kept here no more.
    pub(super) fn release(&mut self) -> impl Iterator<Item = LatchedMessage> + use<> {
        self.unlatched = Unlatched::default();
        std::mem::take(&mut self.latched).into_values().flatten()
    }

    fn latch(&mut self, mut connection: Connection, data: Vec<u8>) -> Result<(), Failure> {
        connection.latching = true;
        let most = connection.in_force().max(1) as usize;
        let caller = connection.caller_id.clone().unwrap_or_default();
        if self.ordered {
            connection.caller_id = connection.caller_id.as_deref().map(settled_name);
        }
        let messages = self.latched.entry((connection.topic.clone(), caller)).or_default();
        self.bytes += data.len() as u64;
        messages.push_back((connection, data));
        while messages.len() > most {
            self.bytes -= messages.pop_front().map_or(0, |(_, data)| data.len() as u64);
        }
        if self.bytes > self.room { Err(self.too_much()) } else { Ok(()) }
    }

    fn too_much(&self) -> Failure {
        Failure::Budget(format!(
            "what is latched before the play is larger than the recording may be, {} bytes",
            self.room
        ))
    }
}

/// The last message of each connection that may latch; `None` for one that had no room.
#[derive(Default)]
struct Unlatched {
    last: BTreeMap<u64, Option<LatchedMessage>>,
    bytes: u64,
}

impl Unlatched {
    /// Keeps a message in the place of the last one, while all are no larger than `room` bytes.
    fn keep(&mut self, link: u64, connection: Connection, data: &[u8], room: u64) {
        self.take(link);
        let length = data.len() as u64;
        let fits = self.bytes + length <= room;
        self.bytes += if fits { length } else { 0 };
        self.last.insert(link, fits.then(|| (connection, data.to_vec())));
    }

    fn take(&mut self, link: u64) -> Option<Option<LatchedMessage>> {
        let last = self.last.remove(&link)?;
        self.bytes -= last.as_ref().map_or(0, |(_, data)| data.len() as u64);
        Some(last)
    }
}
