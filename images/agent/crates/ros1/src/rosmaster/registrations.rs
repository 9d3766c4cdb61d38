//! Who publishes, subscribes and serves what.

use std::collections::BTreeMap;

use crate::Value;

/// The type of a topic that nobody has named yet.
pub(super) const ANY: &str = "*";

/// A node's name, and the URI of its slave API.
pub(super) type Registered = (String, String);

/// The nodes of each topic, in the order of their registration.
#[derive(Default)]
pub(super) struct Topics(BTreeMap<String, Vec<Registered>>);

#[derive(Default)]
pub(super) struct Registrations {
    pub(super) publishers: Topics,
    pub(super) subscribers: Topics,
    /// By name: the node, and the service's URI.
    services: BTreeMap<String, Registered>,
    /// The slave URI of each node that is registered for anything.
    nodes: BTreeMap<String, String>,
    types: BTreeMap<String, String>,
}

impl Topics {
    pub(super) fn register(&mut self, topic: &str, who: Registered) {
        let all = self.0.entry(topic.to_owned()).or_default();
        if !all.contains(&who) {
            all.push(who);
        }
    }

    /// Whether it was registered.
    pub(super) fn unregister(&mut self, topic: &str, who: &Registered) -> bool {
        let Some(all) = self.0.get_mut(topic) else { return false };
        let before = all.len();
        all.retain(|one| one != who);
        let found = all.len() < before;
        if all.is_empty() {
            self.0.remove(topic);
        }
        found
    }

    fn unregister_all(&mut self, node: &str) {
        self.0.values_mut().for_each(|all| all.retain(|one| one.0 != node));
        self.0.retain(|_, all| !all.is_empty());
    }

    /// The slave URIs of a topic's nodes.
    pub(super) fn uris(&self, topic: &str) -> Vec<String> {
        self.0.get(topic).into_iter().flatten().map(|one| one.1.clone()).collect()
    }

    fn has(&self, node: &str) -> bool {
        self.0.values().flatten().any(|one| one.0 == node)
    }

    fn state(&self) -> Value {
        let entry = |(topic, nodes): (&String, &Vec<Registered>)| {
            let nodes = nodes.iter().map(|one| one.0.as_str().into()).collect();
            Value::List(vec![topic.as_str().into(), Value::List(nodes)])
        };
        Value::List(self.0.iter().map(entry).collect())
    }
}

impl Registrations {
    /// Takes in that a node with this slave URI is there; the URI of another that had its name, whose
    /// registrations are gone.
    pub(super) fn meet(&mut self, (node, uri): &Registered) -> Option<String> {
        let before = self.nodes.insert(node.clone(), uri.clone())?;
        if before == *uri {
            return None;
        }
        self.publishers.unregister_all(node);
        self.subscribers.unregister_all(node);
        self.services.retain(|_, provider| provider.0 != *node);
        Some(before)
    }

    /// Forgets a node that is registered for nothing any more.
    pub(super) fn forget_idle(&mut self, node: &str) {
        let serves = self.services.values().any(|one| one.0 == node);
        if !serves && !self.publishers.has(node) && !self.subscribers.has(node) {
            self.nodes.remove(node);
        }
    }

    /// The slave URI of a node.
    pub(super) fn node(&self, node: &str) -> Option<&String> {
        self.nodes.get(node)
    }

    /// Takes in the type that a publisher names.
    pub(super) fn published_as(&mut self, topic: &str, datatype: &str) {
        if datatype != ANY || !self.types.contains_key(topic) {
            self.types.insert(topic.to_owned(), datatype.to_owned());
        }
    }

    /// Takes in the type that a subscriber names, which no publisher has named.
    pub(super) fn subscribed_as(&mut self, topic: &str, datatype: &str) {
        if datatype != ANY && !self.types.contains_key(topic) {
            self.types.insert(topic.to_owned(), datatype.to_owned());
        }
    }

    /// Each topic that has a publisher, in a namespace that ends with a slash or in all, with its type.
    pub(super) fn published(&self, namespace: &str) -> Value {
        let there = self.publishers.0.keys().filter(|topic| topic.starts_with(namespace));
        Value::List(there.map(|topic| self.typed(topic)).collect())
    }

    /// Each topic that was ever registered with a type.
    pub(super) fn types(&self) -> Value {
        Value::List(self.types.keys().map(|topic| self.typed(topic)).collect())
    }

    fn typed(&self, topic: &str) -> Value {
        let datatype = self.types.get(topic).map_or(ANY, String::as_str);
        Value::List(vec![topic.into(), datatype.into()])
    }

    /// The last one to register a service provides it; who did before.
    pub(super) fn serve(&mut self, service: &str, node: &str, uri: &str) -> Option<String> {
        let before = self.services.insert(service.to_owned(), (node.to_owned(), uri.to_owned()));
        before.map(|before| before.0)
    }

    /// Whether the node provided the service there.
    pub(super) fn stop_serving(&mut self, service: &str, node: &str, uri: &str) -> bool {
        let provided = |one: &Registered| one.0 == node && one.1 == uri;
        let found = self.services.get(service).is_some_and(provided);
        if found {
            self.services.remove(service);
        }
        found
    }

    /// Where a service is.
    pub(super) fn service(&self, service: &str) -> Option<&String> {
        self.services.get(service).map(|one| &one.1)
    }

    /// `[publishers, subscribers, services]`.
    pub(super) fn state(&self) -> Value {
        let service = |(name, provider): (&String, &Registered)| {
            let nodes = Value::List(vec![provider.0.as_str().into()]);
            Value::List(vec![name.as_str().into(), nodes])
        };
        let services = Value::List(self.services.iter().map(service).collect());
        Value::List(vec![self.publishers.state(), self.subscribers.state(), services])
    }
}
