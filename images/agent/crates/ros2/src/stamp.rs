//! The stamp of messages that begin with a std_msgs/Header.

use bagpipe_graph::ReadStamp;
use bagpipe_log::{field, is_interface_file};

/// How to read the stamps of messages of this definition, which is in ROS 2's message files or
/// its interface files; `None` if they have none.
pub(crate) fn reader(definition: &str) -> Option<ReadStamp> {
    let kind = match is_interface_file(definition) {
        true => first_member(definition),
        false => first_field(definition),
    };
    let has_header =
        matches!(kind, Some("Header" | "std_msgs/Header" | "std_msgs/msg/Header" | HEADER_IN_IDL));
    has_header.then_some(stamp as ReadStamp)
}

const HEADER_IN_IDL: &str = "std_msgs::msg::Header";

/// The type of the first field of a message file.
fn first_field(definition: &str) -> Option<&str> {
    let lines = definition.lines().map(|line| line.split('#').next().unwrap_or(line).trim());
    let mut own = lines
        .skip_while(|line| line.starts_with("===") || line.starts_with("MSG:"))
        .take_while(|line| !line.starts_with("==="));
    own.find_map(field).map(|(kind, _)| kind)
}

/// The type of the first member of the first struct of an interface file.
fn first_member(definition: &str) -> Option<&str> {
    // A comment may have the word as well.
    let begins = |(at, _): &(usize, &str)| {
        let before = definition[..*at].trim_end_matches([' ', '\t']);
        before.is_empty() || before.ends_with(['\n', '{'])
    };
    let (at, _) = definition.match_indices("struct ").find(begins)?;
    let (_, inside) = definition[at..].split_once('{')?;
    let mut lines = inside.lines().map(str::trim);
    let member = lines.find(|line| line.starts_with(|first: char| first.is_ascii_alphabetic()))?;
    member.split_whitespace().next()
}

/// The stamp of a message in CDR that begins with a header, in nanoseconds: behind the head of four
/// bytes, whose second says the byte order, `int32 sec` and `uint32 nanosec`.
fn stamp(data: &[u8]) -> Option<u64> {
    let little = data.get(1)? & 1 == 1;
    let number = |at: usize| {
        let bytes = *data.get(at..)?.first_chunk::<4>()?;
        Some(if little { u32::from_le_bytes(bytes) } else { u32::from_be_bytes(bytes) })
    };
    let seconds = number(4)?.cast_signed();
    Some(u64::try_from(seconds).ok()? * 1_000_000_000 + u64::from(number(8)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_header_counts_only_as_the_first_field() {
        let has = |definition: &str| reader(definition).is_some();
        assert!(has("# a comment\nint32 A=4\nstd_msgs/Header header # stamp\nfloat64 x\n"));
        assert!(has("std_msgs/msg/Header header\n"));
        assert!(!has("float64 x\nstd_msgs/Header header\n"));
        assert!(!has("string data\n===\nMSG: std_msgs/Header\nstd_msgs/Header header\n"));
        assert!(!has(""));
        assert!(has("# What it takes to construct a map.\nstd_msgs/Header header\n"));
        for first in ["string<=32 name", "float64 limit 1.5", "string name \"a = b\""] {
            assert!(!has(&format!("{first}\nstd_msgs/Header header\n")), "{first}");
        }
        for constant in ["uint8 LEFT=1", "uint8 LEFT = 1", "string<=32 NAME = 'a b'"] {
            assert!(has(&format!("{constant}\nstd_msgs/Header header\n")), "{constant}");
        }
    }

    #[test]
    fn interface_files_are_read_to_their_first_member() {
        let idl = "=====\nIDL: a/msg/B\n#include \"std_msgs/msg/Header.idl\"\nmodule a {\n\
                   module msg {\n  @verbatim (language=\"comment\")\n  struct B {\n    \
                   @verbatim (x)\n    std_msgs::msg::Header header;\n    double x;\n  };\n};\n};\n";
        assert!(reader(idl).is_some());
        let other = idl.replace("    std_msgs::msg::Header header;\n", "");
        assert!(reader(&other).is_none());
        let comment = "module a {\n  // Not struct C { double x; }\n";
        assert!(reader(&idl.replace("module a {\n", comment)).is_some());
        let short = "module a { struct B { std_msgs::msg::Header header; }; };\n";
        assert!(reader(short).is_some());
    }

    #[test]
    fn the_stamp_lies_behind_the_head_in_either_byte_order() {
        let read = reader("std_msgs/Header header\n").unwrap();
        let little = [[0, 1, 0, 0], 3i32.to_le_bytes(), 7u32.to_le_bytes()].concat();
        let big = [[0, 0, 0, 0], 3i32.to_be_bytes(), 7u32.to_be_bytes()].concat();
        assert_eq!((read(&little), read(&big)), (Some(3_000_000_007), Some(3_000_000_007)));
        for length in 0..12 {
            assert_eq!(read(&little[..length]), None, "{length}");
        }
        let before = [[0, 1, 0, 0], (-1i32).to_le_bytes(), [0; 4]].concat();
        assert_eq!(read(&before), None);
    }
}
