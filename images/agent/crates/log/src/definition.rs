//! Whether two definitions of a type lay its messages out alike.

use std::collections::BTreeMap;

/// Types that belong to no package.
const PRIMITIVES: [&str; 17] = [
    "bool", "byte", "char", "float32", "float64", "int8", "uint8", "int16", "uint16", "int32",
    "uint32", "int64", "uint64", "string", "wstring", "time", "duration",
];
/// Characters of a field that are shown.
const MOST_SHOWN: usize = 80;

/// The first field that two definitions of a type have differently, as each of them has it; `None`
/// where messages of both are laid out alike.
///
/// Compared is what ROS 2's own hash of a type is made of, the fields' types and names: so comments,
/// blanks, constants and default values make no difference. A type that only one of the definitions
/// has is passed over, and so are definitions that are empty or interface files (IDL).
pub fn different_field(datatype: &str, one: &str, other: &str) -> Option<[String; 2]> {
    let unknown = |text: &str| text.trim().is_empty() || is_interface_file(text);
    if one == other || unknown(one) || unknown(other) {
        return None;
    }
    let (one, other) = (fields(datatype, one), fields(datatype, other));
    one.iter().find_map(|(name, fields)| {
        let known = other.get(name)?;
        let at = (0..fields.len().max(known.len())).find(|at| fields.get(*at) != known.get(*at))?;
        Some([fields, known].map(|all| match all.get(at) {
            Some(field) => {
                let field: String = field.chars().take(MOST_SHOWN).collect();
                format!("field {} of {name}: {field}", at + 1)
            }
            None => format!("{} fields of {name}", all.len()),
        }))
    })
}

/// In what two types differ, as each of them has it: in their MD5 sums, or in ROS 2, which has none,
/// in their first other field. They are given as name, MD5 sum and definition; `None` where they are
/// one type.
pub fn another_type(one: [&str; 3], other: [&str; 3]) -> Option<[String; 2]> {
    let ([datatype, sum, definition], [other_type, other_sum, other_definition]) = (one, other);
    if datatype != other_type || sum != other_sum {
        return Some([sum, other_sum].map(str::to_owned));
    }
    match sum {
        "" => different_field(datatype, definition, other_definition),
        _ => None,
    }
}

/// Whether a definition is one of IDL (`ros2idl`): a line of it begins with a module or struct, as
/// no comment of a message file does.
pub fn is_interface_file(definition: &str) -> bool {
    let mut lines = definition.lines().map(str::trim_start);
    lines.any(|line| line.starts_with("module ") || line.starts_with("struct "))
}

/// The fields of each type that a definition has: its own, and behind lines of `=` others.
fn fields(datatype: &str, definition: &str) -> BTreeMap<String, Vec<String>> {
    let mut found: BTreeMap<String, Vec<String>> = BTreeMap::new();
    let mut name = short(datatype);
    for line in definition.lines() {
        let line = line.split('#').next().unwrap_or(line).trim();
        if let Some(next) = line.strip_prefix("MSG:") {
            name = short(next.trim());
        } else if !line.starts_with("===") {
            let fields = found.entry(name.clone()).or_default();
            fields.extend(field(line).map(|(kind, own)| format!("{} {own}", full(kind, &name))));
        }
    }
    found
}

/// The type and the name of a message file's field, of a line without its comment; `None` of a
/// constant, which takes no byte of a message, or of no field.
pub fn field(line: &str) -> Option<(&str, &str)> {
    let (kind, rest) = line.trim_start().split_once(char::is_whitespace)?;
    let rest = rest.trim_start();
    let end = rest.find(|each: char| each == '=' || each.is_whitespace()).unwrap_or(rest.len());
    let (name, value) = rest.split_at(end);
    (!name.is_empty() && !value.trim_start().starts_with('=')).then_some((kind, name))
}

