//! The verbs that need no pipe.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::os::unix::fs::PermissionsExt;
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use worker::bags::{old_format, unindexed};

fn agent(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_bagpipe-agent")).args(arguments).output().unwrap()
}

#[test]
fn install_puts_a_program_that_runs() {
    let folder = tempfile::tempdir().unwrap();
    for _ in 0..2 {
        assert!(agent(&["install", folder.path().to_str().unwrap()]).status.success());
    }
    let installed = folder.path().join("bin/bagpipe-agent");
    assert_eq!(std::fs::metadata(&installed).unwrap().permissions().mode() & 0o777, 0o755);
    let version = Command::new(&installed).arg("--version").output().unwrap().stdout;
    assert_eq!(
        String::from_utf8(version).unwrap(),
        concat!("bagpipe-agent ", env!("CARGO_PKG_VERSION"), "\n")
    );
    assert_eq!(std::fs::read_dir(folder.path().join("bin")).unwrap().count(), 1);
}

#[test]
fn install_says_where_it_could_not() {
    let output = agent(&["install", "/proc/nowhere"]);
    assert!(!output.status.success());
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("cannot install /proc/nowhere/bin/bagpipe-agent: "), "{text}");
}

#[test]
fn ready_says_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let output = agent(&["ready", "--shared", folder.path().to_str().unwrap()]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8(output.stderr).unwrap().contains("not serving yet"));
}

