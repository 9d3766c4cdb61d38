//! What a call comes with, and what is wrong about it.

use crate::Value;

use super::names::resolve;
use super::registrations::ANY;

/// What a call comes with.
pub(super) struct Call<'c> {
    pub(super) caller: &'c str,
    pub(super) params: &'c [Value],
}

impl Call<'_> {
    /// A text that is not empty.
    pub(super) fn text(&self, at: usize, what: &str) -> Result<&str, (String, Value)> {
        let text = self.params.get(at).and_then(Value::as_str).filter(|text| !text.is_empty());
        let wrong = || format!("the parameter {what} must be a text that is not empty");
        text.ok_or_else(|| (wrong(), Value::Int(0)))
    }

    /// A name's global form.
    pub(super) fn name(&self, at: usize, what: &str) -> Result<String, (String, Value)> {
        let text = self.text(at, what)?;
        if text == "/" || text.contains([':', ' ']) {
            return Err((format!("{text} is no name of a {what}"), Value::Int(0)));
        }
        Ok(resolve(text, self.caller))
    }

    /// A topic's type: a package and a name in it, or whichever comes.
    pub(super) fn datatype(&self, at: usize) -> Result<&str, (String, Value)> {
        let datatype = self.text(at, "type")?;
        match datatype == ANY || datatype.split('/').count() == 2 {
            true => Ok(datatype),
            false => Err((format!("{datatype} is no type: write package/Name"), Value::Int(0))),
        }
    }

    pub(super) fn key(&self, at: usize) -> Result<String, (String, Value)> {
        Ok(resolve(self.text(at, "key")?, self.caller))
    }

    pub(super) fn uri(&self, at: usize) -> Result<&str, (String, Value)> {
        let uri = self.text(at, "URI")?;
        match uri.starts_with("http://") || uri.starts_with("rosrpc://") {
            true => Ok(uri),
            false => Err((format!("{uri} is no URI of a node or a service"), Value::Int(0))),
        }
    }

    pub(super) fn node(&self, at: usize) -> Result<(String, String), (String, Value)> {
        Ok((self.caller.to_owned(), self.uri(at)?.to_owned()))
    }
}

/// How many parameters follow the caller's name; `None` where there is no such method.
pub(super) fn arity(method: &str) -> Option<usize> {
    Some(match method {
        "getTopicTypes" | "getSystemState" | "getUri" | "getMasterUri" | "getPid"
        | "getParamNames" => 0,
        "lookupService" | "lookupNode" | "getPublishedTopics" | "getParam" | "deleteParam"
        | "hasParam" | "searchParam" | "shutdown" => 1,
        "unregisterPublisher"
        | "unregisterSubscriber"
        | "unregisterService"
        | "setParam"
        | "subscribeParam"
        | "unsubscribeParam" => 2,
        "registerPublisher" | "registerSubscriber" | "registerService" => 3,
        _ => return None,
    })
}
