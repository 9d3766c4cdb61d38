//! The definitions of message types, as a recording needs them to be read elsewhere.

use std::collections::{BTreeSet, VecDeque};
use std::path::{Path, PathBuf};

use bagpipe_graph::TopicInfo;
use bagpipe_log::{different_field, is_interface_file};

/// Types of one definition: more are no message's.
const MOST_TYPES: usize = 1000;
/// Bytes of one file: a longer one is no message's.
const MOST_BYTES: u64 = 1 << 20;
const LINE: &str =
    "================================================================================";
/// Fields of these hold no other type.
const PRIMITIVES: [&str; 15] = [
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32",
    "uint32", "int64", "uint64", "string", "wstring",
];

/// The definition of a type such as `sensor_msgs/msg/Imu` with those of all types that it holds, as
/// ROS 2's recorder writes it (`ros2msg`): each after a line of `=` and its name. It is sought in the
/// prefixes where packages are installed; `None` where a file of it is missing.
pub(crate) fn installed(datatype: &str, prefixes: &[PathBuf]) -> Option<String> {
    let first = short(datatype)?;
    let mut text = file_of(&first, prefixes)?;
    let mut seen = BTreeSet::from([first.clone()]);
    let mut queue: VecDeque<String> = held(&text, package(&first)).into();
    while let Some(name) = queue.pop_front() {
        if !seen.insert(name.clone()) {
            continue;
        }
        if seen.len() > MOST_TYPES {
            return None;
        }
        let own = file_of(&name, prefixes)?;
        queue.extend(held(&own, package(&name)));
        text.push_str(&format!("\n{LINE}\nMSG: {name}\n{own}"));
    }
    Some(text)
}

/// In what a definition is written, as a recording names it.
pub(crate) fn schema_encoding(definition: &str) -> &'static str {
    if is_interface_file(definition) { "ros2idl" } else { "ros2msg" }
}

/// Why nodes would read a topic's messages as something else, where both the topic and the prefixes
/// have the type's definition: ROS 2 itself compares names of types alone.
pub(crate) fn otherwise_installed(info: &TopicInfo, prefixes: &[PathBuf]) -> Option<String> {
    let TopicInfo { topic, datatype, definition, .. } = info;
    let own = installed(datatype, prefixes)?;
    let [recorded, own] = different_field(datatype, definition, &own)?;
    Some(format!(
        "{topic} has messages of {datatype} with {recorded}, and the stack's packages have it with \
         {own}: build the stack with the recording's message definition, or leave the topic out"
    ))
}

