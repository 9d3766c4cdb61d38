//! MCAP by the kept libraries of three languages, and by ours: what each of them writes, in every
//! form that it can write, all of them read alike, message by message.
//!
//! PyPI's library runs in the checkout's .venv, as does Node.js; npm's packages lie in the cache.
//! `make set-up` puts them there, and where one is missing this fails.
#![allow(clippy::unwrap_used, clippy::expect_used)]

#[path = "languages/by_rust.rs"]
mod by_rust;
#[path = "languages/content.rs"]
mod content;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use bagpipe_mcap::tail;
use content::{Form, forms, plan};
use serde_json::Value;

const HERE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/languages");
const HOW: &str = "`make set-up` installs it";

fn tool(name: &str) -> PathBuf {
    let checkout = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../..");
    let found = checkout.join(".venv/bin").join(name);
    assert!(found.exists(), "{} is not there: {HOW}", found.display());
    found
}

/// Where npm's packages are; those that the lock names, and no others.
fn modules() -> PathBuf {
    let cache = std::env::var_os("BAGPIPE_CACHE").map_or_else(
        || PathBuf::from(std::env::var_os("HOME").unwrap()).join(".cache/bagpipe"),
        PathBuf::from,
    );
    let found = cache.join("npm/mcap");
    let lock = |folder: &Path| std::fs::read_to_string(folder.join("package-lock.json"));
    let installed = found.join("node_modules").is_dir().then(|| lock(&found).unwrap_or_default());
    let wanted = lock(Path::new(HERE)).unwrap();
    assert!(
        installed == Some(wanted),
        "{} has not the packages of tests/languages/package-lock.json: {HOW}",
        found.display()
    );
    found
}

fn python(verb: &str, first: &Path, second: &Path) -> Child {
    start(Command::new(tool("python")).arg(format!("{HERE}/by_python.py")), verb, first, second)
}

fn javascript(verb: &str, first: &Path, second: &Path) -> Child {
    let script = format!("{HERE}/by_javascript.cjs");
    start(Command::new(tool("node")).arg(script).arg(modules()), verb, first, second)
}

fn start(command: &mut Command, verb: &str, first: &Path, second: &Path) -> Child {
    let command = command.arg(verb).arg(first).arg(second).stderr(Stdio::piped());
    command.spawn().expect("the other language's program starts")
}

fn finished(name: &str, child: Child) {
    let done = child.wait_with_output().unwrap();
    assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
}

/// What a library found in each file.
fn found(file: &Path) -> BTreeMap<String, Value> {
    serde_json::from_slice(&std::fs::read(file).unwrap()).unwrap()
}

/// What a planner finds by the summary alone: how many messages; an error where it needs more.
fn planned(bytes: &[u8]) -> Result<u32, bagpipe_log::Refusal> {
    let head = tail::parse_head(bytes)?;
    let size = bytes.len() as u64;
    let footer = &bytes[bytes.len() - tail::FOOTER_BYTES as usize..];
    let (begin, end) = tail::parse_footer(footer, size)?;
    let index = tail::parse_summary(&bytes[begin as usize..end as usize], begin, head, footer)?;
    Ok(index.chunks.iter().flat_map(|chunk| &chunk.counts).map(|(_, count)| count).sum())
}

/// Each form by each writer that has it.
fn write_all(forms: &[Form], place: &Path, files: &Path) {
    let asked = place.join("plan.json");
    std::fs::write(&asked, plan(forms).to_string()).unwrap();
    let others =
        [("PyPI", python("write", &asked, files)), ("npm", javascript("write", &asked, files))];
    for (number, form) in forms.iter().enumerate() {
        std::fs::write(files.join(format!("rust-{number}.mcap")), by_rust::theirs(form)).unwrap();
        if form.is_ours() {
            std::fs::write(files.join(format!("ours-{number}.mcap")), by_rust::ours(form)).unwrap();
        }
    }
    others.into_iter().for_each(|(name, child)| finished(name, child));
}

