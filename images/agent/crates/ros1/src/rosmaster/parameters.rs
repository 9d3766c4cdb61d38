//! The Parameter Server (<https://wiki.ros.org/ROS/Parameter%20Server%20API>): a tree of values, and
//! the nodes that keep copies of parts of it.

use std::collections::BTreeMap;

use super::names::parts;
use crate::Value;

/// Levels of a parameter's name. With those that a value of the wire may have no walk through the
/// tree uses up a thread's stack.
const MOST_LEVELS: usize = 64;

/// About how much memory all values may take: they are held by the process that plays and records,
/// in a container that has other slots as well, and one call may ask for all of them.
const MOST_BYTES: usize = 32 << 20;

/// A node that keeps a copy: its name, and the URI of its slave API.
pub(super) type Subscriber = (String, String);

/// Who is to be notified of a value that there is now: the key ends with a slash.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Update {
    pub(super) uris: Vec<String>,
    pub(super) key: String,
}

#[derive(Default)]
pub(super) struct Parameters {
    tree: BTreeMap<String, Value>,
    bytes: usize,
    /// By key, which ends with a slash.
    subscribers: BTreeMap<String, Vec<Subscriber>>,
}

impl Parameters {
    /// The value of a global name; `None` where there is none.
    pub(super) fn get(&self, name: &str) -> Option<Value> {
        match parts(name).next() {
            None => Some(Value::Map(self.tree.clone())),
            Some(_) => self.find(name).cloned(),
        }
    }

    /// Whether there is a value of a global name.
    pub(super) fn has(&self, name: &str) -> bool {
        parts(name).next().is_none() || self.find(name).is_some()
    }

    /// What is below the root.
    fn find(&self, name: &str) -> Option<&Value> {
        let mut parts = parts(name);
        let mut value = self.tree.get(parts.next()?)?;
        for part in parts {
            let Value::Map(members) = value else { return None };
            value = members.get(part)?;
        }
        Some(value)
    }

    /// Sets a global name, and whatever is not a tree on the way to it becomes one.
    ///
    /// # Errors
    /// A sentence: the root can only be a tree, and names and the whole have a bound.
    pub(super) fn set(
        &mut self,
        name: &str,
        value: Value,
        caller: &str,
    ) -> Result<Vec<Update>, String> {
        let mut way: Vec<&str> = parts(name).collect();
        if way.len() > MOST_LEVELS {
            return Err(format!("a parameter's name may have {MOST_LEVELS} levels"));
        }
        let before = match way.is_empty() {
            true => self.bytes,
            false => self.find(name).map_or(0, Value::bytes),
        };
        if self.bytes - before + name.len() + value.bytes() > MOST_BYTES {
            return Err(format!("the parameters of a graph may take {MOST_BYTES} bytes"));
        }
        let updates = self.updates(name, matches!(value, Value::Map(_)), Some(caller));
        let Some(last) = way.pop() else {
            let Value::Map(tree) = value else {
                return Err("the root of all parameters can only be set to a tree".to_owned());
            };
            self.bytes = tree.iter().map(|(name, value)| value.bytes_at(name)).sum();
            self.tree = tree;
            return Ok(updates);
        };
        let mut tree = &mut self.tree;
        for part in way {
            tree = tree_at(tree, part, &mut self.bytes)?;
        }
        put(tree, last, value, &mut self.bytes);
        Ok(updates)
    }

    /// Deletes a global name; `None` where there is none. The root stays.
    pub(super) fn delete(&mut self, name: &str) -> Option<Vec<Update>> {
        let mut way: Vec<&str> = parts(name).collect();
        let last = way.pop()?;
        let mut tree = &mut self.tree;
        for part in way {
            let Value::Map(members) = tree.get_mut(part)? else { return None };
            tree = members;
        }
        let gone = tree.remove(last)?;
        self.bytes -= gone.bytes_at(last);
        Some(self.updates(name, true, None))
    }

    /// The name that `key` has in the nearest namespace, from the caller's own upwards, in which its
    /// first part exists.
    pub(super) fn search(&self, caller: &str, key: &str) -> Option<String> {
        if key.starts_with('/') {
            return self.has(key).then(|| key.to_owned());
        }
        let first = parts(key).next()?;
        let around: Vec<&str> = parts(caller).collect();
        (0..=around.len()).rev().find_map(|levels| {
            let namespace: String =
                around[..levels].iter().map(|part| format!("/{part}")).collect();
            self.has(&format!("{namespace}/{first}")).then(|| format!("{namespace}/{key}"))
        })
    }

    /// The names of all values that are no trees.
    pub(super) fn names(&self) -> Vec<String> {
        let mut names = Vec::new();
        leaves("/", &self.tree, &mut names);
        names
    }

