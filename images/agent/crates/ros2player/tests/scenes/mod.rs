//! Programs of C that go through a part of the player, built with sanitizers: a step beyond an end is seen.

use std::ffi::OsStr;
use std::path::Path;
use std::process::Command;

/// What a program of C prints that ends well; `arguments` are the compiler's: files, folders, flags.
pub fn printed(name: &str, arguments: &[&OsStr]) -> String {
    let folder = std::env::temp_dir().join(format!("ros2-{name}-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let program = folder.join(name);
    let compiled = Command::new("cc")
        .args(["-std=gnu11", "-O1", "-g", "-fsanitize=address,undefined"])
        .args(["-fno-sanitize-recover=all", "-o"])
        .arg(&program)
        .args(arguments)
        .output()
        .unwrap();
    assert!(compiled.status.success(), "{}", String::from_utf8_lossy(&compiled.stderr));
    let output = Command::new(&program).output().unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// A path from this crate's folder.
pub fn own(path: &str) -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}
