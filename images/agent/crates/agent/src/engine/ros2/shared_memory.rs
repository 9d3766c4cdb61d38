//! What nodes over Fast DDS leave in shared memory when they are killed: a segment each, and ports and
//! their locks. A container has 64 MiB of it, by which the nodes of many cases would fill it.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};

/// Where Linux has it (shm_overview(7)).
pub const FOLDER: &str = "/dev/shm";
/// How Fast DDS 2 and 3 name what they have there.
const NAMES: [&[u8]; 4] = [b"fastrtps_", b"sem.fastrtps_", b"fastdds_", b"sem.fastdds_"];

/// What was there when a case began.
#[derive(Debug)]
pub struct SharedMemory {
    folder: PathBuf,
    before: BTreeSet<OsString>,
}

impl SharedMemory {
    /// Notes what is there now.
    pub fn note(folder: &Path) -> SharedMemory {
        SharedMemory { folder: folder.to_owned(), before: names(folder) }
    }

    /// Removes what has come since and no process has open any more: another slot's nodes have theirs. That
    /// something can't be removed is no fault of the case.
    pub fn clean(&self) {
        let come = names(&self.folder);
        let mut left: BTreeSet<PathBuf> =
            come.difference(&self.before).map(|name| self.folder.join(name)).collect();
        if left.is_empty() {
            return;
        }
        for file in in_use() {
            left.remove(&file);
        }
        for file in left {
            let _not_ours = std::fs::remove_file(file);
        }
    }
}

fn names(folder: &Path) -> BTreeSet<OsString> {
    let all = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = all.map(|entry| entry.file_name());
    names.filter(|name| NAMES.iter().any(|one| name.as_bytes().starts_with(one))).collect()
}

/// The files that processes have open or mapped, of all that can be looked into.
fn in_use() -> BTreeSet<PathBuf> {
    let mut files = BTreeSet::new();
    for process in std::fs::read_dir("/proc").into_iter().flatten().flatten() {
        if !process.file_name().as_bytes().iter().all(u8::is_ascii_digit) {
            continue;
        }
        let maps = std::fs::read(process.path().join("maps")).unwrap_or_default();
        let mapped = maps.split(|byte| *byte == b'\n').filter_map(|line| {
            let path = line.iter().position(|byte| *byte == b'/')?;
            Some(PathBuf::from(std::ffi::OsStr::from_bytes(&line[path..])))
        });
        files.extend(mapped);
        let open = std::fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten();
        files.extend(open.filter_map(|fd| std::fs::read_link(fd.path()).ok()));
    }
    files
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use std::fs::File;

    use super::*;

    #[test]
    fn what_nobody_has_open_any_more_goes_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str| File::create(folder.path().join(name)).unwrap();
        drop(make("fastrtps_before"));
        let noted = SharedMemory::note(folder.path());
        let left = ["fastrtps_1", "fastrtps_1_el", "sem.fastrtps_port7411_mutex", "fastdds_2"];
        left.iter().for_each(|name| drop(make(name)));
        let _another_slot = make("fastrtps_3_el");
        drop(make("somebody_else"));
        noted.clean();
        let mut there: Vec<OsString> = std::fs::read_dir(folder.path())
            .unwrap()
            .map(|entry| entry.unwrap().file_name())
            .collect();
        there.sort();
        assert_eq!(there, ["fastrtps_3_el", "fastrtps_before", "somebody_else"]);
        SharedMemory::note(Path::new("/none/such")).clean();
    }

    #[test]
    fn what_a_process_has_mapped_is_in_use() {
        let own = std::env::current_exe().unwrap();
        assert!(in_use().contains(&own));
    }
}
