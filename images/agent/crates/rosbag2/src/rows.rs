//! When which messages of a file of SQLite were recorded, without reading one.

use std::collections::BTreeMap;

use bagpipe_log::Connection;

use crate::channel::connection;
use crate::sqlite::integer;
use crate::{Database, Rosbag2Error, TopicCount};

/// A stretch ends behind so many messages.
const MOST_MESSAGES: u64 = 256;
/// And before a message that lies so many nanoseconds from those before it.
const PAUSE: u64 = 100_000_000;

/// Messages that follow each other in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stretch {
    /// The first and the last time, in nanoseconds.
    pub times: (u64, u64),
    /// Messages for each connection id, each id once.
    pub counts: Vec<(u32, u32)>,
    /// The time of each of them, of one connection after the other; none in a file of too many.
    pub each: Vec<u64>,
}

/// What a file holds.
#[derive(Debug, Clone)]
pub struct Rows {
    /// The topics; their ids count from 1.
    pub connections: Vec<Connection>,
    /// All messages.
    pub stretches: Vec<Stretch>,
}

/// Reads the times and topics of all messages, and keeps the time of each where there are at most
/// `most_times`; `about` is what a folder's metadata says of its topics.
///
/// # Errors
/// [`Rosbag2Error::Sqlite`], [`Rosbag2Error::Database`].
pub fn rows(
    database: &Database,
    about: &[TopicCount],
    most_times: u64,
) -> Result<Rows, Rosbag2Error> {
    let topics = database.topics(about)?;
    // Planning takes no definition: one that can't be read is to be known before there are cases.
    database.definitions()?;
    let ids: BTreeMap<i64, u32> =
        topics.iter().zip(1..).map(|(topic, id)| (topic.id, id)).collect();
    let connections = topics.iter().zip(1..).map(|(topic, id)| connection(topic, id)).collect();
    let mut stretches = Stretches::new(most_times);
    each_row(database, |row, topic, time| {
        stretches.add(*ids.get(&topic).ok_or_else(|| unknown(topic, row))?, time);
        Ok(())
    })?;
    stretches.close();
    Ok(Rows { connections, stretches: stretches.whole })
}

/// Shows the place in the table, the topic's id and the time of each message.
pub(crate) fn each_row(
    database: &Database,
    mut show: impl FnMut(u64, i64, u64) -> Result<(), Rosbag2Error>,
) -> Result<(), Rosbag2Error> {
    let mut found = database.prepare("SELECT topic_id, timestamp FROM messages NOT INDEXED")?;
    let (mut rows, mut left) = (found.query([])?, database.left("messages"));
    let mut count = 0;
    while let Some(row) = rows.next()? {
        count += 1;
        left.take(row)?;
        let topic = integer(row, 0, "messages")?;
        show(count, topic, time(integer(row, 1, "messages")?, count)?)?;
    }
    Ok(())
}

/// The time of a message, by its place in the table.
pub(crate) fn time(value: i64, row: u64) -> Result<u64, Rosbag2Error> {
    u64::try_from(value).map_err(|_| {
        let table = format!("messages, row {row}");
        Rosbag2Error::database(table, format!("a time of at least 0 ns, found {value}"))
    })
}

pub(crate) fn unknown(topic: i64, row: u64) -> Rosbag2Error {
    let table = format!("messages, row {row}");
    Rosbag2Error::database(table, format!("the id of a topic, found {topic}"))
}

/// The stretches of a file, as its rows come.
struct Stretches {
    whole: Vec<Stretch>,
    open: Open,
    /// How many times may still be kept; none behind more than that.
    left: Option<u64>,
}

/// A stretch that is not whole yet.
#[derive(Default)]
struct Open {
    times: (u64, u64),
    each: BTreeMap<u32, Vec<u64>>,
    messages: u64,
}

impl Stretches {
    fn new(most_times: u64) -> Self {
        Self { whole: Vec::new(), open: Open::default(), left: Some(most_times) }
    }

    fn add(&mut self, id: u32, time: u64) {
        if !self.open.takes(time) {
            self.close();
        }
        self.open.add(id, time);
    }

    fn close(&mut self) {
        let Open { times, each, messages } = std::mem::take(&mut self.open);
        if messages == 0 {
            return;
        }
        if let Some(left) = self.left {
            self.left = left.checked_sub(messages);
            if self.left.is_none() {
                self.whole.iter_mut().for_each(|stretch| stretch.each = Vec::new());
            }
        }
        let counts = each.iter().map(|(id, times)| (*id, times.len() as u32)).collect();
        let kept = self.left.is_some();
        let each = each.into_values().filter(|_| kept).flatten().collect();
        self.whole.push(Stretch { times, counts, each });
    }
}

impl Open {
    fn takes(&self, time: u64) -> bool {
        let near = self.times.0.saturating_sub(PAUSE)..=self.times.1.saturating_add(PAUSE);
        self.messages < MOST_MESSAGES && near.contains(&time)
    }

    fn add(&mut self, id: u32, time: u64) {
        let (first, last) = if self.messages == 0 { (time, time) } else { self.times };
        self.times = (first.min(time), last.max(time));
        self.messages += 1;
        self.each.entry(id).or_default().push(time);
    }
}
