//! The schemas and channels that a recording declares, each once.

use std::collections::HashMap;

use bagpipe_log::Connection;

use crate::connection::{Type, connection};
use crate::loss::Tally;
use crate::record::{Channel, Schema};
use crate::walk::Declared;

/// All of them, in the order in which they were declared first.
#[derive(Debug, Default)]
pub(crate) struct Names {
    pub schemas: Vec<Schema>,
    pub channels: Vec<Channel>,
    /// Where each of the channels was declared.
    places: Vec<usize>,
    schema_at: HashMap<u16, usize>,
    channel_at: HashMap<u16, usize>,
}

impl Names {
    /// Adds what is declared at that byte of the file; what contradicts an earlier one is a
    /// loss, and a schema 0 is none.
    pub fn add(&mut self, offset: usize, declared: Declared, lost: &mut Tally) {
        if self.contradicts(&declared) {
            let what = match &declared {
                Declared::Schema(schema) => format!("schema {}", schema.id),
                Declared::Channel(channel) => format!("channel {}", channel.id),
            };
            lost.add(offset, format!("{what} as it was declared before"), 0, Some(0));
            return;
        }
        match declared {
            Declared::Schema(schema) if schema.id == 0 => {}
            Declared::Schema(schema) => {
                if !self.schema_at.contains_key(&schema.id) {
                    self.schema_at.insert(schema.id, self.schemas.len());
                    self.schemas.push(schema);
                }
            }
            Declared::Channel(channel) => {
                if !self.has(channel.id) {
                    self.channel_at.insert(channel.id, self.channels.len());
                    self.channels.push(channel);
                    self.places.push(offset);
                }
            }
        }
    }

    /// Whether another was declared under its number.
    pub fn contradicts(&self, declared: &Declared) -> bool {
        match declared {
            Declared::Schema(schema) => self.schema(schema.id).is_some_and(|known| known != schema),
            Declared::Channel(channel) => {
                let known = self.channel_at.get(&channel.id).and_then(|at| self.channels.get(*at));
                known.is_some_and(|known| known != channel)
            }
        }
    }

    /// Whether the channel is declared.
    pub fn has(&self, channel: u16) -> bool {
        self.channel_at.contains_key(&channel)
    }

    fn schema(&self, id: u16) -> Option<&Schema> {
        self.schema_at.get(&id).and_then(|at| self.schemas.get(*at))
    }

    /// The channels whose schema is not declared, with where they are.
    pub fn without_schema(&self) -> impl Iterator<Item = (usize, &Channel)> {
        self.places.iter().copied().zip(&self.channels).filter(|(_, each)| {
            each.schema_id != 0 && !self.schema_at.contains_key(&each.schema_id)
        })
    }

    /// The channels as whoever knows no format sees them.
    pub fn connections(&self) -> Vec<Connection> {
        let types: Vec<Type> = self.schemas.iter().map(|each| Type::of(Some(each))).collect();
        let untyped = Type::of(None);
        let of = |schema: u16| self.schema_at.get(&schema).and_then(|at| types.get(*at));
        let channels = self.channels.iter();
        channels.map(|each| connection(each, of(each.schema_id).unwrap_or(&untyped))).collect()
    }
}
