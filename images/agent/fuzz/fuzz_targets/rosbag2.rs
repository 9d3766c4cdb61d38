//! A folder of rosbag2: any metadata.yaml and any bytes of its files give an answer, within the
//! limit; paths stay below the folder; planning counts what reading finds.
#![no_main]

use std::path::{Component, Path, PathBuf};
use std::sync::OnceLock;

use bagpipe_fuzz::{LIMIT, bag_bound, bounded, split_folder};
use bagpipe_rosbag2::{
    Compressed, Database, Folder, METADATA, Metadata, Reading, Selection, Storage, Stretch,
    mcap_of_database, metadata, rows,
};
use libfuzzer_sys::fuzz_target;

/// What a topic or a file of metadata.yaml may take beside its text.
const PARSED: usize = 64;

fuzz_target!(|bytes: &[u8]| {
    let (text, stored) = split_folder(bytes);
    let bound = PARSED * text.len() + (1 << 20);
    let Ok(about) = bounded(bound, || metadata(text)) else { return };
    assert!((4..=9).contains(&about.version) && !about.files.is_empty());
    let plain =
        |name: &str| Path::new(name).components().all(|each| matches!(each, Component::Normal(_)));
    assert!(about.files.iter().all(|name| plain(name)), "{:?}", about.files);
    // One file name of a system's length, in the folder itself.
    if about.files.iter().any(|name| name.contains('/') || name.len() > 200 || name == METADATA) {
        return;
    }
    let place = place();
    std::fs::write(place.join(METADATA), text).expect("the metadata");
    let written = about.files.iter().take(4);
    written.clone().for_each(|name| std::fs::write(place.join(name), stored).expect("a file"));
    let how = Reading { memory: LIMIT, scanned: bytes.len() % 2 == 0 };
    bounded(4 * bag_bound(bytes.len()) + bound, || read(&place, how, &about));
    written.for_each(|name| std::fs::remove_file(place.join(name)).expect("a file"));
});

fn read(place: &Path, how: Reading, about: &Metadata) {
    if let Ok(folder) = Folder::open(place, how) {
        assert_eq!(folder.metadata, *about);
        assert_eq!(folder.files.len(), about.files.len());
        for file in &folder.files {
            let Ok(timeline) = file.timeline(|_| true) else { continue };
            for message in (0..timeline.len()).filter_map(|at| timeline.get(at)) {
                assert!(file.connections().iter().any(|each| each.id == message.connection));
            }
        }
    }
    if about.storage == Storage::Sqlite3 && about.compressed != Some(Compressed::File) {
        planned(&place.join(&about.files[0]), about);
    }
}

/// What planning says of a file of SQLite is what reading it finds.
fn planned(file: &Path, about: &Metadata) {
    let Ok(database) = Database::open(file) else { return };
    let Ok(found) = rows(&database, &about.topics, 1 << 20) else { return };
    let counted: u64 = found
        .stretches
        .iter()
        .inspect(|each| assert!(each.times.0 <= each.times.1))
        .inspect(|Stretch { each, times, .. }| {
            assert!(each.iter().all(|time| (times.0..=times.1).contains(time)));
        })
        .flat_map(|each| &each.counts)
        .map(|(_, count)| u64::from(*count))
        .sum();
    // Bytes as they are stored: that messages are compressed changes no count.
    let selection = Selection { about: &about.topics, ..Selection::all(&|_| true) };
    let Ok(bytes) = mcap_of_database(&database, &selection, LIMIT) else { return };
    let made = bagpipe_mcap::Mcap::open(bytes).expect("what was written");
    assert_eq!((made.loss(), made.message_count()), (None, counted));
    let each: usize = found.stretches.iter().map(|stretch| stretch.each.len()).sum();
    assert_eq!(each as u64, if counted <= 1 << 20 { counted } else { 0 });
}

/// A folder of this process, in memory.
fn place() -> &'static PathBuf {
    static PLACE: OnceLock<PathBuf> = OnceLock::new();
    PLACE.get_or_init(|| {
        let shared = Path::new("/dev/shm");
        let root = if shared.is_dir() { shared.to_owned() } else { std::env::temp_dir() };
        let folder = root.join(format!("bagpipe-fuzz-{}", std::process::id()));
        std::fs::create_dir_all(&folder).expect("a folder");
        folder
    })
}
