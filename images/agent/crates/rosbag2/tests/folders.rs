//! Folders of every version, storage and compression are the same recording.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod made;

use std::path::{Path, PathBuf};

use bagpipe_log::{Late, MessageEncoding, SchemaEncoding, Window};
use bagpipe_mcap::Mcap;
use bagpipe_rosbag2::{
    Database, Folder, Reading, Selection, Storage, Stretch, mcap_of_database, metadata, rows,
};
use made::{FORMS, Form, LATCHED, MESSAGES, folder, messages, read};

const HOW: Reading = Reading { memory: 1 << 30, scanned: false };

#[test]
fn every_storage_version_and_compression_gives_the_same_messages() {
    for (storage, version, form, mode) in [
        ("mcap", 5, Form::Jazzy, ""),
        ("mcap", 9, Form::Jazzy, ""),
        ("mcap", 6, Form::Jazzy, "FILE"),
        ("mcap", 8, Form::Jazzy, "MESSAGE"),
        ("sqlite3", 4, Form::Foxy, ""),
        ("sqlite3", 5, Form::Humble, "MESSAGE"),
        ("sqlite3", 7, Form::Humble, "FILE"),
        ("sqlite3", 9, Form::Jazzy, ""),
    ] {
        let place = tempfile::tempdir().unwrap();
        folder(place.path(), version, storage, form, mode);
        let Folder { metadata, files } = Folder::open(place.path(), HOW).unwrap();
        let what = format!("{storage} {version} {form:?} {mode}");
        assert_eq!((metadata.version, metadata.messages), (version, MESSAGES), "{what}");
        assert_eq!(metadata.topics.len(), 3, "{what}");
        assert_eq!(metadata.topics[2].offered_qos, LATCHED, "{what}");
        assert_eq!(files.len(), 2, "{what}");
        assert!(read(&files) == messages(0..MESSAGES), "{what}");
        for each in files.iter().flat_map(Mcap::connections) {
            assert_eq!(each.message_encoding, MessageEncoding::Cdr, "{what}");
            assert_eq!(each.latching, each.topic == "/map", "{what}");
            let defined = storage == "mcap" || form == Form::Jazzy;
            assert_eq!(each.schema_encoding == SchemaEncoding::Ros2Msg, defined, "{what}");
            assert_eq!(&*each.definition == "string data\n", defined, "{what}");
        }
    }
}

#[test]
fn a_file_that_was_unpacked_does_not_state_any_more_that_it_is_compressed() {
    let place = tempfile::tempdir().unwrap();
    folder(place.path(), 8, "mcap", Form::Jazzy, "MESSAGE");
    let text = std::fs::read_to_string(place.path().join("metadata.yaml")).unwrap();
    let own = bagpipe_mcap::Metadata {
        name: "rosbag2".to_owned(),
        entries: [("serialized_metadata".to_owned(), text)].into(),
    };
    let about = bagpipe_mcap::Metadata { name: "drive".to_owned(), ..own.clone() };
    let path = place.path().join("drive_0.mcap");
    let stored = Mcap::open(std::fs::read(&path).unwrap()).unwrap();
    let mut writer = bagpipe_mcap::McapWriter::new(bagpipe_mcap::WriterOptions::default());
    writer.describe(&own).unwrap();
    writer.describe(&about).unwrap();
    let id = writer.add_channel(None, &stored.channels()[0]);
    writer.write(id, 1, &made::zstd(b"\0\x01\0\0")).unwrap();
    std::fs::write(&path, writer.finish().unwrap()).unwrap();
    let Folder { files, .. } = Folder::open(place.path(), HOW).unwrap();
    assert_eq!(files[0].metadata(), [about]);
    assert_eq!(files[0].timeline(|_| true).unwrap().get(0).unwrap().data, b"\0\x01\0\0");
}

