//! The programs as files: old C libraries load one, the other needs none, and neither is linked to
//! anything of ROS 2.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use bagpipe_ros2player::{DDS_PROGRAM, PROGRAM};

/// The lines of what readelf shows of the program by librcl.
fn readelf(what: &str) -> Vec<String> {
    readelf_of(PROGRAM, what)
}

fn readelf_of(program: &[u8], what: &str) -> Vec<String> {
    static FILES: AtomicU32 = AtomicU32::new(0);
    let number = FILES.fetch_add(1, Ordering::SeqCst);
    let name = format!("ros2-player-{}-{number}", std::process::id());
    let file = std::env::temp_dir().join(name);
    std::fs::write(&file, program).unwrap();
    let output = Command::new("readelf").args(["--wide", what]).arg(&file).output().unwrap();
    std::fs::remove_file(&file).unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn no_symbol_is_newer_than_glibc_2_17() {
    let mut newest = (0, 0);
    for line in readelf("--version-info") {
        let Some((_, version)) = line.split_once("Name: GLIBC_") else { continue };
        let mut numbers = version.split_whitespace().next().unwrap().split('.');
        let mut number = || numbers.next().unwrap().parse::<u32>().unwrap();
        newest = newest.max((number(), number()));
    }
    assert!(((2, 2)..=(2, 17)).contains(&newest), "GLIBC_{newest:?}");
}

#[test]
fn it_needs_nothing_but_the_c_library() {
    let needed: BTreeSet<String> = readelf("--dynamic")
        .iter()
        .filter(|line| line.contains("(NEEDED)"))
        .filter_map(|line| line.split(['[', ']']).nth(1).map(str::to_owned))
        .collect();
    // glibc before 2.34 has dlopen in libdl, and pthread_create in libpthread.
    let expected = ["libc.so.6", "libdl.so.2", "libpthread.so.0"];
    assert_eq!(needed, expected.map(str::to_owned).into());
}

#[test]
fn it_is_loaded_at_any_address_and_binds_all_that_it_needs_at_once() {
    assert!(readelf("--file-header").iter().any(|line| line.contains("DYN (Position-Ind")));
    assert!(readelf("--dynamic").iter().any(|line| line.contains("FLAGS") && line.contains("NOW")));
}

#[test]
fn the_one_on_dds_needs_no_loader_and_no_library() {
    let headers = readelf_of(DDS_PROGRAM, "--program-headers");
    assert!(headers.iter().any(|line| line.contains("LOAD")));
    assert!(!headers.iter().any(|line| line.contains("INTERP")));
    let dynamic = readelf_of(DDS_PROGRAM, "--dynamic");
    assert!(dynamic.iter().any(|line| line.contains("FLAGS_1") && line.contains("PIE")));
    assert!(!dynamic.iter().any(|line| line.contains("(NEEDED)")), "{dynamic:?}");
}
