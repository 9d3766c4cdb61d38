//! Builds the programs that play and record, with the C compiler that links Rust.

use std::path::PathBuf;
use std::process::{Command, ExitCode};

/// What both have.
const SHARED: [&str; 10] = [
    "answer.c",
    "control.c",
    "handles.c",
    "main.c",
    "presence.c",
    "publish.c",
    "ring.c",
    "sending.c",
    "take.c",
    "threads.c",
];
const RCL: [&str; 8] = [
    "rcl/cyclone.c",
    "rcl/endpoints.c",
    "rcl/graph.c",
    "rcl/join.c",
    "rcl/old_glibc.c",
    "rcl/rcl.c",
    "rcl/states.c",
    "rcl/wait.c",
];
const DDS: [&str; 7] = [
    "dds/blob.c",
    "dds/endpoints.c",
    "dds/graph.c",
    "dds/join.c",
    "dds/nodes.c",
    "dds/parse.c",
    "dds/wait.c",
];
const FLAGS: [&str; 9] = [
    "-std=gnu11",
    "-O2",
    "-fPIE",
    "-fvisibility=hidden",
    "-Wall",
    "-Wextra",
    "-Werror",
    "-Iplayer",
    "-s",
];
// glibc before 2.34 has dlopen in libdl and pthread_create in libpthread, of which newer ones keep
// empty ones: named by their files, since they have no link to them for compilers.
const RCL_FLAGS: [&str; 10] = [
    "-pie",
    // For cyclone.c and sending.c, whose functions libraries are to find.
    "-Wl,--export-dynamic-symbol=dds_create_writer",
    "-Wl,--export-dynamic-symbol=sendmsg",
    "-Wl,--export-dynamic-symbol=sendto",
    "-include",
    "player/rcl/old_glibc.h",
    "-Wl,-z,defs,-z,relro,-z,now,--no-as-needed",
    "-Wl,--wrap=__libc_start_main",
    "-l:libdl.so.2",
    "-l:libpthread.so.0",
];
// The archive of Cyclone DDS was built with NDEBUG, by which its structures are shorter.
const DDS_FLAGS: [&str; 5] =
    ["-static-pie", "-DNDEBUG", "-Iplayer/dds", "-Wl,--gc-sections,-z,relro,-z,now", "-lpthread"];

fn main() -> ExitCode {
    println!("cargo::rerun-if-changed=player");
    println!("cargo::rerun-if-env-changed=CC");
    let built = build("bagpipe-ros2player", &RCL, &RCL_FLAGS.map(str::to_owned)).and_then(|()| {
        let mut flags = vec![variable("DEP_BAGPIPE_CYCLONEDDS_ARCHIVE")?];
        flags.extend(DDS_FLAGS.map(str::to_owned));
        let included = variable("DEP_BAGPIPE_CYCLONEDDS_INCLUDE")?;
        flags.extend(included.split(':').map(|folder| format!("-isystem{folder}")));
        build("bagpipe-ros2player-dds", &DDS, &flags)
    });
    match built {
        Ok(()) => ExitCode::SUCCESS,
        Err(why) => {
            eprintln!("the ROS 2 players were not built: {why}");
            ExitCode::FAILURE
        }
    }
}

fn build(name: &str, own: &[&str], flags: &[String]) -> Result<(), String> {
    let folder = PathBuf::from(variable("OUT_DIR")?);
    let compiler = std::env::var_os("CC").unwrap_or_else(|| "cc".into());
    let flow = PathBuf::from(variable("DEP_BAGPIPE_FLOW_CONTROL_FOLDER")?);
    let mut command = Command::new(compiler);
    command
        .args(FLAGS)
        .args(SHARED.iter().chain(own).map(|name| format!("player/{name}")))
        .arg(flow.join("flow_control.c"))
        .arg("-I")
        .arg(&flow)
        .arg("-o")
        .arg(folder.join(name))
        .args(flags);
    match command.status() {
        Ok(status) if status.success() => Ok(()),
        other => Err(format!("{command:?}: {other:?}")),
    }
}

fn variable(name: &str) -> Result<String, String> {
    std::env::var(name).map_err(|_| format!("{name} is not set: cargo starts this program"))
}
