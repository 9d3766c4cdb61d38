//! The methods, on the state of one graph.

use std::collections::BTreeMap;

use crate::Value;
use crate::calls::Answer;

use super::call::{Call, arity};
use super::names::resolve;
use super::notices::Notices;
use super::parameters::{Parameters, Update};
use super::registrations::Registrations;

/// Calls that one `system.multicall` may have: roslaunch sets all parameters of a file with one.
const MOST_CALLS: usize = 100_000;

/// About how much memory their answers may take together.
const MOST_ANSWERED: usize = 64 << 20;
/// Bytes of all registrations that a graph has ever had: a topic's type stays.
const MOST_REGISTERED: usize = 64 << 20;
/// What a registration takes beside its texts.
const REGISTRATION: usize = 200;

/// Nodes, topics, services and parameters.
#[derive(Default)]
pub(super) struct Graph {
    pub(super) uri: String,
    registrations: Registrations,
    registered: usize,
    parameters: Parameters,
    notices: Notices,
    /// Nodes that have come since this was taken.
    met: Vec<String>,
}

/// What a call gave: the message and the value, or a refusal's, for -1.
type Outcome = Result<(String, Value), (String, Value)>;

fn fine(message: impl Into<String>, value: impl Into<Value>) -> Outcome {
    Ok((message.into(), value.into()))
}

fn refused(message: impl Into<String>, value: impl Into<Value>) -> Outcome {
    Err((message.into(), value.into()))
}

impl Graph {
    /// Whose nodes get notices that way.
    pub(super) fn new(notices: Notices) -> Graph {
        Graph { notices, ..Graph::default() }
    }

    /// Answers a call; `None` where there is no such method.
    pub(super) fn call(&mut self, method: &str, params: &[Value]) -> Option<Answer> {
        match method {
            "system.multicall" => return Some(Answer::Bare(self.all(params))),
            "system.listMethods" => return Some(Answer::Bare(Value::List(Vec::new()))),
            _ => {}
        }
        let Some(caller) = params.first().and_then(Value::as_str) else {
            let why = "the first parameter is the caller's name";
            return Some(Answer::Refused(-1, why.to_owned(), Value::Int(0)));
        };
        let call = Call { caller, params: &params[1..] };
        if arity(method).is_some_and(|arity| arity != call.params.len()) {
            let why = format!("{method} was called with {} parameters", params.len());
            return Some(Answer::Refused(-1, why, Value::Int(0)));
        }
        let outcome = match self.about_nodes(method, &call) {
            None => self.about_parameters(method, &call)?,
            Some(outcome) => outcome,
        };
        Some(match outcome {
            Ok((message, value)) => Answer::Fine(message, value),
            Err((message, value)) => Answer::Refused(-1, message, value),
        })
    }

    /// Several calls in one, each with an answer in a list of its own.
    fn all(&mut self, params: &[Value]) -> Value {
        let calls = params.first().and_then(Value::as_list).unwrap_or_default();
        let mut answered = 0;
        let answers = calls.iter().take(MOST_CALLS).map(|call| {
            if answered > MOST_ANSWERED {
                return fault(&format!("the answers before take more than {MOST_ANSWERED} bytes"));
            }
            if self.notices.have_ended() {
                return fault("this master has ended");
            }
            let Value::Map(call) = call else { return fault("a call is a struct") };
            let name = call.get("methodName").and_then(Value::as_str).unwrap_or_default();
            let params = call.get("params").and_then(Value::as_list).unwrap_or_default();
            let answer = match name {
                "system.multicall" => None,
                _ => self.call(name, params),
            };
            match answer {
                Some(answer) => {
                    let answer = answer.into_value();
                    answered += answer.bytes();
                    Value::List(vec![answer])
                }
                None => fault(&format!("the method {name} does not exist here")),
            }
        });
        Value::List(answers.collect())
    }

    fn about_nodes(&mut self, method: &str, call: &Call<'_>) -> Option<Outcome> {
        Some(match method {
            "registerPublisher" => self.register_publisher(call),
            "unregisterPublisher" => self.unregister(call, true),
            "registerSubscriber" => self.register_subscriber(call),
            "unregisterSubscriber" => self.unregister(call, false),
            "registerService" => self.register_service(call),
            "unregisterService" => self.unregister_service(call),
            "lookupService" => self.look_up_service(call),
            "lookupNode" => self.look_up_node(call),
            "getPublishedTopics" => self.published_topics(call),
            "getTopicTypes" => fine("current topics", self.registrations.types()),
            "getSystemState" => fine("current system state", self.registrations.state()),
            "getUri" | "getMasterUri" => fine("", self.uri.as_str()),
            "getPid" => fine("", Value::Int(i64::from(std::process::id()))),
            // It ends with the case, and with nothing that a node asks for.
            "shutdown" => refused("this master ends with its graph", 0),
            _ => return None,
        })
    }

