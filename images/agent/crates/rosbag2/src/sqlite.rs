//! A file of SQLite as rosbag2 writes it, since Foxy.
//!
//! SQLite reads a hostile file without harm, but does what the file's own words ask of it: a
//! view may never end, a column may be computed, and the pages of a table may lead in a circle.
//! So the tables must be tables and the columns stored, the program that the file is read by has
//! no other words, and no query takes more than fits in the file.

use std::collections::{BTreeMap, HashMap};
use std::ffi::c_int;
use std::io::Read;
use std::path::Path;

use rusqlite::config::DbConfig;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, Row, Statement};

use crate::bounds::Left;
use crate::{MOST_METADATA_BYTES, Rosbag2Error, TopicCount};

/// What every file of SQLite begins with.
pub const SQLITE_MAGIC: &[u8; 16] = b"SQLite format 3\0";
/// SQLite's steps between two looks at how many there were.
const STEPS_AT_ONCE: u16 = 1000;
/// A row takes fewer steps, whatever is asked of it.
const STEPS_OF_A_ROW: u64 = 32;
/// And what is asked of the schema of a sound file.
const STEPS_OF_THE_SCHEMA: u64 = 1 << 20;
/// Topics, and definitions of types, that a file may have.
const MOST_NAMES: usize = 1 << 16;

/// A file that is open.
#[derive(Debug)]
pub struct Database {
    pub(crate) connection: Connection,
    /// Bytes of the file.
    pub(crate) size: u64,
}

/// A row of the table of topics.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Topic {
    pub id: i64,
    pub name: String,
    pub datatype: String,
    pub encoding: String,
    pub offered_qos: String,
    pub type_hash: String,
}

/// A definition: its language, and itself.
pub(crate) type Definition = (String, String);

