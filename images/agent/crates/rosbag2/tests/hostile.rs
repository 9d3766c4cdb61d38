//! Damaged and hostile folders: never a panic, never memory without a bound, always a sentence.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod circle;
mod made;

use std::path::Path;

use bagpipe_mcap::Mcap;
use bagpipe_rosbag2::{
    Database, Folder, MOST_METADATA_BYTES, Reading, Rosbag2Error, Selection, mcap_of_database,
    metadata, rows, uncompress,
};
use made::{FORMS, Form, MESSAGES, folder, messages, read, zstd};
use proptest::prelude::*;

const MEMORY: u64 = 1 << 20;
const HOW: Reading = Reading { memory: MEMORY, scanned: false };

fn refused(text: &str) -> String {
    metadata(text.as_bytes()).unwrap_err().to_string()
}

fn about(replaced: &str, by: &str) -> String {
    let text = made::metadata(6, "mcap", &["a.mcap", "b.mcap"], "FILE");
    assert!(text.contains(replaced), "{replaced} is not in\n{text}");
    text.replacen(replaced, by, 1)
}

#[test]
fn paths_that_leave_the_folder_are_refused() {
    for path in [
        "../a.mcap",
        "/etc/passwd",
        "b/../../a.mcap",
        "./a.mcap",
        "b//a.mcap",
        "..",
        "\"\"",
        "s3://other/a.mcap",
        "'a\\b.mcap'",
        "\"a\\0.mcap\"",
        "\"a\\n.mcap\"",
        "'*.mcap'",
        "'a.mcap?x'",
        "[a.mcap]",
    ] {
        let text = refused(&about("- b.mcap", &format!("- {path}")));
        assert!(text.starts_with("metadata.yaml, line "), "{path}: {text}");
        assert!(text.contains("below the folder") || text.contains("one word"), "{path}: {text}");
    }
    let text = refused(&about("- b.mcap", "- a.mcap"));
    assert!(text.contains("each file once, found a.mcap again"), "{text}");
    let text = refused(&about("    - a.mcap\n    - b.mcap\n", "    []\n"));
    assert!(text.contains("one file or more"), "{text}");
}

#[test]
fn metadata_of_another_kind_is_refused_with_the_line() {
    for (replaced, by, expected) in [
        ("version: 6", "version: 3", "line 2: expected a version of 4 to 9, found 3"),
        ("version: 6", "version: 10", "line 2: expected a version of 4 to 9, found 10"),
        ("version: 6", "version: -6", "expected a number of at least 0, found \"-6\""),
        ("version: 6", "versions: 6", "expected the key version"),
        ("identifier: mcap", "identifier: rosbag_v2", "the storage mcap or sqlite3"),
        ("mode: \"FILE\"", "mode: BLOCK", "the compression_mode file or message, found \"block\""),
        ("format: \"zstd\"", "format: lz4", "the compression_format zstd, found \"lz4\""),
        ("        name: /a", "        names: /a", "expected the key name"),
        ("rosbag2_bagfile_information", "bag", "expected the key rosbag2_bagfile_information"),
        ("  message_count: 60", "  message_count: [60]", "one word or text"),
    ] {
        let text = refused(&about(replaced, by));
        assert!(text.contains(expected), "{text}\n{expected}");
    }
    assert!(metadata(b"\xff").unwrap_err().to_string().contains("UTF-8"));
    assert!(refused("").contains("a document"));
}

#[test]
fn metadata_of_ten_megabytes_is_refused() {
    let text = about("    - b.mcap", &format!("    - b.mcap # {}", "x".repeat(10 << 20)));
    assert!(refused(&text).contains("at most 4194304 bytes"), "{}", text.len());
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("metadata.yaml"), &text).unwrap();
    let text = Folder::open(place.path(), HOW).unwrap_err().to_string();
    assert!(text.contains(&format!("found {}", MOST_METADATA_BYTES + 1)), "{text}");
}

#[test]
fn a_folder_without_a_file_names_it() {
    let place = tempfile::tempdir().unwrap();
    let text = Folder::open(place.path(), HOW).unwrap_err().to_string();
    assert!(text.starts_with("metadata.yaml: No such file"), "{text}");
    folder(place.path(), 5, "mcap", Form::Jazzy, "");
    std::fs::remove_file(place.path().join("drive_1.mcap")).unwrap();
    let text = Folder::open(place.path(), HOW).unwrap_err().to_string();
    assert!(text.starts_with("drive_1.mcap: No such file"), "{text}");
}

