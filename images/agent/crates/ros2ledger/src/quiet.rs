//! Whether the nodes have worked off what they were sent and what they sent each other.

use std::collections::{HashMap, HashSet};
use std::time::Duration;

use crate::process::awake;
use crate::{
    Counts, Endpoint, History, Kind, Ledger, LedgerError, ProcessId, Reliability, Strength,
    Unlisted,
};

#[cfg(test)]
mod tests;

/// How often the counts are read again until they hold still for a moment.
const READS: usize = 4;

/// Where the counts stood at a moment when nothing was under way. The default is the beginning of
/// every endpoint.
#[derive(Clone, Debug, Default)]
pub struct Mark {
    /// In the order of their slots.
    endpoints: Vec<Endpoint>,
}

/// Whether the nodes are at rest. Whoever waits for [`Still`](Quiet::Still) waits through both
/// others, up to a deadline: a doubt can go away as work does.
#[derive(Clone, Debug)]
pub enum Quiet {
    /// All that was published since the mark was taken by each counted subscription, no callback
    /// runs, and that was so at one moment. The next question begins at this mark.
    Still(Mark),
    /// These have work. What is in doubt beside it is so by itself: work that never ends must not hide it.
    Working(Vec<Busy>, Vec<Doubt>),
    /// Nobody has work that can be seen, and yet it is not proved that there is none.
    Unknown(Vec<Doubt>),
}

/// Who has work.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Busy {
    /// Whose it is.
    pub process: ProcessId,
    /// The node that subscribes; empty of a timer or service, whose node is not known.
    pub node: String,
    /// The topic; `None` of a timer or service.
    pub topic: Option<String>,
    /// Callbacks that run, and messages that were taken and not called or returned.
    pub in_hand: u64,
    /// Messages on their way to it, or in its queue. 0 in both: it counts at this moment.
    pub untaken: u64,
    /// What shows that a callback has ended.
    pub strength: Strength,
}

/// What can't be proved.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Doubt {
    /// The node that subscribes; empty where no one node is meant.
    pub node: String,
    /// The topic; empty where no one topic is meant.
    pub topic: String,
    /// Messages that were published since the mark and not taken.
    pub missing: u64,
    /// Why they may not be on their way.
    pub why: Why,
}

/// Why something can't be proved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// More were published than the shortest queue on the way keeps: the oldest may be
    /// overwritten.
    Overwritten {
        /// The depth of that queue, in messages.
        depth: u64,
    },
    /// The subscription or a publisher is best effort: they may be lost.
    BestEffort,
    /// The subscription or a publisher appeared after the mark: they may be from before the two
    /// knew each other; or it has taken more than was published since, which may be from before.
    Late,
    /// A publisher was destroyed, or its process has ended, before all had come.
    PublisherGone,
    /// A publisher of the mark was retired: what it published since is not known.
    Retired,
    /// More were taken than published: somebody publishes without counting, or they waited in a
    /// queue at the mark. Which of them were taken is not known.
    Uncounted,
    /// A publisher of the same process may hand over messages that wait where nothing counts, and a thread there
    /// is awake, which may be on its way to them. Of those for which one waits already, that is seen.
    IntraProcess,
    /// Something found no room in the ledger.
    Unlisted,
}

/// What was read of the ledger.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Look {
    endpoints: Vec<Endpoint>,
    /// Processes with callbacks of timers and services, which ended and which run.
    others: Vec<(ProcessId, u64, u64)>,
    unlisted: bool,
}

/// What the kernel knows of processes.
struct Kernel<'a> {
    /// Whether it is there.
    runs: &'a dyn Fn(ProcessId) -> bool,
    /// Whether no thread of it wants to go on.
    sleeps: &'a dyn Fn(ProcessId) -> bool,
}

/// Asks about each process once.
fn once<'a>(ask: &'a dyn Fn(ProcessId) -> bool) -> impl FnMut(ProcessId) -> bool + 'a {
    let mut known = HashMap::new();
    move |of| *known.entry(of).or_insert_with(|| ask(of))
}

