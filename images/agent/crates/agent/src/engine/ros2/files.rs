//! The two files that go into the user's container beside the agent.

use std::fs::{self, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};

use crate::case::failure::Failure;

/// Where they are.
#[derive(Debug, Clone)]
pub struct Files {
    /// The library that is loaded into the stack's nodes.
    pub library: PathBuf,
    /// The player's program.
    pub program: PathBuf,
}

impl Files {
    /// Writes them into a slot's folder, from which programs can be started; those that are there
    /// from an earlier case stay.
    pub fn put(folder: &Path) -> Result<Files, Failure> {
        let library = put(folder, "libbagpipe_ros2ledger.so", bagpipe_ros2ledger::LIBRARY)?;
        let program = put(folder, "bagpipe-ros2player", bagpipe_ros2player::PROGRAM)?;
        Ok(Files { library, program })
    }
}

fn put(folder: &Path, name: &str, bytes: &[u8]) -> Result<PathBuf, Failure> {
    let path = folder.join(name);
    let failed = |error: io::Error| {
        Failure::new("Internal", format!("cannot write {}: {error}", path.display()))
    };
    if fs::read(&path).is_ok_and(|there| there == bytes) {
        return Ok(path);
    }
    // Under another name first, so that nobody ever loads half of it.
    let partial = folder.join(format!(".{name}.{}", std::process::id()));
    fs::write(&partial, bytes).map_err(failed)?;
    fs::set_permissions(&partial, Permissions::from_mode(0o755)).map_err(failed)?;
    fs::rename(&partial, &path).map_err(failed)?;
    Ok(path)
}