#[test]
fn zstd_bombs_are_bounded() {
    let zeros = vec![0; 300 << 20];
    let bomb = zstd(&zeros);
    assert!(bomb.len() < 100_000);
    let mut out = Vec::new();
    let error = uncompress(&bomb[..], &mut out, MEMORY).unwrap_err();
    assert!(error.over_memory() && out.len() as u64 <= MEMORY, "{error}");
    for (storage, ending) in [("mcap", "mcap"), ("sqlite3", "db3")] {
        let place = tempfile::tempdir().unwrap();
        folder(place.path(), 5, storage, Form::Humble, "FILE");
        std::fs::write(place.path().join(format!("drive_1.{ending}.zstd")), &bomb).unwrap();
        let error = Folder::open(place.path(), HOW).unwrap_err();
        assert!(error.over_memory(), "{error}");
        assert!(
            error.to_string().contains(&format!("drive_1.{ending}.zstd: what is in")),
            "{error}"
        );
        // Each message is within the limit, and all of them are not.
        let packed = |_: &[u8]| zstd(&zeros[..100_000]);
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join(format!("a.{ending}"));
        if storage == "mcap" {
            std::fs::write(&path, made::mcap(0..MESSAGES, packed)).unwrap();
        } else {
            made::database(&path, Form::Humble, 0..MESSAGES, packed);
        }
        let text = made::metadata(5, storage, &[&format!("a.{ending}")], "MESSAGE");
        std::fs::write(place.path().join("metadata.yaml"), text).unwrap();
        let error = Folder::open(place.path(), HOW).unwrap_err();
        assert!(error.over_memory(), "{error}");
    }
}

/// A sound file of SQLite on which these statements were run.
fn changed(statements: &str) -> Result<Vec<u8>, Rosbag2Error> {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Jazzy, 0..6, <[u8]>::to_vec);
    rusqlite::Connection::open(&path).unwrap().execute_batch(statements).unwrap();
    all_of(&path)
}

fn all_of(path: &Path) -> Result<Vec<u8>, Rosbag2Error> {
    let database = Database::open(path)?;
    let made = mcap_of_database(&database, &Selection::all(&|_| true), MEMORY);
    assert_eq!(rows(&database, &[], 1 << 20).is_ok(), made.is_ok() || is_of_data(&made));
    made
}

/// Data is not looked at by who asks for times alone.
fn is_of_data(made: &Result<Vec<u8>, Rosbag2Error>) -> bool {
    made.as_ref()
        .is_err_and(|error| error.over_memory() || error.to_string().contains("a message's bytes"))
}

#[test]
fn a_database_that_is_a_program_is_refused() {
    let endless = "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(id) AS \
                   (SELECT 1 UNION ALL SELECT id + 1 FROM n) \
                   SELECT id, 7 AS topic_id, id AS timestamp, x'00' AS data FROM n;";
    let computed = "DROP TABLE messages; CREATE TABLE messages(id INTEGER PRIMARY KEY, \
                    topic_id INTEGER, timestamp INTEGER, \
                    data BLOB GENERATED ALWAYS AS (zeroblob(1000000000)) VIRTUAL); \
                    INSERT INTO messages(topic_id, timestamp) VALUES (7, 1);";
    for (statements, expected) in [
        (endless, "messages: expected a table that is stored in the file"),
        (computed, "messages: expected columns that are stored in the file"),
        ("DROP TABLE messages;", "messages: expected this table"),
        ("ALTER TABLE messages RENAME COLUMN data TO bytes;", "messages: expected the column data"),
        (
            "UPDATE messages SET timestamp = -5 WHERE id = 3;",
            "row 3: expected a time of at least 0",
        ),
        (
            "UPDATE messages SET topic_id = 99 WHERE id = 2;",
            "row 2: expected the id of a topic, found 99",
        ),
        ("UPDATE messages SET timestamp = 'soon' WHERE id = 4;", "expected an integer, found Text"),
        (
            "UPDATE messages SET data = 'text' WHERE id = 5;",
            "row 5: expected a message's bytes, found Text",
        ),
    ] {
        let text = changed(statements).unwrap_err().to_string();
        assert!(text.contains(expected), "{text}\n{expected}");
    }
    let large = "UPDATE messages SET data = zeroblob(3000000) WHERE id = 5;";
    assert!(changed(large).unwrap_err().over_memory());
    assert!(changed("SELECT 1;").is_ok());
}

