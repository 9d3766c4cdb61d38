//! How much one query may take of a file of SQLite.

use rusqlite::Row;
use rusqlite::types::ValueRef;

use crate::Rosbag2Error;

/// A row takes more than so many bytes of its page.
const LEAST_ROW: u64 = 8;
/// A text has at most so many bytes for each of the file's, which may be in UTF-16.
const BYTES_OF_A_BYTE: u64 = 2;

/// What is left of a table. Each byte of a sound file belongs to one row, and a hostile one's rows
/// may share pages, or lead in a circle.
pub(crate) struct Left {
    table: &'static str,
    size: u64,
    pub rows: u64,
    bytes: u64,
}

impl Left {
    /// All that a table in a file of that size can hold.
    pub fn of(table: &'static str, size: u64) -> Self {
        let (rows, bytes) = (size / LEAST_ROW, size.saturating_mul(BYTES_OF_A_BYTE));
        Self { table, size, rows, bytes }
    }

    /// Takes a row with what is asked of it.
    ///
    /// # Errors
    /// [`Rosbag2Error::Database`] where the file can't hold it.
    pub fn take(&mut self, row: &Row<'_>) -> Result<(), Rosbag2Error> {
        let Self { table, size, .. } = *self;
        let refused = |what: &str, most: u64| {
            let expected = format!("at most {most} {what} in a file of its size");
            Rosbag2Error::database(table, expected)
        };
        let whole = Self::of(table, size);
        self.rows = self.rows.checked_sub(1).ok_or_else(|| refused("rows", whole.rows))?;
        for at in 0..row.as_ref().column_count() {
            let taken = match row.get_ref(at)? {
                ValueRef::Text(bytes) | ValueRef::Blob(bytes) => bytes.len() as u64,
                _ => continue,
            };
            let left = self.bytes.checked_sub(taken);
            self.bytes = left.ok_or_else(|| refused("bytes of its rows", whole.bytes))?;
        }
        Ok(())
    }
}
