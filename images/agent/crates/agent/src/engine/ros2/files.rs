//! The files that go into the user's container beside the agent.

use std::fs::{self, File, Permissions};
use std::io::{self, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use crate::case::failure::Failure;

/// Where they are.
#[derive(Debug, Clone)]
pub struct Files {
    /// The library that is loaded into the stack's nodes.
    pub library: PathBuf,
    /// The player's program, by librcl.
    pub program: PathBuf,
    folder: PathBuf,
}

impl Files {
    /// Writes them into a slot's folder, from which programs can be started. What is there is not
    /// used and not looked at: the stack of an earlier case could write it.
    pub fn put(folder: &Path) -> Result<Files, Failure> {
        let library = put(folder, "libbagpipe_ros2ledger.so", bagpipe_ros2ledger::LIBRARY)?;
        let program = put(folder, "bagpipe-ros2player", bagpipe_ros2player::PROGRAM)?;
        Ok(Files { library, program, folder: folder.to_owned() })
    }

    /// Writes the program on DDS alone, which few cases need and is larger by far.
    pub fn put_dds_program(&self) -> Result<PathBuf, Failure> {
        put(&self.folder, "bagpipe-ros2player-dds", bagpipe_ros2player::DDS_PROGRAM)
    }
}

fn put(folder: &Path, name: &str, bytes: &[u8]) -> Result<PathBuf, Failure> {
    let path = folder.join(name);
    write_new(&path, bytes).map_err(|error| {
        Failure::new("Internal", format!("cannot write {}: {error}", path.display()))
    })?;
    Ok(path)
}

/// Writes a file that may be executed, in place of whatever has its name.
fn write_new(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(there) if there.is_dir() => fs::remove_dir_all(path),
        _ => fs::remove_file(path),
    };
    match removed {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    let mut file = File::options().write(true).create_new(true).mode(0o755).open(path)?;
    file.write_all(bytes)?;
    // Whatever the mask was.
    file.set_permissions(Permissions::from_mode(0o755))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn what_an_earlier_stack_left_under_the_names_is_not_used() {
        let folder = std::env::temp_dir().join(format!("ros2-files-{}", std::process::id()));
        fs::create_dir(&folder).unwrap();
        let theirs = folder.join("theirs");
        for round in 0..3 {
            fs::write(&theirs, bagpipe_ros2ledger::LIBRARY).unwrap();
            for name in ["libbagpipe_ros2ledger.so", "bagpipe-ros2player"] {
                let path = folder.join(name);
                match round {
                    // With the right bytes: until somebody writes others into it.
                    0 => symlink(&theirs, &path).unwrap(),
                    1 => {
                        fs::remove_file(&path).unwrap();
                        fs::create_dir_all(path.join("full")).unwrap();
                    }
                    _ => fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap(),
                }
            }
            let files = Files::put(&folder).unwrap();
            for (path, bytes) in [
                (&files.library, bagpipe_ros2ledger::LIBRARY),
                (&files.program, bagpipe_ros2player::PROGRAM),
            ] {
                let there = fs::symlink_metadata(path).unwrap();
                assert!(there.is_file(), "{round}");
                assert_eq!(there.permissions().mode() & 0o777, 0o755);
                assert!(fs::read(path).unwrap() == bytes, "{round}");
            }
            assert!(fs::read(&theirs).unwrap() == bagpipe_ros2ledger::LIBRARY);
        }
        // A pipe, whose reader would wait for ever.
        fs::remove_file(folder.join("bagpipe-ros2player")).unwrap();
        let pipe = rustix::fs::FileType::Fifo;
        let mode = rustix::fs::Mode::RWXU;
        let place = folder.join("bagpipe-ros2player");
        rustix::fs::mknodat(rustix::fs::CWD, &place, pipe, mode, 0).unwrap();
        let files = Files::put(&folder).unwrap();
        assert!(fs::read(&files.program).unwrap() == bagpipe_ros2player::PROGRAM);
        symlink(&theirs, folder.join("bagpipe-ros2player-dds")).unwrap();
        let program = files.put_dds_program().unwrap();
        assert!(fs::symlink_metadata(&program).unwrap().is_file());
        assert!(fs::read(program).unwrap() == bagpipe_ros2player::DDS_PROGRAM);
        fs::remove_dir_all(&folder).unwrap();
    }
}