impl Database {
    /// Opens a file, which is never written to. What a recorder that was killed left beside it
    /// (`-wal`) is a part of it that only SQLite's own recovery, which writes, can read.
    ///
    /// # Errors
    /// [`Rosbag2Error::Sqlite`], [`Rosbag2Error::System`], or [`Rosbag2Error::Database`] where such
    /// a file is there, or where the file does not hold rosbag2's tables.
    pub fn open(path: &Path) -> Result<Self, Rosbag2Error> {
        let size = std::fs::metadata(path)?.len();
        let mut log = path.as_os_str().to_owned();
        log.push("-wal");
        if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
            let expected = "no write-ahead log beside it, since it holds messages that are not in \
                            the file yet: open the file once by `sqlite3 FILE 'PRAGMA user_version'`";
            return Err(Rosbag2Error::database("the file", expected));
        }
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY
            | OpenFlags::SQLITE_OPEN_URI
            | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(uri(path), flags)?;
        Self::hardened(connection, size)
    }

    /// The same of `size` bytes that are read into memory.
    ///
    /// # Errors
    /// As [`Database::open`].
    pub fn in_memory(bytes: impl Read, size: usize) -> Result<Self, Rosbag2Error> {
        let mut connection = Connection::open_in_memory()?;
        connection.deserialize_read_exact("main", bytes, size, true)?;
        Self::hardened(connection, size as u64)
    }

    fn hardened(connection: Connection, size: u64) -> Result<Self, Rosbag2Error> {
        let database = Self { connection, size };
        database.bound_steps()?;
        let connection = &database.connection;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_DEFENSIVE, true)?;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_TRUSTED_SCHEMA, false)?;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_VIEW, false)?;
        connection.set_db_config(DbConfig::SQLITE_DBCONFIG_ENABLE_TRIGGER, false)?;
        // No value is longer than the file that holds it.
        let longest = i32::try_from(size.max(1 << 16)).unwrap_or(i32::MAX);
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, longest)?;
        connection.pragma_update(None, "cell_size_check", true)?;
        connection.pragma_update(None, "query_only", true)?;
        database.demand("topics", &["id", "name", "type", "serialization_format"])?;
        database.demand("messages", &["topic_id", "timestamp", "data"])?;
        Ok(database)
    }

    /// Prepares a query, which is interrupted behind more steps than the rows of a file of this
    /// size take. SQLite may read the schema for it, whose own pages may lead in a circle, so that
    /// it is not enough to count rows.
    pub(crate) fn prepare(&self, query: &str) -> Result<Statement<'_>, Rosbag2Error> {
        self.bound_steps()?;
        Ok(self.connection.prepare(query)?)
    }

    fn bound_steps(&self) -> Result<(), Rosbag2Error> {
        let mut left = STEPS_OF_THE_SCHEMA + self.left("").rows * STEPS_OF_A_ROW;
        let all_taken = move || {
            left = left.saturating_sub(u64::from(STEPS_AT_ONCE));
            left == 0
        };
        self.connection.progress_handler(c_int::from(STEPS_AT_ONCE), Some(all_taken))?;
        Ok(())
    }

    /// What one query may take of a table.
    pub(crate) fn left(&self, table: &'static str) -> Left {
        Left::of(table, self.size)
    }

    /// The columns of a table, which must be a table and have stored ones; `None` without it.
    fn columns(&self, table: &str) -> Result<Option<Vec<String>>, Rosbag2Error> {
        let mut found = self
            .prepare("SELECT type, rootpage FROM sqlite_schema WHERE lower(name) = ?1 LIMIT 2")?;
        let mut rows = found.query([table])?;
        let Some(row) = rows.next()? else { return Ok(None) };
        let stored = row.get::<_, i64>(1)? > 0 && row.get::<_, String>(0)? == "table";
        if !stored || rows.next()?.is_some() {
            return Err(Rosbag2Error::database(table, "a table that is stored in the file"));
        }
        let mut found =
            self.prepare("SELECT name, hidden FROM pragma_table_xinfo(?1) LIMIT 100")?;
        let mut rows = found.query([table])?;
        let mut columns = Vec::new();
        while let Some(row) = rows.next()? {
            if row.get::<_, i64>(1)? != 0 {
                return Err(Rosbag2Error::database(table, "columns that are stored in the file"));
            }
            columns.push(row.get::<_, String>(0)?);
        }
        Ok(Some(columns))
    }

    fn demand(&self, table: &str, names: &[&str]) -> Result<(), Rosbag2Error> {
        let Some(columns) = self.columns(table)? else {
            return Err(Rosbag2Error::database(table, "this table, which rosbag2 writes"));
        };
        match names.iter().find(|name| !columns.iter().any(|column| column == *name)) {
            None => Ok(()),
            Some(name) => Err(Rosbag2Error::database(table, format!("the column {name}"))),
        }
    }

    /// All topics, by their numbers, with what the folder's metadata says of them: early
    /// recorders wrote quality of service there alone, and its encoding is the one that rosbag2
    /// goes by.
    pub(crate) fn topics(&self, about: &[TopicCount]) -> Result<Vec<Topic>, Rosbag2Error> {
        let columns = self.columns("topics")?.unwrap_or_default();
        let or_empty = |name: &'static str| match columns.iter().any(|column| column == name) {
            true => name,
            false => "''",
        };
        let (qos, hash) = (or_empty("offered_qos_profiles"), or_empty("type_description_hash"));
        let mut found = self.prepare(&format!(
            "SELECT id, name, type, serialization_format, {qos}, {hash} FROM topics NOT INDEXED"
        ))?;
        let (mut rows, mut left) = (found.query([])?, self.left("topics"));
        let mut about = About::of(about);
        let mut topics: BTreeMap<i64, Topic> = BTreeMap::new();
        while let Some(row) = rows.next()? {
            left.take(row)?;
            let mut topic = topic(row)?;
            about.complete(&mut topic)?;
            let (id, full) = (topic.id, topics.len() >= MOST_NAMES);
            if full || topics.insert(id, topic).is_some() {
                let expected = format!("at most {MOST_NAMES} rows, each with another id");
                return Err(Rosbag2Error::database("topics", expected));
            }
        }
        Ok(topics.into_values().collect())
    }

    /// The definitions of types by their names, which files of Iron and later have.
    pub(crate) fn definitions(&self) -> Result<BTreeMap<String, Definition>, Rosbag2Error> {
        let table = "message_definitions";
        let Some(columns) = self.columns(table)? else { return Ok(BTreeMap::new()) };
        let wanted = ["topic_type", "encoding", "encoded_message_definition"];
        if !wanted.iter().all(|name| columns.iter().any(|column| column == name)) {
            return Ok(BTreeMap::new());
        }
        let mut found = self.prepare(
            "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions \
             NOT INDEXED",
        )?;
        let (mut rows, mut left) = (found.query([])?, self.left(table));
        let mut definitions = BTreeMap::new();
        while let Some(row) = rows.next()? {
            left.take(row)?;
            if definitions.len() >= MOST_NAMES {
                return Err(Rosbag2Error::database(table, format!("at most {MOST_NAMES} rows")));
            }
            let word = |at| text(row, at, table);
            definitions.insert(word(0)?, (word(1)?, word(2)?));
        }
        Ok(definitions)
    }
}

