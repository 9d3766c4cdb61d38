//! What nodes learn without having asked: who publishes what they read, and new values of
//! parameters. Few threads call them; a node is called by one at a time, in order, and one that does
//! not answer holds up nobody else until there is one for each thread.

use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use crate::sockets::lock;
use crate::xmlrpc::Client;
use crate::{RosError, Value};

/// How long a node may take to answer.
const DEADLINE: Duration = Duration::from_secs(10);
/// Nodes that are called at once: a stack can register any number of addresses, and the threads are
/// those of the process that plays and records.
const MOST_CALLED: usize = 32;
/// Notices that wait for one node, each of a topic or a parameter of its own.
const MOST_WAITING: usize = 10_000;
/// Bytes of all notices that wait.
const MOST_BYTES: usize = 64 << 20;

/// A call to a node: the method, and what follows the caller's name, which several may share.
#[derive(Clone)]
pub(super) struct Notice {
    method: &'static str,
    content: Arc<Content>,
}

struct Content {
    params: Vec<Value>,
    bytes: usize,
    held: Arc<AtomicUsize>,
}

impl Drop for Content {
    fn drop(&mut self) {
        self.held.fetch_sub(self.bytes, Ordering::Relaxed);
    }
}

impl Notice {
    /// Whether the other is about the same topic or parameter: then only the later one is worth
    /// sending, and no more than one for each waits.
    fn is_about_the_same(&self, other: &Notice) -> bool {
        self.method == other.method && self.content.params.first() == other.content.params.first()
    }
}

/// Calls that wait, until the master ends.
#[derive(Clone, Default)]
pub(super) struct Notices {
    state: Arc<Mutex<State>>,
    /// Bytes of all notices that are there.
    held: Arc<AtomicUsize>,
}

#[derive(Default)]
struct State {
    /// By the node's URI; one that is being called is there too.
    waiting: HashMap<String, VecDeque<Notice>>,
    /// Nodes that nobody calls and for which something waits.
    ready: VecDeque<String>,
    /// Threads that call.
    callers: usize,
    ended: bool,
}

impl State {
    fn put(&mut self, uri: &str, notice: Notice) {
        let Some(before) = self.waiting.get_mut(uri) else {
            self.waiting.insert(uri.to_owned(), VecDeque::from([notice]));
            self.ready.push_back(uri.to_owned());
            return;
        };
        before.retain(|one| !one.is_about_the_same(&notice));
        if before.len() >= MOST_WAITING {
            // It has not answered for that long: as if it had gone.
            before.clear();
        }
        before.push_back(notice);
    }

    /// The next call, after that of `called`, for which more may wait.
    fn next(&mut self, called: Option<String>) -> Option<(String, Notice)> {
        if let Some(uri) = called {
            match self.waiting.get(&uri).is_some_and(|more| !more.is_empty()) {
                true => self.ready.push_back(uri),
                false => drop(self.waiting.remove(&uri)),
            }
        }
        while let Some(uri) = self.ready.pop_front() {
            if let Some(notice) = self.waiting.get_mut(&uri).and_then(VecDeque::pop_front) {
                return Some((uri, notice));
            }
            self.waiting.remove(&uri);
        }
        None
    }

    /// Drops all that waits for the node for which most waits.
    fn give_the_slowest_up(&mut self) {
        if let Some(most) = self.waiting.values_mut().max_by_key(|notices| notices.len()) {
            most.clear();
        }
    }
}

impl Notices {
    /// A call to nodes.
    pub(super) fn notice(&self, method: &'static str, params: Vec<Value>) -> Notice {
        let bytes = params.iter().map(Value::bytes).sum();
        self.held.fetch_add(bytes, Ordering::Relaxed);
        let held = Arc::clone(&self.held);
        Notice { method, content: Arc::new(Content { params, bytes, held }) }
    }

