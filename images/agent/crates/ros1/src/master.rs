//! The Master API (<https://wiki.ros.org/ROS/Master_API>) and the Parameter Server API.

use std::collections::BTreeMap;
use std::time::Duration;

use bagpipe_graph::SystemState;

use crate::xmlrpc::Client;
use crate::{RosError, Value};

/// A client of a ROS master; every call has the same deadline.
#[derive(Clone, Debug)]
pub struct Master {
    client: Client,
    caller: String,
    deadline: Duration,
}

impl Master {
    /// A client that introduces itself as `caller` (a node name such as `/bagpipe_agent`).
    ///
    /// # Errors
    /// [`RosError::BadUri`] or [`RosError::Io`] if the URI has no usable host and port.
    pub fn new(uri: &str, caller: &str, deadline: Duration) -> Result<Master, RosError> {
        let client = Client::new(uri, deadline)?;
        Ok(Master { client, caller: caller.to_owned(), deadline })
    }

    /// The master's URI as given.
    pub fn uri(&self) -> &str {
        self.client.uri()
    }

    /// The deadline of each call.
    pub fn deadline(&self) -> Duration {
        self.deadline
    }

    /// Our name in the graph.
    pub fn caller(&self) -> &str {
        &self.caller
    }

    /// Registers a publisher; answers the slave URIs of the topic's subscribers.
    pub fn register_publisher(
        &self,
        topic: &str,
        datatype: &str,
        slave_uri: &str,
    ) -> Result<Vec<String>, RosError> {
        let params = [topic.into(), datatype.into(), slave_uri.into()];
        self.strings("registerPublisher", &params)
    }

    /// Takes a publisher's registration back.
    pub fn unregister_publisher(&self, topic: &str, slave_uri: &str) -> Result<(), RosError> {
        self.call("unregisterPublisher", &[topic.into(), slave_uri.into()]).map(drop)
    }

    /// Registers a subscriber; answers the slave URIs of the topic's publishers.
    pub fn register_subscriber(
        &self,
        topic: &str,
        datatype: &str,
        slave_uri: &str,
    ) -> Result<Vec<String>, RosError> {
        let params = [topic.into(), datatype.into(), slave_uri.into()];
        self.strings("registerSubscriber", &params)
    }

    /// Takes a subscriber's registration back.
    pub fn unregister_subscriber(&self, topic: &str, slave_uri: &str) -> Result<(), RosError> {
        self.call("unregisterSubscriber", &[topic.into(), slave_uri.into()]).map(drop)
    }

    /// The slave URI of a node.
    pub fn lookup_node(&self, node: &str) -> Result<String, RosError> {
        match self.call("lookupNode", &[node.into()])? {
            Value::String(uri) => Ok(uri),
            _ => Err(self.client.bad_answer("lookupNode", "expected a URI")),
        }
    }

    /// Publishers and subscribers of every topic.
    pub fn get_system_state(&self) -> Result<SystemState, RosError> {
        let state = self.call("getSystemState", &[])?;
        let lists = state.as_list().unwrap_or_default();
        let (Some(publishers), Some(subscribers)) = (lists.first(), lists.get(1)) else {
            let why = "expected [publishers, subscribers, services]";
            return Err(self.client.bad_answer("getSystemState", why));
        };
        Ok(SystemState {
            publishers: nodes_by_topic(publishers),
            subscribers: nodes_by_topic(subscribers),
        })
    }

    /// Every topic that was ever registered, with its type.
    pub fn get_topic_types(&self) -> Result<BTreeMap<String, String>, RosError> {
        let answer = self.call("getTopicTypes", &[])?;
        let pairs = answer.as_list().unwrap_or_default().iter().filter_map(|pair| {
            let pair = pair.as_list()?;
            Some((pair.first()?.as_str()?.to_owned(), pair.get(1)?.as_str()?.to_owned()))
        });
        Ok(pairs.collect())
    }

    /// The process id of the master: it answers once it is ready.
    pub fn get_pid(&self) -> Result<i64, RosError> {
        let pid = self.call("getPid", &[])?;
        pid.as_int().ok_or_else(|| self.client.bad_answer("getPid", "expected an integer"))
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// [`RosError::IntegerTooLarge`] for an integer beyond 32 bits, before anything is sent.
    pub fn set_param(&self, name: &str, value: &Value) -> Result<(), RosError> {
        self.call("setParam", &[name.into(), value.clone()]).map(drop)
    }

    /// A parameter's value.
    pub fn get_param(&self, name: &str) -> Result<Value, RosError> {
        self.call("getParam", &[name.into()])
    }

    /// Deletes a parameter.
    pub fn delete_param(&self, name: &str) -> Result<(), RosError> {
        self.call("deleteParam", &[name.into()]).map(drop)
    }

    fn call(&self, method: &str, params: &[Value]) -> Result<Value, RosError> {
        let mut all = Vec::with_capacity(params.len() + 1);
        all.push(Value::from(self.caller.as_str()));
        all.extend_from_slice(params);
        self.client.call(method, &all)
    }

    fn strings(&self, method: &str, params: &[Value]) -> Result<Vec<String>, RosError> {
        let answer = self.call(method, params)?;
        let items = answer
            .as_list()
            .ok_or_else(|| self.client.bad_answer(method, "expected a list of URIs"))?;
        Ok(items.iter().filter_map(|item| item.as_str().map(str::to_owned)).collect())
    }
}

fn nodes_by_topic(list: &Value) -> BTreeMap<String, Vec<String>> {
    let entries = list.as_list().unwrap_or_default().iter().filter_map(|entry| {
        let entry = entry.as_list()?;
        let nodes = entry.get(1)?.as_list()?.iter().filter_map(|node| node.as_str());
        Some((entry.first()?.as_str()?.to_owned(), nodes.map(str::to_owned).collect()))
    });
    entries.collect()
}
