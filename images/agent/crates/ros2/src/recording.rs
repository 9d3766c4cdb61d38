//! What is recorded: the topics that the player takes from, and the thread that hands it on.

use std::collections::{BTreeSet, HashMap};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, RwLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use bagpipe_graph::{Incoming, Publisher, Sink};
use bagpipe_ros2player::{Qos, Received, SubscriptionId};

use crate::absence::counted;
use crate::accounts::Accounts;
use crate::acquaintance::Acquaintance;
use crate::arrivals::Arrivals;
use crate::clock::source_now;
use crate::life::LifeCycles;
use crate::other_types::OtherTypes;
use crate::topic::Means;
use crate::unnamed::Unnamed;

/// How often the thread looks whether it must end.
const GLANCE: Duration = Duration::from_millis(20);
/// How long a message may come before its subscription is listed, which the same call does that
/// makes it.
const UNLISTED: Duration = Duration::from_secs(20);

/// A recorded topic.
pub(crate) struct Input {
    pub(crate) topic: String,
    pub(crate) subscription: SubscriptionId,
    pub(crate) qos: Qos,
    pub(crate) publisher: Publisher,
    link: u64,
    pub(crate) arrivals: Arrivals,
    accounts: Mutex<Accounts>,
    acquaintance: Mutex<Acquaintance>,
    /// Whose messages can't be recorded, as sentences.
    unrecordable: Mutex<BTreeSet<String>>,
    /// Nodes that publish it, as the graph has them: some may not count.
    pub(crate) others: Mutex<BTreeSet<String>>,
    /// Programs that publish it and are no nodes.
    pub(crate) unnamed: Unnamed,
    /// Who publishes it as another type.
    pub(crate) other_types: OtherTypes,
}

