//! XML-RPC calls with a deadline, and the triple that every ROS API answers with.

use std::time::Duration;

use dxr::{FaultResponse, MethodCall, MethodResponse};

use crate::hosts::{resolve, split_uri};
use crate::{RosError, Value};

/// The largest XML answer accepted, in bytes. A master with 1,000 topics answers 200 KB.
const MAX_ANSWER: u64 = 64 << 20;

/// A client for one XML-RPC server; each call opens a connection of its own, so a server
/// that closes idle connections (roscpp does) can't fail the next call.
#[derive(Clone, Debug)]
pub(crate) struct Client {
    agent: ureq::Agent,
    uri: String,
    address: String,
}

impl Client {
    /// A client for the server at `uri`; every call ends within `deadline`.
    pub(crate) fn new(uri: &str, deadline: Duration) -> Result<Client, RosError> {
        let (host, port) = split_uri(uri)?;
        let address = format!("http://{}/", resolve(host, port)?);
        let agent = ureq::Agent::config_builder()
            .timeout_global(Some(deadline))
            .max_idle_connections(0)
            .http_status_as_error(false)
            .proxy(None)
            .user_agent("bagpipe")
            .build()
            .new_agent();
        Ok(Client { agent, uri: uri.to_owned(), address })
    }

    /// The server's URI as given.
    pub(crate) fn uri(&self) -> &str {
        &self.uri
    }

    /// Calls a method and returns the value of the ROS triple `[code, message, value]`.
    pub(crate) fn call<'v>(
        &self,
        method: &str,
        params: impl IntoIterator<Item = &'v Value>,
    ) -> Result<Value, RosError> {
        self.call_of_server(method, params).map(|(value, _)| value)
    }

    /// Like [`Client::call`], with what the server calls itself, such as `XMLRPC++ 0.7`.
    pub(crate) fn call_of_server<'v>(
        &self,
        method: &str,
        params: impl IntoIterator<Item = &'v Value>,
    ) -> Result<(Value, String), RosError> {
        let (answer, server) = self.exchange(method, params)?;
        Ok((self.unwrap_triple(method, answer)?, server))
    }

    /// Like [`Client::call`] for `getBusStats`, which roscpp answers without the triple: a
    /// bare list of lists.
    pub(crate) fn call_statistics(&self, params: &[Value]) -> Result<Value, RosError> {
        let method = "getBusStats";
        let (answer, _) = self.exchange(method, params)?;
        let first = answer.as_list().and_then(|list| list.first());
        if first.is_some_and(|first| first.as_list().is_some()) {
            return Ok(answer);
        }
        self.unwrap_triple(method, answer)
    }

    fn unwrap_triple(&self, method: &str, answer: Value) -> Result<Value, RosError> {
        let wrong = || self.bad_answer(method, "expected [code, message, value]");
        let Value::List(mut triple) = answer else {
            return Err(wrong());
        };
        if triple.len() != 3 {
            return Err(wrong());
        }
        let code = triple[0].as_int().ok_or_else(wrong)?;
        if code != 1 {
            let why = triple[1].as_str().unwrap_or("without a message").to_owned();
            return Err(RosError::Refused { method: method.into(), uri: self.uri.clone(), why });
        }
        triple.pop().ok_or_else(wrong)
    }

    /// An error that names the method, the server and what was expected.
    pub(crate) fn bad_answer(&self, method: &str, why: &str) -> RosError {
        bad_answer(method, &self.uri, why)
    }

    fn exchange<'v>(
        &self,
        method: &str,
        params: impl IntoIterator<Item = &'v Value>,
    ) -> Result<(Value, String), RosError> {
        let unreachable = |why: String| RosError::Unreachable {
            method: method.into(),
            uri: self.uri.clone(),
            why,
        };
        let params = params.into_iter().map(Value::to_wire).collect::<Result<_, _>>()?;
        let body = MethodCall { name: method.into(), params }
            .to_xml()
            .map_err(|error| self.bad_answer(method, &error.to_string()))?;
        let mut response = self
            .agent
            .post(&self.address)
            .header("Content-Type", "text/xml")
            .send(format!("<?xml version=\"1.0\"?>\n{body}"))
            .map_err(|error| unreachable(error.to_string()))?;
        if !response.status().is_success() {
            return Err(unreachable(format!("HTTP status {}", response.status())));
        }
        let server = response.headers().get("Server").and_then(|value| value.to_str().ok());
        let server = server.unwrap_or_default().to_owned();
        let text = response
            .body_mut()
            .with_config()
            .limit(MAX_ANSWER)
            .read_to_string()
            .map_err(|error| unreachable(error.to_string()))?;
        Ok((parse(method, &self.uri, &text)?, server))
    }
}

fn bad_answer(method: &str, uri: &str, why: &str) -> RosError {
    RosError::BadAnswer { method: method.into(), uri: uri.into(), why: why.into() }
}

/// The parser's errors repeat the document, which may have megabytes.
const MOST_QUOTED: usize = 200;

/// What the parser says, no longer than a sentence.
pub(crate) fn no_xml_rpc(error: &dxr::Error) -> String {
    let text = error.to_string();
    match text.char_indices().nth(MOST_QUOTED) {
        Some((end, _)) => format!("{}... ({} bytes)", &text[..end], text.len()),
        None => text,
    }
}

/// The value of an answer to `method` from the server at `uri`; a fault is an error.
pub(crate) fn parse(method: &str, uri: &str, text: &str) -> Result<Value, RosError> {
    match MethodResponse::from_xml(text) {
        Ok(response) => Ok(Value::from_wire(response.value)),
        Err(error) => match FaultResponse::from_xml(text) {
            Ok(response) => Err(RosError::Refused {
                method: method.into(),
                uri: uri.into(),
                why: response.fault.string().to_owned(),
            }),
            Err(_) => Err(bad_answer(method, uri, &no_xml_rpc(&error))),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An answer of lists in lists.
    fn nested(times: usize) -> String {
        let (open, close) = ("<value><array><data>", "</data></array></value>");
        let (open, close) = (open.repeat(times), close.repeat(times));
        format!("<methodResponse><params><param>{open}{close}</param></params></methodResponse>")
    }

    #[test]
    fn lists_in_lists_are_read_but_not_without_end() {
        let mut value = parse("getParam", "http://robot:1/", &nested(30)).unwrap();
        let mut depth = 1;
        while let Value::List(mut items) = value {
            let Some(inner) = items.pop() else { break };
            value = inner;
            depth += 1;
        }
        assert_eq!(depth, 30);
        // Enough to use up the stack of any thread, were it parsed to its end.
        for deep in [nested(100_000), nested(100_000).replace("<data>", "<data><!--</data>-->")] {
            let error = parse("getParam", "http://robot:1/", &deep).unwrap_err().to_string();
            assert!(error.contains("Failed to parse XML data: <methodResponse>"), "{error}");
            assert!(error.len() < 400, "{} bytes of error", error.len());
        }
    }
}