/// A field's type with the package that it is of.
fn full(kind: &str, of: &str) -> String {
    let end = kind.find(['[', '<']).unwrap_or(kind.len());
    let (base, bounds) = kind.split_at(end);
    let package = of.split('/').next().unwrap_or_default();
    match base {
        "Header" => format!("std_msgs/Header{bounds}"),
        // Names of one layout, which converters write for each other.
        "byte" | "char" => format!("uint8{bounds}"),
        _ if PRIMITIVES.contains(&base) => kind.to_owned(),
        _ if base.contains('/') => format!("{}{bounds}", short(base)),
        _ => format!("{package}/{kind}"),
    }
}

/// `sensor_msgs/Imu` of `sensor_msgs/msg/Imu`.
fn short(datatype: &str) -> String {
    datatype.replacen("/msg/", "/", 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "std_msgs/Header header\nPoint[2] points\nfloat64 speed\n";
    const DEEP: &str = "Point[2] points\n\n===\nMSG: a/Point\nfloat64 x\nfloat64 y\n";

    fn different(one: &str, other: &str) -> Option<[String; 2]> {
        different_field("a/msg/Pose", one, other)
    }

    #[test]
    fn what_the_hash_of_a_type_leaves_out_makes_no_difference() {
        for other in [
            "# A pose.\nstd_msgs/msg/Header   header # stamped\n\n a/msg/Point[2]\tpoints\nfloat64 speed",
            "Header header\nint8 LEFT=1\nstring NAME = \"a # b\"\nPoint[2] points\nfloat64 speed 1.5\n",
            "",
            "module a { struct Pose { double speed; }; };",
        ] {
            assert_eq!(different(POSE, other), None, "{other}");
            assert_eq!(different(other, POSE), None, "{other}");
        }
        assert_eq!(different("byte[3] x\nchar y\n", "uint8[3] x\nuint8 y\n"), None);
        let named = "=====\nMSG: a/msg/Pose\nPoint[2] points\n===\nMSG: a/msg/Point\nfloat64 x\nfloat64 y\n";
        assert_eq!(different(DEEP, named), None);
        // The other type is not known of both.
        assert_eq!(different(DEEP, "Point[2] points\n"), None);
    }

    #[test]
    fn constants_and_comments_are_neither_fields_nor_interface_files() {
        assert_eq!(field("string<=32 name"), Some(("string<=32", "name")));
        assert_eq!(field("  string name \"a = b\""), Some(("string", "name")));
        for line in ["int8 X=3", "string NAME = 'a'", "int8 =3", "int8 ", "int8", ""] {
            assert_eq!(field(line), None, "{line}");
        }
        assert!(!is_interface_file("# To construct a map,\n# or a struct of one.\nint8 x\n"));
        assert!(is_interface_file("// A.\nmodule a {\n  struct B {\n    double x;\n  };\n};\n"));
    }

    #[test]
    fn the_first_field_that_differs_is_named_as_each_has_it() {
        for (one, other, shown) in [
            ("float64 metres\n", "int32 feet\n", ["float64 metres", "int32 feet"]),
            ("float64 x\n", "float64 y\n", ["float64 x", "float64 y"]),
            ("string<=5 x\n", "string x\n", ["string<=5 x", "string x"]),
            ("int8[3] x\n", "int8[] x\n", ["int8[3] x", "int8[] x"]),
        ] {
            let shown = shown.map(|field| format!("field 1 of a/Pose: {field}"));
            assert_eq!(different(one, other), Some(shown));
        }
        let longer = "float64 x\nint8 y\n";
        let shown = ["1 fields of a/Pose", "field 2 of a/Pose: int8 y"].map(str::to_owned);
        assert_eq!(different("float64 x\n", longer), Some(shown));
        let shown = ["field 2 of a/Point: float64 y", "field 2 of a/Point: float32 y"];
        let found = different(DEEP, &DEEP.replace("float64 y", "float32 y"));
        assert_eq!(found, Some(shown.map(str::to_owned)));
    }
}