#[test]
fn ready_waits_as_long_as_it_may() {
    let folder = tempfile::tempdir().unwrap();
    let begun = Instant::now();
    let output = agent(&["ready", "--shared", folder.path().to_str().unwrap(), "--wait", "0.2"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(begun.elapsed() >= Duration::from_millis(200), "{:?}", begun.elapsed());
    assert!(String::from_utf8(output.stderr).unwrap().contains("not serving yet"));
}

#[test]
fn info_shows_a_bag_and_its_damage() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("chatter.bag");
    let path = path.to_str().unwrap();
    let bag = worker::chatter(50);
    std::fs::write(path, &bag).unwrap();
    let text = String::from_utf8(agent(&["info", path]).stdout).unwrap();
    assert!(text.contains("time       100.000000000 to 100.490000000\n"), "{text}");
    assert!(text.contains("messages   50\n"), "{text}");
    assert!(text.contains("/chatter          50  std_msgs/String"), "{text}");
    std::fs::write(path, &bag[..6000]).unwrap();
    let text = String::from_utf8(agent(&["info", path]).stdout).unwrap();
    assert!(text.contains("damaged    at byte 6000: expected "), "{text}");
    let missing = agent(&["info", "/no/such.bag"]);
    assert!(String::from_utf8(missing.stderr).unwrap().contains("/no/such.bag: No such file"));
}

#[test]
fn help_teaches_the_way_of_a_case() {
    let text = String::from_utf8(agent(&["--help"]).stdout).unwrap();
    for word in
        ["install", "serve", "ready", "info", "slice", "merge", "reindex", "check", "convert"]
    {
        assert!(text.contains(word), "{word} is not in:\n{text}");
    }
    for word in ["postStart hook", "python3-rosmaster"] {
        assert!(text.contains(word), "{word} is not in:\n{text}");
    }
    assert!(!text.contains("slot process"));
}

/// Writes a bag of `count` messages, 10 ms apart, and returns its path and those beside it.
fn folder_with(count: u64) -> (tempfile::TempDir, impl Fn(&str) -> String) {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().to_str().unwrap().to_owned();
    let path = move |name: &str| format!("{root}/{name}");
    std::fs::write(path("chatter.bag"), worker::chatter(count)).unwrap();
    (folder, path)
}

fn output_of(arguments: &[&str]) -> String {
    let output = agent(arguments);
    assert!(output.status.success(), "{arguments:?}: {output:?}");
    String::from_utf8(output.stdout).unwrap()
}

fn complaint(arguments: &[&str]) -> String {
    let output = agent(arguments);
    assert_eq!(output.status.code(), Some(1), "{arguments:?}: {output:?}");
    String::from_utf8(output.stderr).unwrap()
}

#[test]
fn slices_merge_into_a_bag_that_checks() {
    let (_folder, path) = folder_with(50);
    let (from, early, late, both) =
        (path("chatter.bag"), path("early.bag"), path("late.bag"), path("both.bag"));
    let text = output_of(&["slice", &from, "--end", "0.25", "-o", &early]);
    assert_eq!(
        text,
        format!("{early}: 25 messages, 0 latched before them, 0 chunks as they were\n")
    );
    output_of(&["slice", &from, "--start", "0.25", "--topic", "/chatter", "-o", &late]);
    let text = output_of(&["merge", &late, &early, "--compression", "lz4", "-o", &both]);
    assert_eq!(text, format!("{both}: 50 messages of 2 bags\n"));
    assert_eq!(output_of(&["check", &both]), format!("{both}: 50 whole messages\n"));
    assert!(output_of(&["info", &both]).contains("time       100.000000000 to 100.490000000\n"));
    let again = complaint(&["merge", &late, "-o", &both]);
    assert!(again.contains("both.bag is there already; choose another name"), "{again}");
    let none = complaint(&["slice", &from, "--topic", "/none", "-o", &path("none.bag")]);
    assert!(none.contains("chatter.bag has no topic /none"), "{none}");
}

#[test]
fn reindex_saves_what_check_complains_about() {
    let (_folder, path) = folder_with(50);
    let (from, saved) = (path("chatter.bag"), path("saved.bag"));
    let bytes = std::fs::read(&from).unwrap();
    std::fs::write(&from, &bytes[..6000]).unwrap();
    let text = complaint(&["check", &from]);
    assert!(text.contains("damaged at byte 6000: expected "), "{text}");
    assert!(text.contains("an unknown number of messages are lost"), "{text}");
    let text = complaint(&["slice", &from, "-o", &saved]);
    assert!(text.contains("`bagpipe-agent reindex` saves what is whole"), "{text}");
    let text = output_of(&["reindex", &from, "-o", &saved]);
    assert!(text.contains("damaged at byte 6000"), "{text}");
    assert!(output_of(&["check", &saved]).contains("whole messages"));
}

#[test]
fn bags_without_an_index_and_of_format_1_2_are_read_by_every_verb() {
    let (_folder, path) = folder_with(1);
    // In 2.0 the last chunk's index stands behind the last message: 55 bytes, 12 for each.
    for (name, bytes, format, behind) in
        [("active", unindexed(50), "2.0", 55 + 12 * 50), ("old", old_format(50), "1.2", 0)]
    {
        let file = |suffix: &str| path(&format!("{name}{suffix}"));
        let (from, part, both) = (file(".bag"), file("-part.bag"), file("-both.bag"));
        std::fs::write(&from, &bytes).unwrap();
        let text = output_of(&["info", &from]);
        for line in [
            format!("format     {format}\n"),
            "time       100.000000000 to 100.490000000\n".to_owned(),
            "messages   50\n".to_owned(),
            "/chatter          50  std_msgs/String".to_owned(),
        ] {
            assert!(text.contains(&line), "{name}: {text}");
        }
        assert_eq!(output_of(&["check", &from]), format!("{from}: 50 whole messages\n"));
        let text = output_of(&["slice", &from, "--end", "0.25", "-o", &part]);
        assert!(text.contains(": 25 messages, "), "{name}: {text}");
        let text = output_of(&["merge", &from, &part, "-o", &both]);
        assert_eq!(text, format!("{both}: 75 messages of 2 bags\n"));
        assert_eq!(output_of(&["check", &both]), format!("{both}: 75 whole messages\n"));
        // Cut, both say how much is lost.
        std::fs::write(&from, &bytes[..bytes.len() - behind - 5]).unwrap();
        let text = complaint(&["check", &from]);
        assert!(text.contains("damaged at byte "), "{name}: {text}");
        assert!(text.contains(" bytes and ") && text.contains("are lost"), "{name}: {text}");
        let text = complaint(&["slice", &from, "-o", &file("-never.bag")]);
        assert!(text.contains("are lost; `bagpipe-agent reindex` saves"), "{name}: {text}");
        let saved = file("-saved.bag");
        assert!(output_of(&["reindex", &from, "-o", &saved]).contains(": 49 messages, "));
        assert_eq!(output_of(&["check", &saved]), format!("{saved}: 49 whole messages\n"));
    }
}

#[test]
fn a_memory_budget_holds_for_every_verb_that_reads() {
    let (_folder, path) = folder_with(2_000);
    let (plain, packed, out) = (path("chatter.bag"), path("packed.bag"), path("out.bag"));
    output_of(&["slice", &plain, "--end", "19", "--compression", "bz2", "-o", &packed]);
    let small = ["--memory-budget", "1KiB"];
    for arguments in [
        &["check", &packed][..],
        &["reindex", &packed, "-o", &out],
        &["slice", &packed, "--end", "1", "-o", &out],
        &["merge", &packed, &packed, "-o", &out],
    ] {
        let text = complaint(&[arguments, &small].concat());
        let expected = "bytes of memory, and the limit leaves 1024; --memory-budget allows more";
        assert!(text.contains(expected), "{arguments:?}: {text}");
        let enough = [arguments, &["--memory-budget", "1MiB"]].concat();
        output_of(&enough);
        if arguments.contains(&"-o") {
            std::fs::remove_file(&out).unwrap();
        }
    }
    let old = path("old.bag");
    std::fs::write(&old, old_format(50)).unwrap();
    let text = complaint(&[&["info", &old][..], &small].concat());
    assert!(text.contains("--memory-budget allows more"), "{text}");
}