    fn about_parameters(&mut self, method: &str, call: &Call<'_>) -> Option<Outcome> {
        Some(match method {
            "setParam" => self.set(call),
            "getParam" => self.get(call),
            "deleteParam" => self.delete(call),
            "hasParam" => call.key(0).and_then(|key| fine(key.as_str(), self.parameters.has(&key))),
            "searchParam" => self.search(call),
            "getParamNames" => {
                let names = self.parameters.names().into_iter().map(Value::from).collect();
                fine("Parameter names", Value::List(names))
            }
            "subscribeParam" => self.subscribe(call),
            "unsubscribeParam" => self.unsubscribe(call),
            _ => return None,
        })
    }

    /// Counts a registration.
    fn count(&mut self, call: &Call<'_>) -> Result<(), (String, Value)> {
        let texts = call.params.iter().filter_map(Value::as_str).map(str::len).sum::<usize>();
        self.registered += REGISTRATION + call.caller.len() + texts;
        match self.registered <= MOST_REGISTERED {
            true => Ok(()),
            false => {
                let why = format!("the registrations of a graph may take {MOST_REGISTERED} bytes");
                Err((why, Value::Int(0)))
            }
        }
    }

    /// The names of nodes that have come since the last call of this.
    pub(super) fn take_met(&mut self) -> Vec<String> {
        std::mem::take(&mut self.met)
    }

    /// Takes in a node; another of its name is asked to end.
    fn meet(&mut self, node: &(String, String)) {
        if self.registrations.node(&node.0) != Some(&node.1) {
            self.met.push(node.0.clone());
        }
        let Some(before) = self.registrations.meet(node) else { return };
        self.parameters.unsubscribe_all(&node.0);
        let why = format!("[{}] Reason: new node registered with same name", node.0);
        let notice = self.notices.notice("shutdown", vec![why.into()]);
        self.notices.send(&before, notice);
    }

    fn forget_idle(&mut self, node: &str) {
        if !self.parameters.has_subscriber(node) {
            self.registrations.forget_idle(node);
        }
    }

    /// Notifies a topic's subscribers of who publishes it.
    fn notify_subscribers(&mut self, topic: &str) {
        let publishers =
            self.registrations.publishers.uris(topic).into_iter().map(Value::from).collect();
        let params = vec![topic.into(), Value::List(publishers)];
        let notice = self.notices.notice("publisherUpdate", params);
        for uri in self.registrations.subscribers.uris(topic) {
            self.notices.send(&uri, notice.clone());
        }
    }

    fn register_publisher(&mut self, call: &Call<'_>) -> Outcome {
        let (topic, node) = (call.name(0, "topic")?, call.node(2)?);
        let datatype = call.datatype(1)?;
        self.count(call)?;
        self.meet(&node);
        let message = format!("Registered [{}] as publisher of [{topic}]", node.0);
        self.registrations.publishers.register(&topic, node);
        self.registrations.published_as(&topic, datatype);
        self.notify_subscribers(&topic);
        fine(message, uris(self.registrations.subscribers.uris(&topic)))
    }

    fn register_subscriber(&mut self, call: &Call<'_>) -> Outcome {
        let (topic, node) = (call.name(0, "topic")?, call.node(2)?);
        let datatype = call.datatype(1)?;
        self.count(call)?;
        self.meet(&node);
        self.registrations.subscribers.register(&topic, node);
        self.registrations.subscribed_as(&topic, datatype);
        let publishers = self.registrations.publishers.uris(&topic);
        fine(format!("Subscribed to [{topic}]"), uris(publishers))
    }

    fn unregister(&mut self, call: &Call<'_>, publisher: bool) -> Outcome {
        let (topic, node) = (call.name(0, "topic")?, call.node(1)?);
        let topics = match publisher {
            true => &mut self.registrations.publishers,
            false => &mut self.registrations.subscribers,
        };
        if !topics.unregister(&topic, &node) {
            let message = format!("[{}] is not a known provider of [{topic}]", node.0);
            return fine(message, 0);
        }
        if publisher {
            self.notify_subscribers(&topic);
        }
        self.forget_idle(&node.0);
        fine(format!("Unregistered [{}] as provider of [{topic}]", node.0), 1)
    }

