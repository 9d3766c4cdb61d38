//! Builds the program that plays and records, with the C compiler that links Rust.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

const SOURCES: [&str; 9] = [
    "answer.c",
    "control.c",
    "graph.c",
    "main.c",
    "publish.c",
    "rcl.c",
    "ring.c",
    "start.c",
    "take.c",
];
// glibc before 2.34 has dlopen in libdl and pthread_create in libpthread, of which newer ones keep
// empty ones: named by their files, since they have no link to them for compilers.
const FLAGS: [&str; 11] = [
    "-std=gnu11",
    "-O2",
    "-fPIE",
    "-pie",
    "-fvisibility=hidden",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wl,-z,defs,-z,relro,-z,now,--no-as-needed",
    "-Wl,--wrap=__libc_start_main",
    "-s",
];

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=player");
    println!("cargo::rerun-if-env-changed=CC");
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let Some(folder) = std::env::var_os("OUT_DIR").map(PathBuf::from) else {
        eprintln!("OUT_DIR is not set: cargo starts this program");
        return ExitCode::FAILURE;
    };
    let built = Command::new(&compiler)
        .args(FLAGS)
        .args(SOURCES.map(|name| format!("player/{name}")))
        .arg("-o")
        .arg(folder.join("bagpipe-ros2player"))
        .args(["-l:libdl.so.2", "-l:libpthread.so.0"])
        .status();
    match built {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        other => {
            eprintln!("{} has not built the ROS 2 player: {other:?}", compiler.display());
            ExitCode::FAILURE
        }
    }
}
