//! Parameters from MessagePack to ROS.

use std::collections::BTreeMap;

use bagpipe_ros1::{Master, Value as Ros};
use rmpv::Value;

/// Sets every parameter on the rosmaster; the error is a sentence that names the first that
/// cannot be set.
pub fn set(master: &Master, parameters: &BTreeMap<String, Value>) -> Result<(), String> {
    for (name, value) in parameters {
        let fail = |why: String| format!("the parameter {name} cannot be set: {why}");
        let value = convert(value).map_err(fail)?;
        master.set_param(name, &value).map_err(|error| fail(error.to_string()))?;
    }
    Ok(())
}

fn convert(value: &Value) -> Result<Ros, String> {
    Ok(match value {
        Value::Boolean(value) => Ros::Bool(*value),
        Value::Integer(value) => {
            let small = value.as_i64();
            Ros::Int(small.ok_or_else(|| format!("{value} does not fit into 32 bits"))?)
        }
        Value::F32(value) => Ros::Double(f64::from(*value)),
        Value::F64(value) => Ros::Double(*value),
        Value::String(text) => Ros::String(
            text.as_str().ok_or_else(|| "it holds text that is not UTF-8".to_owned())?.to_owned(),
        ),
        Value::Array(items) => Ros::List(items.iter().map(convert).collect::<Result<_, _>>()?),
        Value::Map(entries) => Ros::Map(
            entries
                .iter()
                .map(|(key, value)| {
                    let key = key.as_str().ok_or_else(|| format!("its key {key} is no text"))?;
                    Ok((key.to_owned(), convert(value)?))
                })
                .collect::<Result<_, String>>()?,
        ),
        Value::Nil => return Err("ROS parameters cannot be null; leave it out".to_owned()),
        Value::Binary(_) | Value::Ext(..) => {
            return Err("it is binary, which ROS parameters cannot be".to_owned());
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nested_values_are_converted() {
        let pair = Value::Array(vec![1.into(), Value::F64(0.5), true.into()]);
        let nested = Value::Map(vec![("gains".into(), pair)]);
        let list = Ros::List(vec![Ros::Int(1), Ros::Double(0.5), Ros::Bool(true)]);
        assert_eq!(convert(&nested), Ok(Ros::Map([("gains".to_owned(), list)].into())));
    }

    #[test]
    fn what_ros_cannot_hold_is_refused() {
        assert!(convert(&Value::Nil).unwrap_err().contains("leave it out"));
        assert!(convert(&u64::MAX.into()).unwrap_err().contains("32 bits"));
        assert!(convert(&Value::Binary(vec![1])).unwrap_err().contains("binary"));
    }
}