/// What was published on a topic since the mark.
#[derive(Default)]
struct Topic<'a> {
    published: u64,
    by: Vec<&'a Endpoint>,
    retired: bool,
}

/// The same endpoint among others, which are in the order of their slots.
fn same<'a>(among: &'a [Endpoint], endpoint: &Endpoint) -> Option<&'a Endpoint> {
    let at = among.binary_search_by_key(&endpoint.id.slot, |one| one.id.slot).ok()?;
    Some(&among[at]).filter(|one| one.id == endpoint.id)
}

impl Mark {
    /// What an endpoint has counted since.
    fn since(&self, endpoint: &Endpoint, count: impl Fn(&Counts) -> u64) -> u64 {
        let before = same(&self.endpoints, endpoint).map_or(0, |one| count(&one.counts));
        count(&endpoint.counts).saturating_sub(before)
    }

    /// Whether a node has taken more of a topic than at an earlier mark, or was called with more of it that
    /// came within its process.
    pub fn has_come_since(&self, before: &Mark, node: &str, topic: &str) -> bool {
        let got = |counts: &Counts| counts.taken.saturating_add(counts.intra_started);
        let of_it = |one: &&Endpoint| one.kind == Kind::Subscription && one.topic == topic;
        let mut all = self.endpoints.iter().filter(of_it);
        all.any(|one| one.node == node && before.since(one, got) > 0)
    }
}

impl Ledger {
    /// The counts as they stand, for granted that nothing is under way: after the nodes' start,
    /// whose messages may never have had a subscriber. Otherwise [`Quiet::Still`] brings a mark
    /// that is proved. After [`retire`](Ledger::retire) there has to be a new one.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`].
    pub fn mark(&self) -> Result<Mark, LedgerError> {
        Ok(Mark { endpoints: self.endpoints()? })
    }

    /// Whether everything that was published since the mark is worked off. `sent` has how many
    /// messages whoever does not count, as a player, has published on a topic since the mark. It
    /// looks at counts and waits for nothing: [`wait`](Ledger::wait) for
    /// [`Event::Ended`](crate::Event::Ended) and [`Event::Taken`](crate::Event::Taken).
    ///
    /// It does not know of timers that are due later, of services and actions between a request
    /// and its callback, of threads that publish outside of callbacks, and of messages within a process that wait
    /// for a thread which sleeps outside of the middleware. A subscription that
    /// filters what it takes, or does not match a publisher of its topic by type or QoS, is
    /// working for ever.
    ///
    /// # Errors
    /// [`LedgerError::Damaged`].
    pub fn quiet(&self, since: &Mark, sent: &[(&str, u64)]) -> Result<Quiet, LedgerError> {
        let runs = |of| self.runs(of);
        // A number may be another process' by now.
        let sleeps = |of: ProcessId| awake(of.pid).next().is_none() || !self.runs(of);
        settle(since, sent, || self.look(since), &Kernel { runs: &runs, sleeps: &sleeps })
    }

    fn look(&self, since: &Mark) -> Result<Look, LedgerError> {
        let endpoints = self.endpoints_like(&since.endpoints)?;
        Ok(Look::new(endpoints, self.others()?, self.unlisted() != Unlisted::default()))
    }
}

impl Look {
    /// Without what idle nodes count, and what is of no use here.
    fn new(
        mut endpoints: Vec<Endpoint>,
        others: Vec<(ProcessId, u64, u64)>,
        unlisted: bool,
    ) -> Look {
        for one in &mut endpoints {
            (one.thread, one.matched) = (None, None);
            (one.counts.rested, one.counts.seen_at) = (None, Duration::ZERO);
        }
        Look { endpoints, others, unlisted }
    }
}