#[test]
fn tables_that_lead_in_a_circle_end_with_a_sentence() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    for table in ["topics", "messages", "message_definitions"] {
        made::database(&path, Form::Jazzy, 0..1, <[u8]>::to_vec);
        circle::in_table(&path, table);
        let text = all_of(&path).unwrap_err().to_string();
        let refused = format!("{table}: expected at most ");
        assert!(text.starts_with(&refused), "{table}: {text}");
        let text = Database::open(&path)
            .and_then(|file| rows(&file, &[], 1 << 20))
            .unwrap_err()
            .to_string();
        assert!(text.starts_with(&refused), "{table}: {text}");
        std::fs::remove_file(&path).unwrap();
    }
    made::database(&path, Form::Jazzy, 0..1, <[u8]>::to_vec);
    circle::in_schema(&path);
    let text = Database::open(&path).unwrap_err().to_string();
    assert!(text.contains("no more rows than fit in a file of its size"), "{text}");
}

#[test]
fn rows_that_share_a_text_take_no_more_than_the_file_has() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Humble, 0..6, <[u8]>::to_vec);
    let many = |column: &str| {
        format!(
            "WITH RECURSIVE n(i) AS (SELECT 100 UNION ALL SELECT i + 1 FROM n WHERE i < 3000)
             INSERT INTO topics (id, name, type, serialization_format, offered_qos_profiles)
             SELECT i, '/a', 'std_msgs/msg/String', 'cdr', {column} FROM n;"
        )
    };
    let file = rusqlite::Connection::open(&path).unwrap();
    file.execute_batch(&many("''")).unwrap();
    // What the folder's metadata says of the one name.
    let mut about = metadata(made::metadata(5, "sqlite3", &["a.db3"], "").as_bytes()).unwrap();
    assert!(rows(&Database::open(&path).unwrap(), &about.topics, 1 << 20).is_ok());
    about.topics[0].offered_qos = "x".repeat(1 << 20);
    let text =
        rows(&Database::open(&path).unwrap(), &about.topics, 1 << 20).unwrap_err().to_string();
    assert!(text.starts_with("topics: expected one row for each topic"), "{text}");
    // A column that came to the table later has one text for all rows that were there.
    let late = format!(
        "ALTER TABLE topics ADD COLUMN type_description_hash TEXT DEFAULT '{}'",
        "x".repeat(100_000)
    );
    file.execute_batch(&late).unwrap();
    let text = rows(&Database::open(&path).unwrap(), &[], 1 << 20).unwrap_err().to_string();
    assert!(text.starts_with("topics: expected at most"), "{text}");
}

#[test]
fn a_log_beside_the_file_is_not_passed_over() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Humble, 0..6, <[u8]>::to_vec);
    std::fs::write(place.path().join("a.db3-wal"), b"messages").unwrap();
    let text = Database::open(&path).unwrap_err().to_string();
    assert!(text.contains("no write-ahead log beside it"), "{text}");
}

#[test]
fn a_database_is_never_written_to() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Humble, 0..6, <[u8]>::to_vec);
    let before = std::fs::read(&path).unwrap();
    all_of(&path).unwrap();
    assert!(std::fs::read(&path).unwrap() == before);
    assert_eq!(std::fs::read_dir(place.path()).unwrap().count(), 1);
}

/// Numbers that are the same in every run.
struct Random(u64);

impl Random {
    fn below(&mut self, most: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % most as u64) as usize
    }

    /// Bytes that are cut off, or changed in up to thirty places.
    fn damaged(&mut self, sound: &[u8]) -> Vec<u8> {
        let mut bytes = sound.to_vec();
        if self.below(4) == 0 {
            bytes.truncate(self.below(bytes.len()));
            return bytes;
        }
        for _ in 0..=self.below(30) {
            let at = self.below(bytes.len());
            bytes[at] = self.below(256) as u8;
        }
        bytes
    }
}