/// `sensor_msgs/Imu` of `sensor_msgs/msg/Imu`; `None` of what is no message's name.
fn short(datatype: &str) -> Option<String> {
    let words: Vec<&str> = datatype.split('/').collect();
    let word = |word: &str| {
        !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    match words[..] {
        [package, "msg", name] | [package, name] if word(package) && word(name) => {
            Some(format!("{package}/{name}"))
        }
        _ => None,
    }
}

fn package(name: &str) -> &str {
    name.split('/').next().unwrap_or(name)
}

fn file_of(name: &str, prefixes: &[PathBuf]) -> Option<String> {
    let (package, own) = name.split_once('/')?;
    let file = Path::new("share").join(package).join("msg").join(format!("{own}.msg"));
    prefixes.iter().find_map(|prefix| {
        let path = prefix.join(&file);
        let size = std::fs::metadata(&path).ok()?.len();
        (size <= MOST_BYTES).then(|| std::fs::read_to_string(path).ok()).flatten()
    })
}

/// The types of a message file's fields but the primitive ones.
fn held(text: &str, package: &str) -> Vec<String> {
    let lines = text.lines().map(|line| line.split('#').next().unwrap_or(line).trim());
    let kinds = lines.filter_map(|line| {
        let kind = line.split_whitespace().next()?;
        let kind = kind.split(['[', '<']).next()?;
        (!PRIMITIVES.contains(&kind)).then_some(kind)
    });
    let named = kinds.filter_map(|kind| match kind {
        _ if kind.contains('/') => short(kind),
        "Header" => Some("std_msgs/Header".to_owned()),
        own => short(&format!("{package}/{own}")),
    });
    named.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Prefix(PathBuf);

    impl Prefix {
        fn new(name: &str) -> Prefix {
            let folder = format!("bagpipe_definitions_{name}_{}", std::process::id());
            Prefix(std::env::temp_dir().join(folder))
        }

        fn has(&self, package: &str, name: &str, text: &str) {
            let folder = self.0.join("share").join(package).join("msg");
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(format!("{name}.msg")), text).unwrap();
        }

        fn of(&self, datatype: &str) -> Option<String> {
            installed(datatype, &[PathBuf::from("/nowhere"), self.0.clone()])
        }
    }

    impl Drop for Prefix {
        fn drop(&mut self) {
            let _was_never_made = std::fs::remove_dir_all(&self.0);
        }
    }

    #[test]
    fn a_definition_has_each_type_that_it_holds_once() {
        let prefix = Prefix::new("nested");
        prefix.has("a", "Top", "std_msgs/Header header\nMid[3] mids # B\nint32 X=3\nMid<=2 x\n");
        prefix.has("a", "Mid", "b/msg/Low low\nstring<=5 name\nfloat64[] y\n");
        prefix.has("b", "Low", "builtin_interfaces/Time at\n");
        prefix.has("std_msgs", "Header", "builtin_interfaces/Time stamp\nstring frame_id\n");
        prefix.has("builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n");
        let text = prefix.of("a/msg/Top").unwrap();
        let names: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("MSG: ")).collect();
        assert_eq!(names, ["std_msgs/Header", "a/Mid", "builtin_interfaces/Time", "b/Low"]);
        assert!(text.starts_with("std_msgs/Header header\n"));
        assert_eq!(text.matches(LINE).count(), 4);
    }

    #[test]
    fn a_comment_makes_no_message_file_an_interface_file() {
        assert_eq!(schema_encoding("# What it takes to construct a map.\nint8 x\n"), "ros2msg");
        assert_eq!(
            schema_encoding("module a {\n  struct B {\n    octet x;\n  };\n};\n"),
            "ros2idl"
        );
    }

    #[test]
    fn a_type_that_has_changed_since_the_recording_is_named_with_both_fields() {
        let prefix = Prefix::new("changed");
        prefix.has("a", "Speed", "# In m/s.\nstd_msgs/Header header\nfloat64 speed\n");
        prefix.has("std_msgs", "Header", "string frame_id\n");
        let of = |definition: &str| {
            let (topic, datatype) = ("/speed".to_owned(), "a/msg/Speed".to_owned());
            let info = TopicInfo {
                topic,
                datatype,
                definition: definition.into(),
                ..TopicInfo::default()
            };
            otherwise_installed(&info, std::slice::from_ref(&prefix.0))
        };
        for alike in ["", "std_msgs/Header header\nfloat64 speed 1.0\n===\nMSG: b/Other\nint8 x\n"]
        {
            assert_eq!(of(alike), None);
        }
        let why = of("std_msgs/Header header\nfloat32 speed\n").unwrap();
        let fields = "with field 2 of a/Speed: float32 speed, and the stack's packages have it with \
                      field 2 of a/Speed: float64 speed";
        assert!(why.starts_with("/speed has messages of a/msg/Speed ") && why.contains(fields));
        let nested = "std_msgs/Header header\nfloat64 speed\n===\nMSG: std_msgs/Header\nint8 x\n";
        assert!(of(nested).unwrap().contains("field 1 of std_msgs/Header: int8 x"));
    }

    #[test]
    fn what_is_missing_or_no_name_has_no_definition() {
        let prefix = Prefix::new("missing");
        prefix.has("a", "Top", "b/Absent x\n");
        prefix.has("a", "Self", "Self again\n");
        for name in ["a/msg/Top", "a/msg/None", "a", "a/srv/Top", "../a/Top", "a//Top", "/etc/x"] {
            assert_eq!(prefix.of(name), None, "{name}");
        }
        assert_eq!(prefix.of("a/Self").as_deref(), Some("Self again\n"));
    }
}
