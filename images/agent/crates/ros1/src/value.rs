//! Values of ROS parameters and XML-RPC calls.

use std::collections::BTreeMap;

use crate::RosError;

/// A parameter value: what XML-RPC and MessagePack have in common.
#[derive(Clone, Debug, PartialEq)]
pub enum Value {
    /// `boolean`
    Bool(bool),
    /// `i4`: 32 bits on the wire; a larger one is an error when it is sent.
    Int(i64),
    /// `double`
    Double(f64),
    /// `string`
    String(String),
    /// `base64`
    Binary(Vec<u8>),
    /// `dateTime.iso8601`, as the wire has it.
    Date(String),
    /// `array`
    List(Vec<Value>),
    /// `struct`
    Map(BTreeMap<String, Value>),
}

impl Value {
    /// The XML-RPC form.
    ///
    /// # Errors
    /// [`RosError::IntegerTooLarge`] for an integer beyond 32 bits, at any depth.
    pub(crate) fn to_wire(&self) -> Result<dxr::Value, RosError> {
        Ok(match self {
            Value::Bool(b) => dxr::Value::Boolean(*b),
            Value::Int(i) => {
                dxr::Value::Integer(i32::try_from(*i).map_err(|_| RosError::IntegerTooLarge(*i))?)
            }
            Value::Double(d) => dxr::Value::Double(*d),
            Value::String(s) => dxr::Value::String(s.clone()),
            Value::Binary(bytes) => dxr::Value::Base64(bytes.clone()),
            Value::Date(text) => match text.parse() {
                Ok(date) => dxr::Value::DateTime(date),
                Err(_) => dxr::Value::String(text.clone()),
            },
            Value::List(items) => {
                dxr::Value::Array(items.iter().map(Value::to_wire).collect::<Result<_, _>>()?)
            }
            Value::Map(members) => dxr::Value::Struct(
                members
                    .iter()
                    .map(|(key, value)| Ok((key.clone(), value.to_wire()?)))
                    .collect::<Result<_, RosError>>()?,
            ),
        })
    }

    /// From the XML-RPC form.
    pub(crate) fn from_wire(value: dxr::Value) -> Value {
        match value {
            dxr::Value::Integer(i) => Value::Int(i64::from(i)),
            dxr::Value::Boolean(b) => Value::Bool(b),
            dxr::Value::String(s) => Value::String(s),
            dxr::Value::Double(d) => Value::Double(d),
            dxr::Value::Base64(bytes) => Value::Binary(bytes),
            dxr::Value::DateTime(date) => Value::Date(date.to_string()),
            dxr::Value::Array(items) => {
                Value::List(items.into_iter().map(Value::from_wire).collect())
            }
            dxr::Value::Struct(members) => Value::Map(
                members.into_iter().map(|(key, value)| (key, Value::from_wire(value))).collect(),
            ),
            other => Value::String(format!("{other:?}")),
        }
    }

    /// About how much memory it takes.
    pub(crate) fn bytes(&self) -> usize {
        let content = match self {
            Value::Bool(_) | Value::Int(_) | Value::Double(_) => 0,
            Value::String(text) | Value::Date(text) => text.len(),
            Value::Binary(bytes) => bytes.len(),
            Value::List(items) => items.iter().map(Value::bytes).sum(),
            Value::Map(members) => members.iter().map(|(name, one)| one.bytes_at(name)).sum(),
        };
        size_of::<Value>() + content
    }

    /// The same as a member of this name.
    pub(crate) fn bytes_at(&self, name: &str) -> usize {
        size_of::<String>() + name.len() + self.bytes()
    }

    /// The first character of a text in it that XML 1.0 can't have: an XML parser reads no answer
    /// that has it.
    pub(crate) fn no_xml(&self) -> Option<char> {
        match self {
            Value::String(text) => no_xml(text),
            Value::List(items) => items.iter().find_map(Value::no_xml),
            Value::Map(members) => {
                members.iter().find_map(|(name, value)| no_xml(name).or_else(|| value.no_xml()))
            }
            _ => None,
        }
    }

    /// The text, if it is one.
    pub fn as_str(&self) -> Option<&str> {
        match self {
            Value::String(s) => Some(s),
            _ => None,
        }
    }

    /// The integer; a boolean counts as 0 or 1, as roscpp and rospy mix them.
    pub fn as_int(&self) -> Option<i64> {
        match self {
            Value::Int(i) => Some(*i),
            Value::Bool(b) => Some(i64::from(*b)),
            _ => None,
        }
    }

    /// The items, if it is a list.
    pub fn as_list(&self) -> Option<&[Value]> {
        match self {
            Value::List(items) => Some(items),
            _ => None,
        }
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Value::Bool(value)
    }
}

impl From<i32> for Value {
    fn from(value: i32) -> Self {
        Value::Int(i64::from(value))
    }
}

impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Value::Double(value)
    }
}

impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Value::String(value.to_owned())
    }
}

impl From<String> for Value {
    fn from(value: String) -> Self {
        Value::String(value)
    }
}

impl From<Vec<Value>> for Value {
    fn from(value: Vec<Value>) -> Self {
        Value::List(value)
    }
}

fn no_xml(text: &str) -> Option<char> {
    let control = |one: &char| *one < ' ' && !matches!(one, '\t' | '\n' | '\r');
    text.chars().find(|one| control(one) || matches!(one, '\u{fffe}' | '\u{ffff}'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_integer_beyond_32_bits_is_refused_with_a_sentence() {
        let deep = Value::List(vec![Value::Int(1), Value::Int(1 << 31)]);
        let sentence = deep.to_wire().unwrap_err().to_string();
        assert_eq!(
            sentence,
            "the integer 2147483648 does not fit into 32 bits, which is all that ROS \
             parameters have; write it as a string or as a floating-point number"
        );
        assert_eq!(Value::Int(-(1 << 31)).to_wire().unwrap(), dxr::Value::Integer(i32::MIN));
    }

    #[test]
    fn a_nested_value_survives_the_wire_form() {
        let value = Value::Map(BTreeMap::from([
            ("gains".to_owned(), Value::List(vec![Value::Double(0.5), Value::Int(-3)])),
            ("name".to_owned(), Value::from("lane")),
            ("on".to_owned(), Value::Bool(true)),
            ("mask".to_owned(), Value::Binary(vec![0, 255])),
            ("since".to_owned(), Value::Date("20261124T03:12:44".to_owned())),
        ]));
        assert_eq!(Value::from_wire(value.to_wire().unwrap()), value);
    }
}
