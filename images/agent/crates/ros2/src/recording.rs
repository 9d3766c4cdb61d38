//! What is recorded: the topics that the player takes from, and the thread that hands it on.

use std::collections::HashMap;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bagpipe_graph::{Incoming, Publisher, Sink};
use bagpipe_ros2player::{Received, SubscriptionId};

use crate::account::Account;
use crate::topic::Means;

/// How often the thread looks whether it must end.
const GLANCE: Duration = Duration::from_millis(20);

/// A recorded topic.
pub(crate) struct Input {
    pub(crate) topic: String,
    pub(crate) subscription: SubscriptionId,
    pub(crate) publisher: Publisher,
    link: u64,
    /// Messages that were handed to the sink.
    pub(crate) handed: AtomicU64,
    pub(crate) account: Mutex<Account>,
}

impl Input {
    pub(crate) fn account(&self) -> MutexGuard<'_, Account> {
        self.account.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All recorded topics, as the thread sees them.
#[derive(Default)]
pub(crate) struct Inputs {
    all: RwLock<HashMap<SubscriptionId, Arc<Input>>>,
    /// Notified after each batch that was handed on.
    batches: (Mutex<u64>, Condvar),
    stop: AtomicBool,
    failure: Mutex<Option<String>>,
}

impl Inputs {
    pub(crate) fn add(&self, topic: &str, subscription: SubscriptionId, publisher: Publisher) {
        let mut all = self.all.write().unwrap_or_else(PoisonError::into_inner);
        let link = all.len() as u64;
        let topic = topic.to_owned();
        let (handed, account) = (AtomicU64::new(0), Mutex::default());
        let input = Input { topic, subscription, publisher, link, handed, account };
        all.insert(subscription, Arc::new(input));
    }

    pub(crate) fn all(&self) -> Vec<Arc<Input>> {
        let all = self.all.read().unwrap_or_else(PoisonError::into_inner);
        all.values().cloned().collect()
    }

    pub(crate) fn of(&self, topic: &str) -> Option<Arc<Input>> {
        self.all().into_iter().find(|input| input.topic == topic)
    }

    /// Why nothing is handed on any more, if that is so.
    pub(crate) fn failure(&self) -> Option<String> {
        self.failure.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Waits until `holds`, asked after each batch, at most for `limit`.
    pub(crate) fn wait(&self, limit: Duration, mut holds: impl FnMut() -> bool) -> bool {
        let deadline = Instant::now() + limit;
        let (batches, come) = &self.batches;
        let mut seen = batches.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            // A batch that comes now waits for the lock, and is noticed.
            if holds() {
                return true;
            }
            let left = deadline.saturating_duration_since(Instant::now());
            if left.is_zero() || self.failure().is_some() {
                return false;
            }
            seen =
                come.wait_timeout(seen, left.min(GLANCE)).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn run(&self, means: &Means, sink: &mut dyn Sink) {
        while !self.stop.load(Ordering::Relaxed) {
            let handed =
                means.player.receive(GLANCE, &mut |received| self.hand_on(&received, sink));
            match handed {
                Ok(0) => continue,
                Ok(_) => {}
                Err(error) => {
                    *self.failure.lock().unwrap_or_else(PoisonError::into_inner) =
                        Some(error.to_string());
                }
            }
            let (batches, come) = &self.batches;
            *batches.lock().unwrap_or_else(PoisonError::into_inner) += 1;
            come.notify_all();
            if self.failure().is_some() {
                return;
            }
        }
    }

    fn hand_on(&self, received: &Received<'_>, sink: &mut dyn Sink) {
        let input = {
            let all = self.all.read().unwrap_or_else(PoisonError::into_inner);
            all.get(&received.subscription).cloned()
        };
        let Some(input) = input else { return };
        let Input { topic, publisher, link, .. } = &*input;
        sink.message(Incoming { topic, publisher, link: *link, data: received.data });
        input.handed.fetch_add(1, Ordering::Release);
    }
}

/// The thread that hands on what comes; dropping it ends it.
pub(crate) struct Receiving {
    inputs: Arc<Inputs>,
    thread: Option<JoinHandle<()>>,
}

impl Receiving {
    /// # Errors
    /// No thread can be had.
    pub(crate) fn start(
        inputs: &Arc<Inputs>,
        means: &Arc<Means>,
        mut sink: Box<dyn Sink>,
    ) -> std::io::Result<Receiving> {
        let (of_thread, means) = (Arc::clone(inputs), Arc::clone(means));
        let thread = std::thread::Builder::new()
            .name("ros2-record".to_owned())
            .spawn(move || of_thread.run(&means, &mut *sink))?;
        Ok(Receiving { inputs: Arc::clone(inputs), thread: Some(thread) })
    }
}

impl Drop for Receiving {
    fn drop(&mut self) {
        self.inputs.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _its_own_panic = thread.join();
        }
    }
}
