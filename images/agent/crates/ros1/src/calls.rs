//! Answers to XML-RPC calls, as servers of ROS give them.

use dxr::{Fault, FaultResponse, MethodCall, MethodResponse};

use crate::Value;
use crate::xmlrpc::no_xml_rpc;

/// What a method answers.
pub(crate) enum Answer {
    /// `[1, message, value]`
    Fine(String, Value),
    /// `[code, message, value]` with a code below 1: -1 if the caller is wrong, 0 if the server is.
    Refused(i64, String, Value),
    /// A value as it is, which the calls of XML-RPC itself have.
    Bare(Value),
}

impl Answer {
    /// The value that goes out.
    pub(crate) fn into_value(self) -> Value {
        let (code, message, value) = match self {
            Answer::Fine(message, value) => (1, message, value),
            Answer::Refused(code, message, value) => (code, message, value),
            Answer::Bare(value) => return value,
        };
        Value::List(vec![Value::Int(code), Value::String(message), value])
    }
}

/// Answers one call, by a method that `dispatch` has; `None` where there is none of that name.
pub(crate) fn answer(
    body: &str,
    dispatch: impl FnOnce(&str, Vec<Value>) -> Option<Answer>,
) -> String {
    let (name, params) = match parse(body) {
        Ok(call) => call,
        Err(why) => return fault(&format!("this is not an XML-RPC call: {why}")),
    };
    let Some(answer) = dispatch(&name, params) else {
        return fault(&format!("the method {name} does not exist here"));
    };
    match answer.into_value().to_wire().map(|value| MethodResponse { value }.to_xml()) {
        Ok(Ok(xml)) => format!("<?xml version=\"1.0\"?>\n{xml}"),
        Ok(Err(error)) => fault(&error.to_string()),
        Err(error) => fault(&error.to_string()),
    }
}

/// A call's method and parameters, or what is wrong.
pub(crate) fn parse(body: &str) -> Result<(String, Vec<Value>), String> {
    let call = MethodCall::from_xml(body).map_err(|error| no_xml_rpc(&error))?;
    let params: Vec<Value> = call.params.into_iter().map(Value::from_wire).collect();
    match params.iter().find_map(Value::no_xml) {
        Some(one) => Err(format!("XML has no character U+{:04X}", u32::from(one))),
        None => Ok((call.name.into_owned(), params)),
    }
}

fn fault(why: &str) -> String {
    let response = FaultResponse { fault: Fault::new(-1, why.to_owned()) };
    response.to_xml().unwrap_or_default()
}
