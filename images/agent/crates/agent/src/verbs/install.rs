//! Putting the binary where the user's image can start it.

use std::fs::{self, File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;

/// Copies this program to `directory/bin/bagpipe-agent`: under another name first, so that
/// nobody ever starts half of it.
pub fn install(directory: &Path) -> Result<(), String> {
    let folder = directory.join("bin");
    let target = folder.join("bagpipe-agent");
    let partial = folder.join(format!(".bagpipe-agent.{}", std::process::id()));
    let copied = copy(&folder, &partial).and_then(|()| fs::rename(&partial, &target));
    copied.map_err(|error| format!("cannot install {}: {error}", target.display()))
}

fn copy(folder: &Path, partial: &Path) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    let mut source = File::open("/proc/self/exe")?;
    let mut copy = File::create(partial)?;
    io::copy(&mut source, &mut copy)?;
    copy.set_permissions(Permissions::from_mode(0o755))?;
    copy.sync_all()
}