    /// Calls a node soon, after what waits for it.
    pub(super) fn send(&self, uri: &str, notice: Notice) {
        let mut state = lock(&self.state);
        if state.ended {
            return;
        }
        if self.held.load(Ordering::Relaxed) > MOST_BYTES {
            state.give_the_slowest_up();
        }
        state.put(uri, notice);
        if state.ready.is_empty() || state.callers >= MOST_CALLED {
            return;
        }
        let notices = self.clone();
        let calling = move || notices.call_all();
        // Without a thread it waits for one that there is, or for the next notice.
        if std::thread::Builder::new().name("notices".into()).spawn(calling).is_ok() {
            state.callers += 1;
        }
    }

    /// Sends nothing any more. Calls that are on their way have their deadline.
    pub(super) fn end(&self) {
        let mut state = lock(&self.state);
        let callers = state.callers;
        *state = State { ended: true, callers, ..State::default() };
    }

    /// Whether the master has ended.
    pub(super) fn have_ended(&self) -> bool {
        lock(&self.state).ended
    }

    fn call_all(&self) {
        let mut called = None;
        loop {
            let mut state = lock(&self.state);
            let Some((uri, notice)) = state.next(called.take()) else {
                state.callers -= 1;
                return;
            };
            drop(state);
            // A node that has gone gets none; one that lives and does not answer asks again itself.
            let _gone: Result<Value, RosError> = Client::new(&uri, DEADLINE).and_then(|client| {
                let caller = Value::from("/master");
                let params = std::iter::once(&caller).chain(&notice.content.params);
                client.call(notice.method, params)
            });
            called = Some(uri);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::ErrorKind;
    use std::net::{TcpListener, TcpStream};
    use std::time::Instant;

    use super::*;

    /// Nodes that are connected to and never answer.
    fn silent() -> (TcpListener, String) {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let uri = format!("http://{}", listener.local_addr().unwrap());
        (listener, uri)
    }

    fn update(notices: &Notices, topic: &str) -> Notice {
        notices.notice("publisherUpdate", vec![topic.into(), Value::List(Vec::new())])
    }

    #[test]
    fn many_nodes_that_never_answer_take_few_threads() {
        let (notices, (_listener, uri)) = (Notices::default(), silent());
        for node in 0..5 * MOST_CALLED {
            notices.send(&format!("{uri}/{node}"), update(&notices, "/t"));
        }
        assert_eq!(lock(&notices.state).callers, MOST_CALLED);
        notices.end();
    }

    #[test]
    fn a_node_that_does_not_answer_keeps_no_more_than_a_bound_waiting() {
        let (notices, (_listener, uri)) = (Notices::default(), silent());
        for topic in 0..MOST_WAITING + 100 {
            notices.send(&uri, update(&notices, &format!("/{topic}")));
        }
        assert!(lock(&notices.state).waiting[&uri].len() <= MOST_WAITING);
        for topic in 0..100 {
            let large = vec![format!("/large/{topic}/").into(), "x".repeat(2 << 20).into()];
            notices.send(&uri, notices.notice("paramUpdate", large));
            let held = notices.held.load(Ordering::Relaxed);
            assert!(held < MOST_BYTES + (5 << 20), "{held} bytes after {topic}");
        }
        notices.end();
        // What was on its way stays until its deadline.
        assert!(notices.held.load(Ordering::Relaxed) < 1024);
    }

    #[test]
    fn nothing_more_is_sent_once_the_master_has_ended() {
        let (notices, (listener, uri)) = (Notices::default(), silent());
        notices.send(&uri, update(&notices, "/first"));
        let first: TcpStream = listener.accept().unwrap().0;
        notices.send(&uri, update(&notices, "/second"));
        notices.end();
        notices.send(&uri, update(&notices, "/third"));
        drop(first);
        let deadline = Instant::now() + 3 * DEADLINE;
        while lock(&notices.state).callers > 0 {
            assert!(Instant::now() < deadline, "a thread calls on");
            std::thread::park_timeout(Duration::from_millis(10));
        }
        listener.set_nonblocking(true).unwrap();
        assert_eq!(listener.accept().unwrap_err().kind(), ErrorKind::WouldBlock);
    }
}