/// What the folder's metadata says of topics, each of which is one row's in a sound file.
struct About<'a> {
    topics: HashMap<&'a str, &'a TopicCount>,
    /// Bytes that rows may still take over: a text that many rows of one name take is many texts.
    left: u64,
}

impl<'a> About<'a> {
    fn of(about: &'a [TopicCount]) -> Self {
        let mut topics = HashMap::new();
        for each in about {
            topics.entry(&*each.topic).or_insert(each);
        }
        Self { topics, left: 4 * MOST_METADATA_BYTES }
    }

    /// Takes over what the row does not say, and the encoding.
    fn complete(&mut self, topic: &mut Topic) -> Result<(), Rosbag2Error> {
        let Some(known) = self.topics.get(&*topic.name) else { return Ok(()) };
        let texts = (known.offered_qos.len() + known.encoding.len()) as u64;
        self.left = self.left.checked_sub(texts).ok_or_else(|| {
            let expected = format!(
                "one row for each topic, found so many of one name that what metadata.yaml says of \
                 them is above {} bytes",
                4 * MOST_METADATA_BYTES
            );
            Rosbag2Error::database("topics", expected)
        })?;
        if topic.offered_qos.is_empty() {
            topic.offered_qos.clone_from(&known.offered_qos);
        }
        if !known.encoding.is_empty() {
            topic.encoding.clone_from(&known.encoding);
        }
        Ok(())
    }
}

fn topic(row: &Row<'_>) -> Result<Topic, Rosbag2Error> {
    let word = |at| text(row, at, "topics");
    Ok(Topic {
        id: integer(row, 0, "topics")?,
        name: word(1)?,
        datatype: word(2)?,
        encoding: word(3)?,
        offered_qos: word(4)?,
        type_hash: word(5)?,
    })
}

pub(crate) fn integer(row: &Row<'_>, at: usize, table: &str) -> Result<i64, Rosbag2Error> {
    match row.get_ref(at)? {
        ValueRef::Integer(value) => Ok(value),
        other => {
            let expected = format!("an integer, found {:?}", other.data_type());
            Err(Rosbag2Error::database(table, expected))
        }
    }
}

/// The text of a column; empty where there is none.
fn text(row: &Row<'_>, at: usize, table: &str) -> Result<String, Rosbag2Error> {
    match row.get_ref(at)? {
        ValueRef::Text(value) => Ok(String::from_utf8_lossy(value).into_owned()),
        ValueRef::Null => Ok(String::new()),
        other => {
            let expected = format!("a text, found {:?}", other.data_type());
            Err(Rosbag2Error::database(table, expected))
        }
    }
}

/// The path as SQLite's URI of a file that nobody changes: neither a lock nor a journal is sought.
fn uri(path: &Path) -> String {
    let mut uri = "file:".to_owned();
    for byte in path.as_os_str().as_encoded_bytes() {
        match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'/' | b'-' | b'_' | b'.' => {
                uri.push(char::from(*byte));
            }
            other => uri.push_str(&format!("%{other:02X}")),
        }
    }
    uri.push_str("?mode=ro&immutable=1");
    uri
}