    /// Takes in that a node keeps a copy of a global name; the value, which is an empty tree where
    /// there is none yet.
    pub(super) fn subscribe(&mut self, name: &str, who: Subscriber) -> Value {
        let subscribers = self.subscribers.entry(with_slash(name)).or_default();
        if !subscribers.contains(&who) {
            subscribers.push(who);
        }
        self.get(name).unwrap_or_else(|| Value::Map(BTreeMap::new()))
    }

    /// Takes a subscription back.
    pub(super) fn unsubscribe(&mut self, name: &str, who: &Subscriber) {
        if let Some(subscribers) = self.subscribers.get_mut(&with_slash(name)) {
            subscribers.retain(|one| one != who);
        }
        self.subscribers.retain(|_, subscribers| !subscribers.is_empty());
    }

    /// Takes all subscriptions of a node back.
    pub(super) fn unsubscribe_all(&mut self, node: &str) {
        for subscribers in self.subscribers.values_mut() {
            subscribers.retain(|one| one.0 != node);
        }
        self.subscribers.retain(|_, subscribers| !subscribers.is_empty());
    }

    /// Whether a node keeps a copy of anything.
    pub(super) fn has_subscriber(&self, node: &str) -> bool {
        self.subscribers.values().flatten().any(|one| one.0 == node)
    }

    /// Who is to be notified that a name has another value now, which is a tree or not. Who has set it
    /// knows it, if it has a copy of that or of a tree around it.
    fn updates(&self, name: &str, tree: bool, setter: Option<&str>) -> Vec<Update> {
        let changed = with_slash(name);
        let (mut around, mut within) = (Vec::new(), Vec::new());
        for (key, subscribers) in &self.subscribers {
            if changed.starts_with(key.as_str()) {
                let others = subscribers.iter().filter(|one| setter != Some(one.0.as_str()));
                around.extend(others.map(|one| one.1.clone()));
            } else if tree && key.starts_with(&changed) {
                let uris = subscribers.iter().map(|one| one.1.clone()).collect();
                within.push(Update { uris, key: key.clone() });
            }
        }
        if !around.is_empty() {
            within.insert(0, Update { uris: around, key: changed });
        }
        within
    }
}

/// The tree of this name in another, which is made if there is none.
fn tree_at<'t>(
    tree: &'t mut BTreeMap<String, Value>,
    name: &str,
    bytes: &mut usize,
) -> Result<&'t mut BTreeMap<String, Value>, String> {
    if !matches!(tree.get(name), Some(Value::Map(_))) {
        put(tree, name, Value::Map(BTreeMap::new()), bytes);
    }
    match tree.get_mut(name) {
        Some(Value::Map(members)) => Ok(members),
        _ => Err(format!("{name} is no tree")),
    }
}

/// Puts a value into a tree, of which `bytes` counts what it takes.
fn put(tree: &mut BTreeMap<String, Value>, name: &str, value: Value, bytes: &mut usize) {
    *bytes += value.bytes_at(name);
    if let Some(before) = tree.insert(name.to_owned(), value) {
        *bytes -= before.bytes_at(name);
    }
}

fn with_slash(name: &str) -> String {
    format!("{}/", name.trim_end_matches('/'))
}

fn leaves(namespace: &str, tree: &BTreeMap<String, Value>, names: &mut Vec<String>) {
    for (name, value) in tree {
        let name = format!("{namespace}{name}");
        match value {
            Value::Map(members) => leaves(&format!("{name}/"), members, names),
            _ => names.push(name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_values_together_have_a_bound_that_deleting_and_replacing_makes_room_in() {
        let mut parameters = Parameters::default();
        let large = || Value::from("x".repeat(MOST_BYTES / 5));
        for name in ["/a", "/b/c", "/b/d", "/e"] {
            parameters.set(name, large(), "/me").unwrap();
        }
        let refused = parameters.set("/f", large(), "/me").unwrap_err();
        assert_eq!(refused, "the parameters of a graph may take 33554432 bytes");
        assert_eq!(parameters.get("/f"), None);
        for _ in 0..3 {
            parameters.set("/a", large(), "/me").unwrap();
            parameters.set("/b", Value::Int(1), "/me").unwrap();
            parameters.set("/b/c/d", large(), "/me").unwrap();
            parameters.delete("/e").unwrap();
            parameters.set("/e", large(), "/me").unwrap();
        }
        for name in ["/a", "/b", "/e"] {
            parameters.delete(name).unwrap();
        }
        assert_eq!(parameters.bytes, 0);
        let root = Value::Map([("g".to_owned(), Value::Int(1))].into());
        parameters.set("/", root, "/me").unwrap();
        parameters.delete("/g").unwrap();
        assert_eq!(parameters.bytes, 0);
    }
}