#[test]
fn all_languages_and_ours_read_what_each_of_them_writes() {
    let place = tempfile::tempdir().unwrap();
    let files = place.path().join("files");
    std::fs::create_dir(&files).unwrap();
    let forms = forms();
    write_all(&forms, place.path(), &files);
    let outputs = ["python.json", "javascript.json"].map(|name| place.path().join(name));
    let others = [
        ("PyPI", python("read", &files, &outputs[0])),
        ("npm", javascript("read", &files, &outputs[1])),
    ];
    let mut read: Vec<(&str, BTreeMap<String, Value>)> =
        vec![("the crate", BTreeMap::new()), ("ours", BTreeMap::new())];
    let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
    for file in std::fs::read_dir(&files).unwrap() {
        let path = file.unwrap().path();
        let name = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let (writer, number) = name.split_once('-').unwrap();
        let form = &forms[number.parse::<usize>().unwrap()];
        let bytes = std::fs::read(&path).unwrap();
        let writer =
            ["python", "javascript", "rust", "ours"].into_iter().find(|each| *each == writer);
        *counts.entry(writer.unwrap()).or_default() += 1;
        match planned(&bytes) {
            Ok(messages) => assert_eq!(messages as usize, content::MESSAGES, "{name}: {form:?}"),
            Err(refusal) => assert!(!form.is_planned(), "{name}: {form:?}: {refusal}"),
        }
        read[0].1.insert(name.clone(), by_rust::read_by_theirs(&bytes));
        read[1].1.insert(name, by_rust::read_by_ours(bytes));
    }
    others.into_iter().for_each(|(name, child)| finished(name, child));
    read.extend(["PyPI", "npm"].into_iter().zip(outputs.iter().map(|output| found(output))));

    let written = forms.len();
    let with_sums = forms.iter().filter(|form| form.crc).count();
    let of_ours = forms.iter().filter(|form| form.is_ours()).count();
    assert_eq!((written, with_sums, of_ours), (504, 252, 12));
    let expected =
        [("javascript", with_sums), ("ours", of_ours), ("python", written), ("rust", written)];
    assert_eq!(counts, BTreeMap::from(expected));
    for (reader, files) in &read {
        assert_eq!(files.len(), counts.values().sum::<usize>(), "{reader}");
        for (name, held) in files {
            let number: usize = name.split_once('-').unwrap().1.parse().unwrap();
            compare(reader, name, &forms[number], held);
        }
    }
    let by_index = read.iter().map(|(reader, files)| (*reader, read_by_index(files)));
    let expected = [("the crate", 0), ("ours", 0), ("PyPI", 552), ("npm", 132)];
    assert_eq!(by_index.collect::<Vec<_>>(), expected);
}

fn read_by_index(files: &BTreeMap<String, Value>) -> usize {
    files.values().filter(|held| !held["by_index"].is_null()).count()
}

fn compare(reader: &str, name: &str, form: &Form, held: &Value) {
    let by_time = |messages: &Value| {
        let mut messages = messages.as_array().unwrap().clone();
        messages.sort_by_key(|each| each[4].as_str().unwrap().to_owned());
        Value::from(messages)
    };
    let expected = content::held(form);
    assert_eq!(by_time(&held["messages"]), expected["messages"], "{reader}, {name}: {form:?}");
    for part in ["attachments", "metadata"] {
        assert_eq!(held[part], expected[part], "{reader}, {name}: {form:?}");
    }
    match &held["by_index"] {
        // The libraries of Python and JavaScript say where they find no indexes that they read by.
        Value::Null => {
            assert!(!form.is_planned() || ["the crate", "ours"].contains(&reader), "{name}")
        }
        found => assert_eq!(by_time(found), expected["messages"], "{reader}, {name}: {form:?}"),
    }
}