#[test]
fn a_thousand_damaged_folders_give_messages_or_a_sentence() {
    let forms = [
        ("mcap", ""),
        ("mcap", "FILE"),
        ("mcap", "MESSAGE"),
        ("sqlite3", ""),
        ("sqlite3", "FILE"),
        ("sqlite3", "MESSAGE"),
    ];
    let (mut random, mut refused, mut lost) = (Random(0x2545_f491_4f6c_dd1d), 0, 0);
    for (storage, mode) in forms {
        let place = tempfile::tempdir().unwrap();
        folder(place.path(), 5, storage, Form::Humble, mode);
        let names: Vec<_> =
            std::fs::read_dir(place.path()).unwrap().map(|file| file.unwrap().path()).collect();
        let sound: Vec<Vec<u8>> = names.iter().map(|path| std::fs::read(path).unwrap()).collect();
        for _ in 0..170 {
            let of = random.below(names.len());
            std::fs::write(&names[of], random.damaged(&sound[of])).unwrap();
            match Folder::open(place.path(), Reading { memory: MEMORY, scanned: true }) {
                Err(error) => {
                    refused += 1;
                    assert!(error.to_string().contains(": "), "{error}");
                }
                Ok(found) => {
                    let loss = found.files.iter().any(|file| file.loss().is_some());
                    lost += usize::from(loss);
                    let all: u64 = found.files.iter().map(Mcap::message_count).sum();
                    assert!(all <= MESSAGES || loss || storage == "sqlite3", "{all}");
                }
            }
            std::fs::write(&names[of], &sound[of]).unwrap();
        }
    }
    assert!(refused > 300 && lost > 50, "{refused} refused, {lost} with a loss");
}

#[test]
fn a_thousand_damaged_databases_give_messages_or_a_sentence() {
    let place = tempfile::tempdir().unwrap();
    let sound: Vec<Vec<u8>> = FORMS
        .iter()
        .map(|form| {
            let path = place.path().join(format!("{form:?}.db3"));
            made::database(&path, *form, 0..MESSAGES, <[u8]>::to_vec);
            std::fs::read(path).unwrap()
        })
        .collect();
    let path = place.path().join("damaged.db3");
    let (mut random, mut errors) = (Random(0x9e37_79b9_7f4a_7c15), 0);
    for round in 0..1000 {
        let bytes = random.damaged(&sound[round % 3]);
        std::fs::write(&path, &bytes).unwrap();
        let made = Database::open(&path).and_then(|database| {
            rows(&database, &[], 1 << 20).ok();
            mcap_of_database(&database, &Selection::all(&|_| true), MEMORY)
        });
        match made {
            Ok(bytes) => assert!(Mcap::open(bytes).unwrap().loss().is_none()),
            Err(error) => {
                errors += 1;
                assert!(error.to_string().len() > 10, "{error}");
            }
        }
        Database::in_memory(&bytes[..], bytes.len()).ok();
    }
    assert!((500..1000).contains(&errors), "{errors}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn any_text_is_metadata_or_refused(
        at in 0..1500usize,
        removed in 0..200usize,
        text in "[-a-z0-9:&*!?{}\\[\\]#|>'\" \n]{0,40}",
    ) {
        let whole = made::metadata(9, "sqlite3", &["a.db3"], "MESSAGE");
        let (from, to) = (at.min(whole.len()), (at + removed).min(whole.len()));
        let changed = format!("{}{text}{}", &whole[..from], &whole[to..]);
        match metadata(changed.as_bytes()) {
            Ok(found) => prop_assert!(found.files.iter().all(|file| !file.starts_with('/'))),
            Err(error) => prop_assert!(error.to_string().starts_with("metadata.yaml, line ")),
        }
    }
}

#[test]
fn sound_ones_are_read_within_the_same_limit() {
    for (storage, mode) in [("mcap", "FILE"), ("mcap", "MESSAGE"), ("sqlite3", "MESSAGE")] {
        let place = tempfile::tempdir().unwrap();
        folder(place.path(), 5, storage, Form::Humble, mode);
        let found = Folder::open(place.path(), HOW).unwrap();
        assert!(read(&found.files) == messages(0..MESSAGES), "{storage} {mode}");
    }
}