/// Decides on what is the same in two reads: counts only grow, so that all of it was so together
/// between them.
fn settle(
    since: &Mark,
    sent: &[(&str, u64)],
    mut read: impl FnMut() -> Result<Look, LedgerError>,
    kernel: &Kernel<'_>,
) -> Result<Quiet, LedgerError> {
    let mut look = read()?;
    let mut counting = Vec::new();
    for _ in 0..READS {
        // Behind one read and before the next, between which nobody was awake then.
        let (busy, mut doubts) = decide(since, &look, sent, &mut once(kernel.runs));
        doubts.extend(within(&look, &busy, &mut once(kernel.sleeps)));
        // One read is enough for who has work, and not for a doubt.
        if !busy.is_empty() && doubts.is_empty() {
            return Ok(Quiet::Working(busy, doubts));
        }
        let again = read()?;
        if look == again {
            return Ok(match (busy.is_empty(), doubts.is_empty()) {
                (false, _) => Quiet::Working(busy, doubts),
                (true, false) => Quiet::Unknown(doubts),
                (true, true) => Quiet::Still(Mark { endpoints: again.endpoints }),
            });
        }
        // Who has work has it still.
        counting = busy;
        counting.extend(differing(&look, &again));
        look = again;
    }
    Ok(Quiet::Working(counting, Vec::new()))
}

/// Who counted between two reads.
fn differing(before: &Look, after: &Look) -> Vec<Busy> {
    let counted = |one: &&Endpoint| same(&before.endpoints, one) != Some(one);
    let endpoints = after.endpoints.iter().filter(counted);
    let others = after.others.iter().filter(|one| !before.others.contains(one));
    let busy = endpoints.map(|one| work(one, 0, 0));
    busy.chain(others.map(|(process, ..)| other(*process, 0))).collect()
}

fn work(endpoint: &Endpoint, in_hand: u64, untaken: u64) -> Busy {
    let Endpoint { process, strength, .. } = *endpoint;
    let (node, topic) = (endpoint.node.clone(), Some(endpoint.topic.clone()));
    Busy { process, node, topic, in_hand, untaken, strength }
}

fn other(process: ProcessId, in_hand: u64) -> Busy {
    let strength = Strength::Called;
    Busy { process, node: String::new(), topic: None, in_hand, untaken: 0, strength }
}

/// Who has work, and what can't be proved. Whether a process runs is asked only where it decides:
/// that it has ended excuses what it has not done.
fn decide(
    since: &Mark,
    look: &Look,
    sent: &[(&str, u64)],
    alive: &mut dyn FnMut(ProcessId) -> bool,
) -> (Vec<Busy>, Vec<Doubt>) {
    let topics = published(since, look, sent);
    let (mut busy, mut doubts) = (Vec::new(), Vec::new());
    for (process, ended, started) in &look.others {
        if started > ended && alive(*process) {
            busy.push(other(*process, started - ended));
        }
    }
    for one in look.endpoints.iter().filter(|one| one.kind == Kind::Subscription) {
        let nothing = Topic::default();
        let topic = topics.get(one.topic.as_str()).unwrap_or(&nothing);
        let taken = since.since(one, |counts| counts.taken);
        let in_hand = in_hand(one, topic);
        let missing = if one.destroyed { 0 } else { topic.published.saturating_sub(taken) };
        let why = if one.destroyed { None } else { doubt(since, one, topic, taken, alive) };
        let waits = missing > 0 && why.is_none();
        if (in_hand == 0 && !waits && why.is_none()) || !alive(one.process) {
            continue;
        }
        if in_hand > 0 || waits {
            busy.push(work(one, in_hand, missing));
        }
        if let Some(why) = why {
            let (node, topic) = (one.node.clone(), one.topic.clone());
            doubts.push(Doubt { node, topic, missing, why });
        }
    }
    if look.unlisted {
        let (node, topic) = (String::new(), String::new());
        doubts.push(Doubt { node, topic, missing: 0, why: Why::Unlisted });
    }
    (busy, doubts)
}

/// What a subscription has in hand. Of what it has taken of a topic that its own process publishes too, rclcpp
/// throws copies away, and of several threads the one that did shows it with the next message only: until a
/// callback begins, it is in doubt alone while a thread is awake ([`within`]).
fn in_hand(one: &Endpoint, topic: &Topic) -> u64 {
    let copies = || topic.by.iter().any(|by| by.process == one.process);
    match one.intra_process && one.strength == Strength::Called && copies() {
        true => one.counts.running(),
        false => one.counts.in_hand(one.strength),
    }
}