    fn register_service(&mut self, call: &Call<'_>) -> Outcome {
        let (service, uri) = (call.name(0, "service")?, call.uri(1)?);
        let node = call.node(2)?;
        self.count(call)?;
        self.meet(&node);
        if let Some(before) = self.registrations.serve(&service, &node.0, uri) {
            self.forget_idle(&before);
        }
        fine(format!("Registered [{}] as provider of [{service}]", node.0), 1)
    }

    fn unregister_service(&mut self, call: &Call<'_>) -> Outcome {
        let (service, uri) = (call.name(0, "service")?, call.uri(1)?);
        if !self.registrations.stop_serving(&service, call.caller, uri) {
            return fine(format!("{uri} does not provide [{service}]"), 0);
        }
        self.forget_idle(call.caller);
        fine(format!("Unregistered [{}] as provider of [{service}]", call.caller), 1)
    }

    fn look_up_service(&self, call: &Call<'_>) -> Outcome {
        let service = call.name(0, "service")?;
        match self.registrations.service(&service) {
            Some(uri) => fine(format!("rosrpc URI: [{uri}]"), uri.as_str()),
            None => refused("no provider", ""),
        }
    }

    fn look_up_node(&self, call: &Call<'_>) -> Outcome {
        let node = call.name(0, "node")?;
        match self.registrations.node(&node) {
            Some(uri) => fine("node api", uri.as_str()),
            None => refused(format!("unknown node [{node}]"), ""),
        }
    }

    fn published_topics(&self, call: &Call<'_>) -> Outcome {
        let namespace = match call.params.first().and_then(Value::as_str) {
            None => return refused("the parameter subgraph must be a text", 0),
            Some("") => String::new(),
            Some(text) => format!("{}/", resolve(text, call.caller).trim_end_matches('/')),
        };
        fine("current topics", self.registrations.published(&namespace))
    }

    fn set(&mut self, call: &Call<'_>) -> Outcome {
        let key = call.key(0)?;
        match self.parameters.set(&key, call.params[1].clone(), call.caller) {
            Ok(updates) => self.notify(updates),
            Err(why) => return refused(why, 0),
        }
        fine(format!("parameter {key} set"), 0)
    }

    fn get(&self, call: &Call<'_>) -> Outcome {
        let key = call.key(0)?;
        match self.parameters.get(&key) {
            Some(value) => fine(format!("Parameter [{key}]"), value),
            None => refused(format!("Parameter [{key}] is not set"), 0),
        }
    }

    fn delete(&mut self, call: &Call<'_>) -> Outcome {
        let key = call.key(0)?;
        let Some(updates) = self.parameters.delete(&key) else {
            return refused(format!("parameter [{key}] is not set"), 0);
        };
        self.notify(updates);
        fine(format!("parameter {key} deleted"), 0)
    }

    fn search(&self, call: &Call<'_>) -> Outcome {
        let key = call.text(0, "key")?;
        let found = match key.starts_with('~') {
            true => None,
            false => self.parameters.search(call.caller, key),
        };
        match found {
            Some(name) => fine(format!("Found [{name}]"), name),
            None => refused(format!("Cannot find parameter [{key}] in an upwards search"), ""),
        }
    }

    fn subscribe(&mut self, call: &Call<'_>) -> Outcome {
        let (node, key) = (call.node(0)?, call.key(1)?);
        self.count(call)?;
        self.meet(&node);
        let value = self.parameters.subscribe(&key, node);
        fine(format!("Subscribed to parameter [{key}]"), value)
    }

    fn unsubscribe(&mut self, call: &Call<'_>) -> Outcome {
        let (node, key) = (call.node(0)?, call.key(1)?);
        self.parameters.unsubscribe(&key, &node);
        self.forget_idle(&node.0);
        fine(format!("Unsubscribe to parameter [{key}]"), 1)
    }

    fn notify(&mut self, updates: Vec<Update>) {
        for Update { uris, key } in updates {
            let value = self.parameters.get(&key);
            // One that is gone is an empty tree.
            let value = value.unwrap_or_else(|| Value::Map(BTreeMap::new()));
            let notice = self.notices.notice("paramUpdate", vec![key.into(), value]);
            for uri in uris {
                self.notices.send(&uri, notice.clone());
            }
        }
    }
}

fn uris(uris: Vec<String>) -> Value {
    Value::List(uris.into_iter().map(Value::from).collect())
}

/// A call's failure within several, as XML-RPC has it.
fn fault(why: &str) -> Value {
    Value::Map([("faultCode".into(), Value::Int(-1)), ("faultString".into(), why.into())].into())
}
