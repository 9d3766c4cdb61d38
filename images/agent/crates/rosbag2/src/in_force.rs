//! Which messages of a file of SQLite are latched and in force at a time, without reading one.

use std::collections::{BTreeMap, BTreeSet};

use bagpipe_log::{LatchedState, Latcher, latchers};

use crate::channel::connection;
use crate::rows::each_row;
use crate::sqlite::Topic;
use crate::{Database, Rosbag2Error, Selection};

/// The places in the table of what is in force at the start of a selection's window: a topic that
/// latches may have a history far larger than that.
pub(crate) fn rows_in_force(
    database: &Database,
    topics: &[Topic],
    selection: &Selection<'_>,
) -> Result<BTreeSet<u64>, Rosbag2Error> {
    let most = most_in_force(topics, selection);
    let start = selection.window.start;
    if start == 0 || most.is_empty() {
        return Ok(BTreeSet::new());
    }
    let mut state = LatchedState::default();
    each_row(database, |row, topic, time| {
        if time < start
            && let Some((latcher, most)) = most.get(&topic)
        {
            state.take(latcher, *most, time, row);
        }
        Ok(())
    })?;
    Ok(state.into_messages().into_iter().map(|(_, row)| row).collect())
}

/// How many messages of which publisher a late subscriber gets, by the ids of wanted topics.
fn most_in_force(topics: &[Topic], selection: &Selection<'_>) -> BTreeMap<i64, (Latcher, u32)> {
    let connections: Vec<_> =
        topics.iter().zip(1..).map(|(topic, id)| connection(topic, id)).collect();
    let mut latchers = latchers(&connections);
    let found = topics.iter().zip(&connections).filter_map(|(topic, connection)| {
        let most = (selection.late)(&topic.name).in_force(connection.in_force());
        let wanted = most > 0 && (selection.topics)(&topic.name);
        wanted.then(|| Some((topic.id, (latchers.remove(&connection.id)?, most))))?
    });
    found.collect()
}
