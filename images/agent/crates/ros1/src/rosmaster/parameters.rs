//! The Parameter Server (<https://wiki.ros.org/ROS/Parameter%20Server%20API>): a tree of values, and
//! the nodes that keep copies of parts of it.

use std::collections::BTreeMap;

use super::names::parts;
use crate::Value;

/// Levels of a parameter's name. With those that a value of the wire may have no walk through the
/// tree uses up a thread's stack.
const MOST_LEVELS: usize = 64;

/// A node that keeps a copy: its name, and the URI of its slave API.
pub(super) type Subscriber = (String, String);

/// What a subscriber is to be notified: the key ends with a slash, and a value that is gone is an empty
/// tree.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Update {
    pub(super) uri: String,
    pub(super) key: String,
    pub(super) value: Value,
}

#[derive(Default)]
pub(super) struct Parameters {
    tree: BTreeMap<String, Value>,
    /// By key, which ends with a slash.
    subscribers: BTreeMap<String, Vec<Subscriber>>,
}

impl Parameters {
    /// The value of a global name; `None` where there is none.
    pub(super) fn get(&self, name: &str) -> Option<Value> {
        let mut parts = parts(name);
        let Some(first) = parts.next() else { return Some(Value::Map(self.tree.clone())) };
        let mut value = self.tree.get(first)?;
        for part in parts {
            let Value::Map(members) = value else { return None };
            value = members.get(part)?;
        }
        Some(value.clone())
    }

    /// Sets a global name, and whatever is not a tree on the way to it becomes one.
    ///
    /// # Errors
    /// A sentence: the root can only be a tree, and names have a bound.
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
        let updates = self.updates(name, &value, Some(caller));
        let Some(last) = way.pop() else {
            let Value::Map(tree) = value else {
                return Err("the root of all parameters can only be set to a tree".to_owned());
            };
            self.tree = tree;
            return Ok(updates);
        };
        let mut tree = &mut self.tree;
        for part in way {
            tree = tree_at(tree, part)?;
        }
        tree.insert(last.to_owned(), value);
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
        tree.remove(last)?;
        Some(self.updates(name, &Value::Map(BTreeMap::new()), None))
    }

    /// The name that `key` has in the nearest namespace, from the caller's own upwards, in which its
    /// first part exists.
    pub(super) fn search(&self, caller: &str, key: &str) -> Option<String> {
        if key.starts_with('/') {
            return self.get(key).map(|_| key.to_owned());
        }
        let first = parts(key).next()?;
        let around: Vec<&str> = parts(caller).collect();
        (0..=around.len()).rev().find_map(|levels| {
            let namespace: String =
                around[..levels].iter().map(|part| format!("/{part}")).collect();
            self.get(&format!("{namespace}/{first}")).map(|_| format!("{namespace}/{key}"))
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

    /// Who is to be notified that a name has this value now. Who has set it knows it, if it has a copy of
    /// that or of a tree around it.
    fn updates(&self, name: &str, value: &Value, setter: Option<&str>) -> Vec<Update> {
        let changed = with_slash(name);
        let mut updates = Vec::new();
        for (key, subscribers) in &self.subscribers {
            let around = changed.starts_with(key.as_str());
            let (key, value) = match key.strip_prefix(&changed) {
                _ if around => (&changed, value.clone()),
                Some(within) if matches!(value, Value::Map(_)) => (key, member(value, within)),
                _ => continue,
            };
            let notified =
                subscribers.iter().filter(|one| !(around && setter == Some(one.0.as_str())));
            updates.extend(notified.map(|(_, uri)| Update {
                uri: uri.clone(),
                key: key.clone(),
                value: value.clone(),
            }));
        }
        updates
    }
}

/// The tree of this name in another, which is made if there is none.
fn tree_at<'t>(
    tree: &'t mut BTreeMap<String, Value>,
    name: &str,
) -> Result<&'t mut BTreeMap<String, Value>, String> {
    if !matches!(tree.get(name), Some(Value::Map(_))) {
        tree.insert(name.to_owned(), Value::Map(BTreeMap::new()));
    }
    match tree.get_mut(name) {
        Some(Value::Map(members)) => Ok(members),
        _ => Err(format!("{name} is no tree")),
    }
}

fn with_slash(name: &str) -> String {
    format!("{}/", name.trim_end_matches('/'))
}

/// A value's part, or an empty tree.
fn member(value: &Value, within: &str) -> Value {
    let found = parts(within).try_fold(value, |value, part| match value {
        Value::Map(members) => members.get(part),
        _ => None,
    });
    found.cloned().unwrap_or_else(|| Value::Map(BTreeMap::new()))
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