/// What may wait within processes. What wakes a thread that waits is counted as its process' work; a thread that
/// is handed something while it is in a callback finds it when it waits again, and is awake until then.
fn within(look: &Look, busy: &[Busy], asleep: &mut dyn FnMut(ProcessId) -> bool) -> Vec<Doubt> {
    let handed = || look.endpoints.iter().filter(|one| one.intra_process && !one.destroyed);
    if handed().next().is_none() {
        return Vec::new();
    }
    let publishes = |one: &&Endpoint| one.kind == Kind::Publisher;
    // What a destroyed one published may wait there as well.
    let pairs: HashSet<(ProcessId, &str)> =
        look.endpoints.iter().filter(publishes).map(|one| (one.process, &*one.topic)).collect();
    let works = |of: ProcessId| busy.iter().any(|one| one.process == of && one.in_hand > 0);
    let mut may_wait = |one: &&Endpoint| {
        let paired = pairs.contains(&(one.process, &*one.topic));
        paired && !works(one.process) && !asleep(one.process)
    };
    handed()
        .filter(|one| may_wait(one))
        .map(|one| {
            let (node, topic) = (one.node.clone(), one.topic.clone());
            Doubt { node, topic, missing: 0, why: Why::IntraProcess }
        })
        .collect()
}

/// What went out on each topic since the mark.
fn published<'a>(
    since: &'a Mark,
    look: &'a Look,
    sent: &[(&'a str, u64)],
) -> HashMap<&'a str, Topic<'a>> {
    let mut topics: HashMap<&str, Topic> = HashMap::new();
    for (topic, messages) in sent {
        let published = &mut topics.entry(topic).or_default().published;
        *published = published.saturating_add(*messages);
    }
    for one in look.endpoints.iter().filter(|one| one.kind == Kind::Publisher) {
        let topic = topics.entry(&one.topic).or_default();
        let more = since.since(one, |counts| counts.published);
        topic.published = topic.published.saturating_add(more);
        topic.by.push(one);
    }
    let retired = |one: &&Endpoint| same(&look.endpoints, one).is_none();
    for gone in since.endpoints.iter().filter(retired) {
        if gone.kind == Kind::Publisher {
            topics.entry(&gone.topic).or_default().retired = true;
        }
    }
    topics
}

/// Why it is not certain that this subscription has, or will take, all that was published.
fn doubt(
    since: &Mark,
    one: &Endpoint,
    topic: &Topic,
    taken: u64,
    alive: &mut dyn FnMut(ProcessId) -> bool,
) -> Option<Why> {
    if topic.retired {
        return Some(Why::Retired);
    }
    let is_new = |of: &Endpoint| same(&since.endpoints, of).is_none();
    if taken > topic.published {
        // A new one may have what was published before.
        return Some(if is_new(one) { Why::Late } else { Why::Uncounted });
    }
    if taken == topic.published {
        return None;
    }
    let active = |by: &&&Endpoint| since.since(by, |counts| counts.published) > 0;
    let by: Vec<&Endpoint> = topic.by.iter().filter(active).copied().collect();
    let both = || by.iter().copied().chain([one]);
    if both().any(is_new) {
        return Some(Why::Late);
    }
    if both().any(|of| of.qos.reliability != Reliability::Reliable) {
        return Some(Why::BestEffort);
    }
    let depth = both().map(depth).min().unwrap_or(0);
    if depth < topic.published {
        return Some(Why::Overwritten { depth });
    }
    let gone = by.iter().any(|of| of.destroyed || !alive(of.process));
    gone.then_some(Why::PublisherGone)
}

/// How many messages a queue keeps for certain.
fn depth(of: &Endpoint) -> u64 {
    match of.qos.history {
        History::KeepLast => of.qos.depth,
        History::KeepAll => u64::MAX,
        History::Other(_) => 0,
    }
}
