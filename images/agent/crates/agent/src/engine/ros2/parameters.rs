//! Parameters as a file of ROS 2's, and the command that reads it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use rmpv::Value;

/// Programs that start others, which would take our arguments for their own.
const LAUNCHERS: [&str; 7] = ["bash", "sh", "dash", "zsh", "env", "python3", "roslaunch"];

/// The parameter that lets a node run on simulated time.
const SIM_TIME: &str = "use_sim_time";

/// Whether some node runs on simulated time.
pub fn use_sim_time(parameters: &BTreeMap<String, Value>) -> bool {
    parameters.iter().any(|(name, value)| {
        split(name).is_some_and(|(_, own)| own == SIM_TIME) && *value == Value::Boolean(true)
    })
}

/// A parameter file: names are those of a node with the parameter's own behind the last slash. The
/// error is a sentence that names the first that can't be written.
pub fn file(parameters: &BTreeMap<String, Value>) -> Result<String, String> {
    let mut nodes: BTreeMap<&str, Vec<(&str, String)>> = BTreeMap::new();
    for (name, value) in parameters {
        let fail = |why: String| format!("the parameter {name} cannot be set: {why}");
        let (node, own) = split(name)
            .ok_or_else(|| fail("it names no node: write /node/parameter".to_owned()))?;
        nodes.entry(node).or_default().push((own, yaml(value).map_err(fail)?));
    }
    let mut text = String::new();
    for (node, parameters) in nodes {
        // Writing to a string can't fail.
        let _ = writeln!(text, "{}:\n  ros__parameters:", quoted(node));
        for (own, value) in parameters {
            let _ = writeln!(text, "    {}: {value}", quoted(own));
        }
    }
    Ok(text)
}

/// The command with the file as an argument; a launcher passes it on by itself, or not at all
/// (BAGPIPE_PARAMETERS names it).
pub fn with_file(command: &[String], file: &Path) -> Vec<String> {
    let mut command = command.to_vec();
    let program = command.first().map(|program| program.rsplit('/').next().unwrap_or(program));
    let launches = match program {
        Some("ros2") => command.get(1).is_none_or(|verb| verb != "run"),
        Some(program) => LAUNCHERS.contains(&program),
        None => true,
    };
    if !launches {
        let file = file.display().to_string();
        command.extend(["--ros-args".to_owned(), "--params-file".to_owned(), file]);
    }
    command
}

fn split(name: &str) -> Option<(&str, &str)> {
    name.rsplit_once('/').filter(|(node, own)| !node.is_empty() && !own.is_empty())
}

fn yaml(value: &Value) -> Result<String, String> {
    Ok(match value {
        Value::Boolean(value) => value.to_string(),
        Value::Integer(value) => match value.as_i64() {
            Some(value) => value.to_string(),
            None => return Err(format!("{value} does not fit into 64 bits with a sign")),
        },
        Value::F32(value) => number(f64::from(*value)),
        Value::F64(value) => number(*value),
        Value::String(text) => {
            quoted(text.as_str().ok_or_else(|| "it holds text that is not UTF-8".to_owned())?)
        }
        Value::Array(items) => {
            let items = items.iter().map(yaml).collect::<Result<Vec<_>, _>>()?;
            format!("[{}]", items.join(", "))
        }
        Value::Map(entries) => {
            let entries = entries.iter().map(|(key, value)| {
                let key = key.as_str().ok_or_else(|| format!("its key {key} is no text"))?;
                Ok(format!("{}: {}", quoted(key), yaml(value)?))
            });
            format!("{{{}}}", entries.collect::<Result<Vec<_>, String>>()?.join(", "))
        }
        Value::Nil => return Err("ROS parameters cannot be null; leave it out".to_owned()),
        Value::Binary(_) | Value::Ext(..) => {
            return Err("it is binary, which cannot be written into a parameter file".to_owned());
        }
    })
}

/// A number that is read as one with a fraction.
fn number(value: f64) -> String {
    match value {
        _ if value.is_nan() => ".nan".to_owned(),
        _ if value.is_infinite() => if value > 0.0 { ".inf" } else { "-.inf" }.to_owned(),
        _ => format!("{value:?}"),
    }
}

/// A text in double quotes, as YAML and JSON write it.
fn quoted(text: &str) -> String {
    let mut quoted = String::from("\"");
    for letter in text.chars() {
        match letter {
            '"' => quoted.push_str("\\\""),
            '\\' => quoted.push_str("\\\\"),
            _ if letter.is_control() => {
                let _ = write!(quoted, "\\u{:04x}", u32::from(letter));
            }
            _ => quoted.push(letter),
        }
    }
    quoted.push('"');
    quoted
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(entries: &[(&str, Value)]) -> BTreeMap<String, Value> {
        entries.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect()
    }

    #[test]
    fn each_node_has_its_parameters() {
        let all = parameters(&[
            ("/a/gain", Value::F64(1.0)),
            ("/a/names", Value::Array(vec!["x\"\n".into(), "y".into()])),
            ("/**/use_sim_time", true.into()),
            ("/ns/b/pid", Value::Map(vec![("p".into(), 3.into()), ("i".into(), Value::F64(1e20))])),
        ]);
        let expected = "\"/**\":\n  ros__parameters:\n    \"use_sim_time\": true\n\
                        \"/a\":\n  ros__parameters:\n    \"gain\": 1.0\n    \
                        \"names\": [\"x\\\"\\u000a\", \"y\"]\n\
                        \"/ns/b\":\n  ros__parameters:\n    \"pid\": {\"p\": 3, \"i\": 1e20}\n";
        assert_eq!(file(&all).as_deref(), Ok(expected));
        assert!(use_sim_time(&all));
        assert!(!use_sim_time(&parameters(&[("/a/use_sim_time", false.into())])));
    }

    #[test]
    fn what_no_node_could_have_is_refused() {
        let refused = |name: &str, value: Value| file(&parameters(&[(name, value)])).unwrap_err();
        assert!(refused("/gain", 1.into()).contains("names no node"));
        assert!(refused("/a/gain", Value::Nil).contains("leave it out"));
        assert!(refused("/a/gain", u64::MAX.into()).contains("64 bits"));
        assert!(refused("/a/gain", Value::Binary(vec![1])).contains("binary"));
    }

    #[test]
    fn launchers_get_no_arguments() {
        let words = |text: &str| text.split(' ').map(str::to_owned).collect::<Vec<_>>();
        let file = Path::new("/f");
        for command in ["bash -c x", "ros2 launch a b.py", "/usr/bin/env x", "python3 a.py"] {
            assert_eq!(with_file(&words(command), file), words(command));
        }
        for command in ["ros2 run a b", "/opt/x/node"] {
            let expected = format!("{command} --ros-args --params-file /f");
            assert_eq!(with_file(&words(command), file), words(&expected));
        }
    }
}
