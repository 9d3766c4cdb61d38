//! YAML as a tree: what rosbag2 writes, and no more of the language than that.
//!
//! The parser gives events, of which a tree is made here, so that its depth has a bound and an
//! alias, by which a short text can stand for an endless one, is refused.

use saphyr_parser::{Event, Parser};

use crate::Rosbag2Error;

/// rosbag2 nests eight deep.
const MOST_DEPTH: usize = 16;

/// A part of the text, with the line where it begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Node {
    pub line: usize,
    pub value: Value,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Value {
    /// As it is written, without quotes.
    Scalar(String),
    List(Vec<Node>),
    /// In the order of the text; a key may come twice.
    Map(Vec<(String, Node)>),
}

impl Node {
    /// The value of a key; `None` also where this is no map.
    pub fn get(&self, key: &str) -> Option<&Node> {
        match &self.value {
            Value::Map(entries) => entries.iter().find(|(name, _)| name == key).map(|(_, at)| at),
            _ => None,
        }
    }

    /// The text of a scalar; empty for YAML's `null`.
    pub fn text(&self) -> Option<&str> {
        match &self.value {
            Value::Scalar(text) if text == "~" || text == "null" => Some(""),
            Value::Scalar(text) => Some(text),
            _ => None,
        }
    }

    /// The parts of a list.
    pub fn list(&self) -> Option<&[Node]> {
        match &self.value {
            Value::List(parts) => Some(parts),
            _ => None,
        }
    }

    /// The same as YAML again, as rosbag2 writes quality of service into one string.
    pub fn write(&self, indent: usize, out: &mut String) {
        match &self.value {
            Value::Scalar(text) => out.push_str(text),
            Value::List(parts) => {
                for part in parts {
                    begin_line(indent, out);
                    out.push_str("- ");
                    part.write(indent + 2, out);
                }
            }
            Value::Map(entries) => {
                for (at, (key, value)) in entries.iter().enumerate() {
                    // The first key of a map in a list stands behind its dash.
                    if at > 0 || !out.ends_with("- ") {
                        begin_line(indent, out);
                    }
                    out.push_str(key);
                    out.push_str(": ");
                    if !matches!(value.value, Value::Scalar(_)) {
                        out.truncate(out.trim_end_matches(' ').len());
                    }
                    value.write(indent + 2, out);
                }
            }
        }
    }
}

fn begin_line(indent: usize, out: &mut String) {
    if !out.is_empty() {
        out.push('\n');
    }
    out.extend(std::iter::repeat_n(' ', indent));
}

/// A list or a map that is not closed yet.
struct Open {
    node: Node,
    /// Of a map, the key whose value comes next.
    key: Option<String>,
}

/// The one document that the text has.
pub(crate) fn document(text: &str) -> Result<Node, Rosbag2Error> {
    let mut open: Vec<Open> = Vec::new();
    let mut found = None;
    for event in Parser::new_from_str(text) {
        let (event, span) = event.map_err(|error| {
            Rosbag2Error::metadata(error.marker().line(), format!("YAML ({})", error.info()))
        })?;
        let line = span.start.line();
        let value = match event {
            Event::Alias(_) => return Err(Rosbag2Error::metadata(line, "no alias of YAML")),
            Event::Scalar(text, ..) => Value::Scalar(text.into_owned()),
            Event::SequenceStart(..) => Value::List(Vec::new()),
            Event::MappingStart(..) => Value::Map(Vec::new()),
            Event::SequenceEnd | Event::MappingEnd => match open.pop() {
                Some(Open { node, .. }) => {
                    close(node, &mut open, &mut found)?;
                    continue;
                }
                None => continue,
            },
            _ => continue,
        };
        let node = Node { line, value };
        if matches!(node.value, Value::Scalar(_)) {
            close(node, &mut open, &mut found)?;
        } else if open.len() == MOST_DEPTH {
            let expected = format!("at most {MOST_DEPTH} maps and lists within each other");
            return Err(Rosbag2Error::metadata(line, expected));
        } else {
            open.push(Open { node, key: None });
        }
    }
    found.ok_or_else(|| Rosbag2Error::metadata(0, "a document, found none"))
}

/// Puts a part that is whole into what it stands in.
fn close(node: Node, open: &mut [Open], found: &mut Option<Node>) -> Result<(), Rosbag2Error> {
    let Some(around) = open.last_mut() else {
        if found.is_some() {
            return Err(Rosbag2Error::metadata(node.line, "one document, found a second"));
        }
        *found = Some(node);
        return Ok(());
    };
    match (&mut around.node.value, around.key.take(), node.value) {
        (Value::List(parts), _, value) => parts.push(Node { line: node.line, value }),
        (Value::Map(entries), Some(key), value) => {
            entries.push((key, Node { line: node.line, value }));
        }
        (Value::Map(_), None, Value::Scalar(key)) => around.key = Some(key),
        _ => return Err(Rosbag2Error::metadata(node.line, "a key of one word")),
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::document;

    fn written(text: &str) -> String {
        let mut out = String::new();
        document(text).unwrap().write(0, &mut out);
        out
    }

    #[test]
    fn a_list_of_maps_is_written_as_rosbag2_writes_it() {
        let text = "- history: 3\n  deadline:\n    sec: 9\n    nsec: 1\n  depth: 0\n- history: 1";
        assert_eq!(written(text), text);
        assert_eq!(written("[{a: 1, b: [x, y]}, z]"), "- a: 1\n  b:\n    - x\n    - y\n- z");
        assert_eq!(written("[]"), "");
    }

    #[test]
    fn bombs_are_refused() {
        let laughs = "a: &a [x, x]\nb: &b [*a, *a]\n";
        assert!(document(laughs).unwrap_err().to_string().contains("line 2: expected no alias"));
        let deep = |times: usize| document(&"[".repeat(times)).unwrap_err().to_string();
        assert!(deep(20).contains("line 1: expected at most 16 maps"), "{}", deep(20));
        assert!(deep(1_000_000).contains("expected YAML"), "{}", deep(1_000_000));
        assert!(document("a: 1\n---\nb: 2").unwrap_err().to_string().contains("a second"));
        assert!(document("? [a]\n: 1").unwrap_err().to_string().contains("a key of one word"));
        assert!(document("a: 'b").is_err() && document("").is_err());
    }
}
