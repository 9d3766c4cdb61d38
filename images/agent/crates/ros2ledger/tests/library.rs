//! The library as a file: old C libraries load it, and it stands before what it should alone.
#![allow(clippy::unwrap_used)]

use std::collections::BTreeSet;
use std::process::Command;

use bagpipe_ros2ledger::LIBRARY;

/// The lines of what readelf shows of the library.
fn readelf(what: &str) -> Vec<String> {
    let name = format!("ros2-ledger-{}-{what}.so", std::process::id());
    let file = std::env::temp_dir().join(name);
    std::fs::write(&file, LIBRARY).unwrap();
    let output = Command::new("readelf").args(["--wide", what]).arg(&file).output().unwrap();
    std::fs::remove_file(&file).unwrap();
    assert!(output.status.success());
    String::from_utf8(output.stdout).unwrap().lines().map(str::to_owned).collect()
}

#[test]
fn no_symbol_is_newer_than_glibc_2_31() {
    let lines = readelf("--version-info");
    let mut newest = (0, 0);
    for line in &lines {
        let Some((_, version)) = line.split_once("Name: GLIBC_") else { continue };
        let mut numbers = version.split_whitespace().next().unwrap().split('.');
        let mut number = || numbers.next().unwrap().parse::<u32>().unwrap();
        newest = newest.max((number(), number()));
    }
    assert!(((2, 2)..=(2, 31)).contains(&newest), "GLIBC_{newest:?}");
}

#[test]
fn it_needs_nothing_but_the_c_library() {
    let needed: BTreeSet<String> = readelf("--dynamic")
        .iter()
        .filter(|line| line.contains("(NEEDED)"))
        .filter_map(|line| line.split(['[', ']']).nth(1).map(str::to_owned))
        .collect();
    // glibc before 2.34 has dlsym in libdl.
    assert_eq!(needed, BTreeSet::from(["libc.so.6".into(), "libdl.so.2".into()]));
}

#[test]
fn it_stands_before_these_functions_and_no_other() {
    let found: BTreeSet<String> = readelf("--dyn-syms")
        .iter()
        .map(|line| line.split_whitespace().collect::<Vec<_>>())
        .filter(|words| words.len() == 8 && words[3] == "FUNC" && words[6] != "UND")
        .map(|words| words[7].to_owned())
        .collect();
    let expected = [
        "rcl_timer_call",
        "rcl_timer_call_with_info",
        "rmw_create_publisher",
        "rmw_create_subscription",
        "rmw_destroy_guard_condition",
        "rmw_destroy_publisher",
        "rmw_destroy_subscription",
        "rmw_publish",
        "rmw_publish_loaned_message",
        "rmw_publish_serialized_message",
        "rmw_take",
        "rmw_take_dynamic_message",
        "rmw_take_dynamic_message_with_info",
        "rmw_take_loaned_message",
        "rmw_take_loaned_message_with_info",
        "rmw_take_sequence",
        "rmw_take_serialized_message",
        "rmw_take_serialized_message_with_info",
        "rmw_take_with_info",
        "rmw_trigger_guard_condition",
        "rmw_wait",
        "ros_trace_callback_end",
        "ros_trace_callback_start",
        "ros_trace_rcl_subscription_init",
        "ros_trace_rclcpp_subscription_callback_added",
        "ros_trace_rclcpp_subscription_init",
        "sendmsg",
        "sendto",
    ];
    assert_eq!(found, expected.map(str::to_owned).into());
}