impl Input {
    pub(crate) fn accounts(&self) -> MutexGuard<'_, Accounts> {
        self.accounts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn unrecordable(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.unrecordable.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn acquaintance(&self) -> MutexGuard<'_, Acquaintance> {
        self.acquaintance.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All recorded topics, as the thread sees them.
#[derive(Default)]
pub(crate) struct Inputs {
    all: RwLock<HashMap<SubscriptionId, Arc<Input>>>,
    /// Notified after each batch that was handed on, and when an input is added.
    batches: (Mutex<u64>, Condvar),
    /// Whose transitions come among the messages.
    pub(crate) lives: LifeCycles,
    stop: AtomicBool,
    failure: Mutex<Option<String>>,
}

impl Inputs {
    pub(crate) fn add(
        &self,
        topic: &str,
        (subscription, qos): (SubscriptionId, Qos),
        publisher: Publisher,
    ) {
        let mut all = self.all.write().unwrap_or_else(PoisonError::into_inner);
        let input = Input {
            topic: topic.to_owned(),
            subscription,
            qos,
            publisher,
            link: all.len() as u64,
            arrivals: Arrivals::default(),
            acquaintance: Mutex::default(),
            accounts: Mutex::default(),
            unrecordable: Mutex::default(),
            others: Mutex::default(),
            unnamed: Unnamed::default(),
            other_types: OtherTypes::default(),
        };
        all.insert(subscription, Arc::new(input));
        drop(all);
        self.notify();
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

    /// Waits until nothing is `missing`, asked after each batch: at most for `limit` in which no less
    /// is missing than before, and at most for `whole` in all. A recorder that has no processor for a
    /// second, or has more to take than it can in one, loses nothing. The time in which the machine
    /// stands still does not count.
    pub(crate) fn await_arrivals(
        &self,
        limit: Duration,
        whole: Duration,
        mut missing: impl FnMut() -> u64,
    ) -> bool {
        let (mut fewest, mut since) = (u64::MAX, Duration::ZERO);
        let (mut waited, mut looked) = (Duration::ZERO, Instant::now());
        let (batches, come) = &self.batches;
        let mut seen = batches.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            // A batch that comes now waits for the lock, and is noticed.
            let left = missing();
            if left == 0 {
                return true;
            }
            let now = Instant::now();
            waited += counted(now - looked);
            looked = now;
            if left < fewest {
                (fewest, since) = (left, waited);
            }
            let until = (since + limit).min(whole.max(limit));
            let pause = until.saturating_sub(waited).min(GLANCE);
            if pause.is_zero() || self.failure().is_some() {
                return false;
            }
            seen = come.wait_timeout(seen, pause).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Waits until `holds`, asked after each batch, at most for `limit`.
    fn wait(&self, limit: Duration, mut holds: impl FnMut() -> bool) -> bool {
        self.await_arrivals(limit, limit, || u64::from(!holds()))
    }

    fn run(&self, means: &Means, sink: &mut dyn Sink) {
        while !self.stop.load(Ordering::Relaxed) {
            let handed =
                means.player.receive(GLANCE, &mut |received| self.hand_on(&received, sink));
            match handed {
                Ok(0) => continue,
                Ok(_) => {}
                Err(error) => self.fail(error.to_string()),
            }
            self.notify();
            if self.failure().is_some() {
                return;
            }
        }
    }

    /// The first failure stays.
    pub(crate) fn fail(&self, why: String) {
        let mut failure = self.failure.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(why);
    }

    fn notify(&self) {
        let (batches, come) = &self.batches;
        *batches.lock().unwrap_or_else(PoisonError::into_inner) += 1;
        come.notify_all();
    }

    fn find(&self, subscription: SubscriptionId) -> Option<Arc<Input>> {
        let all = self.all.read().unwrap_or_else(PoisonError::into_inner);
        all.get(&subscription).cloned()
    }

    fn hand_on(&self, received: &Received<'_>, sink: &mut dyn Sink) {
        let mut input = self.find(received.subscription);
        let transition = || self.lives.event(received.subscription, received.data);
        let mut event = if input.is_none() { transition() } else { None };
        if input.is_none() && event.is_none() {
            // What was kept for who comes late arrives before the call that subscribes has ended.
            self.wait(UNLISTED, || {
                input = self.find(received.subscription);
                event = transition();
                input.is_some() || event.is_some() || self.stop.load(Ordering::Relaxed)
            });
        }
        if let Some(event) = event {
            return event.into_iter().for_each(|why| sink.broken(why));
        }
        let Some(input) = input else {
            return self.fail("a message came of a subscription that nobody made".to_owned());
        };
        let Input { topic, publisher, link, .. } = &*input;
        sink.message(Incoming { topic, publisher, link: *link, data: received.data });
        input.arrivals.add(received.publisher, received.source_timestamp, source_now());
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_machine_that_stands_still_uses_up_a_look_of_a_wait_and_no_more() {
        let (inputs, limit, mut asked) = (Inputs::default(), Duration::from_millis(100), 0);
        let come = || {
            asked += 1;
            if asked == 1 {
                std::thread::sleep(3 * limit);
            }
            asked == 3
        };
        assert!(inputs.wait(limit, come));
        assert!(!inputs.wait(limit, || false));
    }

    /// Each question is asked a glance of 20 ms after the one before.
    fn counts_down(from: u64, by: u64) -> impl FnMut() -> u64 {
        let mut left = from + by;
        move || {
            left = left.saturating_sub(by);
            left
        }
    }

    #[test]
    fn who_still_receives_is_waited_for_beyond_the_limit_and_who_does_not_is_not() {
        let (inputs, limit) = (Inputs::default(), 3 * GLANCE);
        assert!(inputs.await_arrivals(limit, 100 * limit, counts_down(12, 1)));
        assert!(!inputs.await_arrivals(limit, 100 * limit, || 1));
        assert!(inputs.await_arrivals(limit, Duration::ZERO, || 0));
    }

    #[test]
    fn who_receives_for_ever_is_waited_for_until_the_whole_time_is_over() {
        let (inputs, limit) = (Inputs::default(), 3 * GLANCE);
        let mut asked = 0;
        let mut fewer = counts_down(u64::MAX / 2, 1);
        let missing = || {
            asked += 1;
            fewer()
        };
        assert!(!inputs.await_arrivals(limit, 4 * limit, missing));
        assert!((7..=13).contains(&asked), "{asked}");
    }
}
