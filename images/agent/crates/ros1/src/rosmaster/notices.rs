//! What nodes learn without having asked: who publishes what they read, and new values of
//! parameters. Each node is called by a thread of its own, so that one that does not answer holds up
//! nobody else.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::sockets::lock;
use crate::xmlrpc::Client;
use crate::{RosError, Value};

/// How long a node may take to answer.
const DEADLINE: Duration = Duration::from_secs(10);

/// A call to a node: the method, and what follows the caller's name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Notice {
    pub(super) method: &'static str,
    pub(super) params: Vec<Value>,
}

impl Notice {
    /// Whether the other is about the same topic or parameter: then only the later one is worth
    /// sending, and no more than one for each waits.
    fn is_about_the_same(&self, other: &Notice) -> bool {
        self.method == other.method && self.params.first() == other.params.first()
    }
}

/// Calls that wait, by the node's URI; a node that is there has a thread.
#[derive(Clone, Default)]
pub(super) struct Notices(Arc<Mutex<HashMap<String, Vec<Notice>>>>);

impl Notices {
    /// Calls a node soon, after what waits for it.
    pub(super) fn send(&self, uri: &str, notice: Notice) {
        let mut waiting = lock(&self.0);
        match waiting.entry(uri.to_owned()) {
            Entry::Occupied(mut before) => {
                before.get_mut().retain(|one| !one.is_about_the_same(&notice));
                before.get_mut().push(notice);
            }
            Entry::Vacant(place) => {
                place.insert(vec![notice]);
                let (notices, uri) = (self.clone(), uri.to_owned());
                let spawned = std::thread::Builder::new().name("notices".into()).spawn({
                    let uri = uri.clone();
                    move || notices.deliver(&uri)
                });
                if spawned.is_err() {
                    // As if it had not answered: the next notice tries again.
                    waiting.remove(&uri);
                }
            }
        }
    }

    fn next(&self, uri: &str) -> Option<Notice> {
        let mut waiting = lock(&self.0);
        let of_node = waiting.get_mut(uri)?;
        if of_node.is_empty() {
            waiting.remove(uri);
            return None;
        }
        Some(of_node.remove(0))
    }

    fn deliver(&self, uri: &str) {
        while let Some(notice) = self.next(uri) {
            // A node that has gone gets none; one that lives and does not answer asks again itself.
            let _gone: Result<Value, RosError> = Client::new(uri, DEADLINE).and_then(|client| {
                let caller = Value::from("/master");
                let params: Vec<Value> = std::iter::once(caller).chain(notice.params).collect();
                client.call(notice.method, &params)
            });
        }
    }
}
