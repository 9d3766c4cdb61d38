//! docs/reference/agent.md is what the program itself says; BAGPIPE_WRITE_REFERENCE=1 writes it.
#![allow(clippy::unwrap_used)]

use std::path::PathBuf;
use std::process::Command;

const VERBS: [&str; 11] = [
    "install", "serve", "ready", "info", "play", "record", "slice", "merge", "reindex", "check",
    "convert",
];

fn help(arguments: &[&str]) -> String {
    let mut command = Command::new(env!("CARGO_BIN_EXE_bagpipe-agent"));
    let text = String::from_utf8(command.args(arguments).output().unwrap().stdout).unwrap();
    let lines: Vec<&str> = text.lines().map(str::trim_end).collect();
    lines.join("\n")
}

#[test]
fn the_reference_page_is_the_program_s_own_help() {
    let path = PathBuf::from(std::env::var_os("CARGO_MANIFEST_DIR").unwrap())
        .join("../../../../docs/reference/agent.md");
    let written = std::fs::read_to_string(&path).unwrap();
    // Title and introduction are the page's own words.
    let (head, _) = written.split_once("\n```\n").unwrap();
    let mut page = format!("{head}\n```\n{}\n```\n", help(&["--help"]));
    for verb in VERBS {
        page.push_str(&format!("\n## {verb}\n\n```\n{}\n```\n", help(&[verb, "--help"])));
    }
    if std::env::var_os("BAGPIPE_WRITE_REFERENCE").is_some() {
        std::fs::write(&path, &page).unwrap();
    } else {
        assert!(written == page, "{} is not what the program says", path.display());
    }
}
