//! Builds the library that is preloaded into ROS 2 nodes, with the C compiler that links Rust.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

const SOURCES: [&str; 15] = [
    "addresses.c",
    "attach.c",
    "count.c",
    "cyclone.c",
    "gid.c",
    "guards.c",
    "list.c",
    "matches.c",
    "next.c",
    "origin.c",
    "rmw.c",
    "sending.c",
    "slices.c",
    "timer.c",
    "trace.c",
];
// glibc before 2.34 has dlsym in libdl, of which newer ones keep an empty one: named by its file,
// since they have no link to it for compilers.
const FLAGS: [&str; 11] = [
    "-std=gnu11",
    "-O2",
    "-fPIC",
    "-shared",
    "-fvisibility=hidden",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Wl,-z,defs,-z,relro,-z,now,--no-as-needed",
    "-Wl,-soname,libbagpipe_ros2ledger.so",
    "-s",
];

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=preload");
    println!("cargo::rerun-if-env-changed=CC");
    println!("cargo::rerun-if-env-changed=DEP_BAGPIPE_FLOW_CONTROL_FOLDER");
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let Some(folder) = std::env::var_os("OUT_DIR").map(PathBuf::from) else {
        eprintln!("OUT_DIR is not set: cargo starts this program");
        return ExitCode::FAILURE;
    };
    let Some(flow) = std::env::var_os("DEP_BAGPIPE_FLOW_CONTROL_FOLDER").map(PathBuf::from) else {
        eprintln!("DEP_BAGPIPE_FLOW_CONTROL_FOLDER is not set: bagpipe-flow-control sets it");
        return ExitCode::FAILURE;
    };
    let built = Command::new(&compiler)
        .args(FLAGS)
        .args(SOURCES.map(|name| format!("preload/{name}")))
        .arg(flow.join("flow_control.c"))
        .arg("-I")
        .arg(&flow)
        .arg("-o")
        .arg(folder.join("libbagpipe_ros2ledger.so"))
        .arg("-l:libdl.so.2")
        .status();
    match built {
        Ok(status) if status.success() => ExitCode::SUCCESS,
        other => {
            eprintln!("{} has not built the ROS 2 ledger's library: {other:?}", compiler.display());
            ExitCode::FAILURE
        }
    }
}
