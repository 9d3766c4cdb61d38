//! The MD5 sum of a ROS 1 type, from its full definition.
//!
//! The rule is ROS's own: without comments and blank lines, constants first, then the fields
//! in their order, each message type replaced by its own sum.

use std::collections::HashMap;

use md5::{Digest, Md5};

/// What stands between the definitions of a type and of those that it uses.
const SEPARATOR: &str =
    "================================================================================";
const BUILT_IN: [&str; 16] = [
    "bool", "byte", "char", "duration", "float32", "float64", "int16", "int32", "int64", "int8",
    "string", "time", "uint16", "uint32", "uint64", "uint8",
];
/// Types within types; real ones have five.
const MOST_DEEP: usize = 64;

/// The sum of the type of that name, as 32 hexadecimal digits; `None` when its definition
/// lacks a type that it uses, or is not written as ROS 1's.
pub fn ros1_md5(datatype: &str, definition: &str) -> Option<String> {
    let mut parts = definition.split(SEPARATOR);
    let mut types = HashMap::from([(datatype, parts.next()?)]);
    for part in parts {
        let (name, text) = part.trim_start_matches(['\r', '\n']).split_once('\n')?;
        types.entry(name.strip_prefix("MSG: ")?.trim()).or_insert(text);
    }
    Sums { types, known: HashMap::new() }.of(datatype, 0)
}

struct Sums<'a> {
    /// Texts by the types' names.
    types: HashMap<&'a str, &'a str>,
    known: HashMap<&'a str, String>,
}

impl<'a> Sums<'a> {
    fn of(&mut self, name: &str, depth: usize) -> Option<String> {
        let (name, text) = self.types.get_key_value(name).map(|(name, text)| (*name, *text))?;
        if let Some(sum) = self.known.get(name) {
            return Some(sum.clone());
        }
        if depth > MOST_DEEP {
            return None;
        }
        let (mut constants, mut fields) = (Vec::new(), Vec::new());
        for line in text.lines() {
            let bare = line.split('#').next().unwrap_or_default().trim();
            if bare.is_empty() {
                continue;
            }
            if bare.contains('=') {
                constants.push(constant(line, bare)?);
            } else {
                fields.push(self.field(name, bare, depth)?);
            }
        }
        constants.append(&mut fields);
        let digest = Md5::digest(constants.join("\n").trim());
        let sum: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
        self.known.insert(name, sum.clone());
        Some(sum)
    }

    fn field(&mut self, of: &str, line: &str, depth: usize) -> Option<String> {
        let mut words = line.split_whitespace();
        let (datatype, name) = (words.next()?, words.next()?);
        let single = datatype.split('[').next()?;
        if BUILT_IN.contains(&single) {
            return Some(format!("{datatype} {name}"));
        }
        let full = match (single, of.rsplit_once('/')) {
            // Where it was before it had a package of its own.
            ("Header", _) if self.types.contains_key("roslib/Header") => "roslib/Header".to_owned(),
            ("Header", _) => "std_msgs/Header".to_owned(),
            (single, Some((package, _))) if !single.contains('/') => format!("{package}/{single}"),
            (single, _) => single.to_owned(),
        };
        Some(format!("{} {name}", self.of(&full, depth + 1)?))
    }
}

/// `TYPE NAME=VALUE`; the value of a string is all of its line, `#` among it.
fn constant(line: &str, bare: &str) -> Option<String> {
    let line = line.trim_start();
    let (datatype, _) = bare.split_once(char::is_whitespace)?;
    let text = if datatype == "string" { line } else { bare };
    let (name, value) = text.get(datatype.len()..)?.split_once('=')?;
    Some(format!("{datatype} {}={}", name.trim(), value.trim()))
}

#[cfg(test)]
mod tests {
    use super::ros1_md5;

    /// Constants behind fields, and with a comment: the sum has them first, and bare.
    const POINT_FIELD: &str = "string name # x\nuint32 offset\nuint8 datatype\nuint32 count\n\
        uint8 INT8    = 1\nuint8 UINT8=2\nuint8 INT16 =3 # two bytes\nuint8 UINT16  = 4\n\
        uint8 INT32   = 5\nuint8 UINT32  = 6\nuint8 FLOAT32 = 7\nuint8 FLOAT64 = 8\n";

    #[test]
    fn known_types_have_their_known_sums() {
        let header = "uint32 seq\ntime stamp\nstring frame_id\n";
        for (datatype, definition, sum) in [
            ("sensor_msgs/PointField", POINT_FIELD, "268eacb2962780ceac86cbd17e328150"),
            ("std_msgs/String", "string data\n", "992ce8a1687cec8c8bd883ec73ca41d1"),
            ("std_msgs/Empty", "", "d41d8cd98f00b204e9800998ecf8427e"),
            ("std_msgs/Header", &format!("# what\n\n{header}"), "2176decaecbce78abc3b96ef049fabed"),
            (
                "std_msgs/Header",
                &header.replace('\n', "  # why \r\n"),
                "2176decaecbce78abc3b96ef049fabed",
            ),
        ] {
            assert_eq!(ros1_md5(datatype, definition).as_deref(), Some(sum), "{datatype}");
        }
    }

    #[test]
    fn what_is_no_definition_has_no_sum() {
        let line = "=".repeat(80);
        for definition in [
            "Point p\n",
            "string\n",
            "int8 A=1\n=\n",
            &format!("Point p\n{line}\nfloat64 x\n"),
            &format!("Point p\n{line}\nMSG: a/Point\nPoint p\n"),
        ] {
            assert_eq!(ros1_md5("a/B", definition), None, "{definition:?}");
        }
        let used = format!("Point p\n{line}\nMSG: a/Point\nfloat64 x\n");
        assert!(ros1_md5("a/B", &used).is_some());
    }

    #[test]
    fn types_that_use_each_other_twice_are_summed_once() {
        let line = "=".repeat(80);
        let mut definition = "T0 a\nT0 b\n".to_owned();
        for at in 0..60 {
            definition += &format!("{line}\nMSG: p/T{at}\nT{next} a\nT{next} b\n", next = at + 1);
        }
        definition += &format!("{line}\nMSG: p/T60\nint8 x\n");
        assert!(ros1_md5("p/Top", &definition).is_some());
    }
}