#[test]
fn a_type_s_hash_is_where_rosbag2_s_mcap_has_it() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Jazzy, 0..3, <[u8]>::to_vec);
    rusqlite::Connection::open(&path)
        .unwrap()
        .execute("UPDATE topics SET type_description_hash = 'RIHS01_ab' WHERE name = '/a'", [])
        .unwrap();
    let bytes =
        mcap_of_database(&Database::open(&path).unwrap(), &Selection::all(&|_| true), 1 << 20);
    let file = Mcap::open(bytes.unwrap()).unwrap();
    let hash = |at: usize| file.channels()[at].metadata.get("topic_type_hash").cloned();
    assert_eq!((hash(0).as_deref(), hash(1)), (Some("RIHS01_ab"), None));
}

#[test]
fn a_part_of_a_database_has_what_was_in_force_before_it() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a file ?#%.db3");
    made::database(&path, Form::Humble, 0..MESSAGES, <[u8]>::to_vec);
    let all = messages(0..MESSAGES);
    let window = Window { start: all[20].3, end: all[30].3 };
    let topics = |topic: &str| topic != "/b";
    let before = |topic: &str, most: usize| {
        let found = all.iter().rev().filter(|each| each.0 == topic && each.3 < window.start);
        found.take(most).cloned().collect::<Vec<_>>()
    };
    let within = all.iter().filter(|each| window.contains(each.3) && each.0 != "/b");
    let read_as = |late: &dyn Fn(&str) -> Late| {
        let selection = Selection { window, late, ..Selection::all(&topics) };
        let bytes = mcap_of_database(&Database::open(&path).unwrap(), &selection, 1 << 20);
        read(&[Mcap::open(bytes.unwrap()).unwrap()])
    };
    let as_recorded = read_as(&|_| Late::default());
    let with = |mut latched: Vec<made::Plain>| {
        latched.extend(within.clone().cloned());
        latched.sort_by_key(|each| each.3);
        latched
    };
    assert_eq!(before("/map", 9).len(), 6);
    assert!(as_recorded == with(before("/map", 1)));
    let three = read_as(&|_| Late { latching: Some(true), depth: Some(3) });
    assert!(three == with([before("/a", 3), before("/map", 3)].concat()));
    let none = read_as(&|_| Late { latching: Some(false), depth: None });
    assert!(none == with(Vec::new()));
}

#[test]
fn a_part_of_a_database_takes_no_memory_for_what_is_in_force_no_more() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("a.db3");
    made::database(&path, Form::Humble, 0..MESSAGES, <[u8]>::to_vec);
    let file = rusqlite::Connection::open(&path).unwrap();
    let larger = "UPDATE messages SET data = zeroblob(100000) \
                  WHERE topic_id = (SELECT id FROM topics WHERE name = '/map')";
    assert_eq!(file.execute(larger, []).unwrap(), 20);
    let all = messages(0..MESSAGES);
    let window = Window { start: all[56].3, end: all[59].3 };
    let within = all[56..59].iter().filter(|each| each.0 == "/map").count();
    let selection = Selection { window, ..Selection::all(&|topic| topic == "/map") };
    let database = Database::open(&path).unwrap();
    let bytes = mcap_of_database(&database, &selection, 1_000_000).unwrap();
    assert_eq!((read(&[Mcap::open(bytes).unwrap()]).len(), within), (3, 2));
}

#[test]
fn the_rows_of_a_database_say_when_what_was_recorded() {
    for form in FORMS {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.db3");
        made::database(&path, form, 0..MESSAGES, <[u8]>::to_vec);
        let file = rusqlite::Connection::open(&path).unwrap();
        file.execute("UPDATE messages SET timestamp = timestamp + 1000000000 WHERE id > 30", [])
            .unwrap();
        let found = rows(&Database::open(&path).unwrap(), &[], 60).unwrap();
        let named: Vec<_> =
            found.connections.iter().map(|each| (each.id, &*each.topic, each.latching)).collect();
        assert_eq!(named, [(1, "/a", false), (2, "/b", false), (3, "/map", true)]);
        let start = 1_700_000_000_000_000_000;
        let times: Vec<_> = found.stretches.iter().map(|each| each.times).collect();
        let second = start + 1_000_000_000;
        assert_eq!(
            times,
            [(start, start + 29_000_000), (second + 30_000_000, second + 59_000_000)]
        );
        let counts: Vec<_> = found.stretches.iter().map(|each| each.counts.clone()).collect();
        assert_eq!(counts, [[(1, 10), (2, 10), (3, 10)], [(1, 10), (2, 10), (3, 10)]]);
        // /a has each third message, of which each second came before the first.
        let of_a = (0..10).map(|at| start + ((3 * at) ^ 1) * 1_000_000).collect::<Vec<_>>();
        assert_eq!((found.stretches[0].each.len(), &found.stretches[0].each[..10]), (30, &*of_a));
        let fewer = rows(&Database::open(&path).unwrap(), &[], 59).unwrap();
        let none = Stretch { each: Vec::new(), ..found.stretches[0].clone() };
        assert_eq!((&fewer.stretches[0], fewer.stretches[1].each.len()), (&none, 0));
    }
}

