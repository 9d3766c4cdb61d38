//! A folder for what ROS writes during one case; gone with it.

use std::fs;
use std::path::{Path, PathBuf};

/// Removed when it is dropped.
#[derive(Debug)]
pub struct CaseFolder {
    path: PathBuf,
}

impl CaseFolder {
    /// Makes the folder in the first place that can be written: the system's for temporary
    /// files, or the slot's own on the shared volume (a container may be read-only).
    pub fn make(slot: u32, slot_folder: &Path) -> Result<Self, String> {
        let mut refused = Vec::new();
        for path in places(slot, std::process::id(), slot_folder) {
            // One that a killed predecessor left behind must not speak for this case.
            let fresh = match fs::remove_dir_all(&path) {
                Ok(()) => Ok(()),
                Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(()),
                Err(error) => Err(error),
            };
            match fresh.and_then(|()| fs::create_dir(&path)) {
                Ok(()) => return Ok(Self { path }),
                Err(error) => refused.push(format!("{}: {error}", path.display())),
            }
        }
        Err(format!("no folder for ROS's logs can be made: {}", refused.join("; ")))
    }

    /// Removes what a process of a slot that was killed could not.
    pub fn remove_left(slot: u32, process: u32, slot_folder: &Path) {
        for path in places(slot, process, slot_folder) {
            if path.exists() {
                drop(Self { path });
            }
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }
}

/// The process in the name keeps agents apart that share a folder for temporary files.
fn places(slot: u32, process: u32, slot_folder: &Path) -> [PathBuf; 2] {
    let name = format!("bagpipe-case-{slot}-{process}");
    [std::env::temp_dir().join(&name), slot_folder.join(&name)]
}

impl Drop for CaseFolder {
    fn drop(&mut self) {
        if let Err(error) = fs::remove_dir_all(&self.path) {
            eprintln!("bagpipe-agent: cannot remove {}: {error}", self.path.display());
        }
    }
}