/// Other people's recordings, beside the checkout; a clone has none.
fn beside(name: &str) -> Option<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../..");
    let places = ["../shared/data", "../../shared/data"];
    let found = places.iter().map(|place| root.join(place).join(name)).find(|path| path.exists());
    if found.is_none() {
        println!("left out: {name} is not beside the checkout");
    }
    found
}

/// Folder, messages by another author's reader, and files.
const RECORDINGS: [(&str, u64, usize); 6] = [
    ("rosbag2_py/STORAGE/talker", 20, 1),
    ("rosbag2_py/STORAGE/wbag", 6074, 5),
    ("rosbag2_py/STORAGE/convert_a", 150, 1),
    ("rosbag2_py/STORAGE/convert_b", 75, 1),
    ("rosbag2_tests/STORAGE/cdr_test", 7, 1),
    ("rosbag2_tests/STORAGE/bag_with_topics_and_service_events", 10, 1),
];

#[test]
fn the_recordings_of_rosbag2_s_tests_have_the_messages_that_others_count() {
    let Some(root) = beside("rosbag2") else { return };
    for (name, messages, count) in RECORDINGS {
        let mut contents = Vec::new();
        for (storage, kind) in [("mcap", Storage::Mcap), ("sqlite3", Storage::Sqlite3)] {
            let path = root.join(name.replace("STORAGE", storage));
            let Folder { metadata, files } = Folder::open(&path, HOW).unwrap();
            assert_eq!(metadata.storage, kind, "{name}");
            assert_eq!((metadata.messages, files.len()), (messages, count), "{name}");
            let found: u64 = files.iter().map(Mcap::message_count).sum();
            assert_eq!(found, messages, "{storage} {name}");
            let mut found = read(&files);
            assert_eq!(found.len() as u64, messages);
            // Messages of one time stand in another order, and profiles as well.
            found.sort();
            found.iter_mut().filter(|_| name.contains("convert_a")).for_each(|each| each.2.clear());
            contents.push(found);
        }
        // Those two were recorded one after the other, not at once.
        if !name.contains("service_events") && !name.contains("wbag") && !name.contains("talker") {
            assert!(contents[0] == contents[1], "{name}");
        }
    }
}

#[test]
fn another_serialization_is_seen() {
    let Some(root) = beside("rosbag2/rosbag2_tests") else { return };
    for storage in ["mcap", "sqlite3"] {
        let path = root.join(storage).join("wrong_rmw_test");
        let folder = Folder::open(&path, HOW).unwrap();
        assert_eq!(folder.metadata.topics[0].encoding, "wrong_format");
        for each in folder.files[0].connections() {
            assert_eq!(each.message_encoding.name(), "wrong_format");
        }
    }
}

#[test]
fn metadata_names_files_in_order_whatever_its_style() {
    let text = "{rosbag2_bagfile_information: {version: 6, storage_identifier: mcap,\n\
                relative_file_paths: [b.mcap, 'sub/a.mcap'], compression_mode: none}}";
    let found = metadata(text.as_bytes()).unwrap();
    assert_eq!(found.files, ["b.mcap", "sub/a.mcap"]);
    assert_eq!((found.compressed, found.messages, found.topics.len()), (None, 0, 0));
}
