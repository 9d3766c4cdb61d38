//! Our node in the graph.

mod others;
mod recorded;
mod strangers;
mod types;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use bagpipe_graph::{
    Audit, GraphError, Node, NodeOptions, PacedBy, Publication, Seen, Sink, SystemState, TopicInfo,
};
use bagpipe_ros2ledger::{Flow, Ledger, LedgerError};
use bagpipe_ros2player::{Player, Reliability};

use self::others::Around;
use crate::audit::Reader;
use crate::clock::CLOCK;
use crate::definition::otherwise_installed;
use crate::error::failed;
use crate::handed::Handed;
use crate::recording::{Inputs, Receiving};
use crate::seen::{all_count, namesakes, people_who_publish};
use crate::stillness::Stillness;
use crate::topic::{Means, Topic};
use crate::undetermined::Undetermined;
use crate::unmet::Unmet;
use crate::unnamed_topics::UnnamedTopics;
use crate::{QosOverride, Ros2Options, qos};

/// A node of ours: the player's, with what the ledger says of the others.
pub(crate) struct Graph {
    name: String,
    // Before the player, which it takes from.
    _receiving: Receiving,
    means: Arc<Means>,
    inputs: Arc<Inputs>,
    qos: BTreeMap<String, QosOverride>,
    prefixes: Vec<PathBuf>,
    topics: Mutex<Vec<Arc<Topic>>>,
    wanted: Mutex<BTreeSet<String>>,
    stillness: Stillness,
    undetermined: Undetermined,
    unmet: Unmet,
    /// Whether what was published did once not come to us.
    lacked: AtomicBool,
    /// Whether the last look at the graph failed.
    is_unread: AtomicBool,
    unnamed_topics: UnnamedTopics,
    /// Whether every node counted and did its work at the last look.
    all_spin: AtomicBool,
}

impl Graph {
    pub(crate) fn join(
        name: &str,
        player: Player,
        middleware: &Ros2Options,
        options: &NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Graph, GraphError> {
        let Ros2Options { ledger, qos, prefixes, active, .. } = middleware;
        if options.paced_by == PacedBy::Schedule {
            player.keep_to_the_clock();
        }
        ledger.control_flow(flow(middleware.flow_control, options.paced_by));
        let means = Arc::new(Means {
            player,
            ledger: Arc::clone(ledger),
            paced_by: options.paced_by,
            stall: options.stall,
            links: AtomicU64::new(1),
            most_waiting: middleware.most_waiting(),
            patience: Mutex::new(options.stall),
            watching: AtomicBool::new(true),
        });
        // Those of a case before.
        ledger.disown_all();
        let inputs = Arc::new(Inputs::default());
        let receiving = Receiving::start(&inputs, &means, sink).map_err(failed)?;
        inputs.lives.follow(&means.player, active)?;
        Ok(Graph {
            name: name.to_owned(),
            _receiving: receiving,
            means,
            inputs,
            qos: qos.clone(),
            prefixes: prefixes.clone(),
            topics: Mutex::default(),
            wanted: Mutex::default(),
            stillness: Stillness::default(),
            undetermined: Undetermined::default(),
            unmet: Unmet::default(),
            lacked: AtomicBool::new(false),
            is_unread: AtomicBool::new(false),
            unnamed_topics: UnnamedTopics::default(),
            all_spin: AtomicBool::new(false),
        })
    }

    fn ledger(&self) -> &Ledger {
        &self.means.ledger
    }

    fn look_once(&self) -> Result<Seen, GraphError> {
        if let Some(why) = self.inputs.failure() {
            return Err(failed(why));
        }
        self.inputs.lives.ask(&self.means.player)?;
        // Before what was published is read, so that what comes meanwhile is missing for a moment.
        let inputs = self.inputs.all();
        let handed: Vec<Handed> = inputs.iter().map(|input| input.arrivals.handed()).collect();
        let Around { nodes, look, state } = self.look_around()?;
        self.must_be_alone(&nodes);
        let all_count = all_count(&look.endpoints, &nodes, &self.name);
        self.all_spin.store(look.all_spin() && all_count, Ordering::Relaxed);
        let namesakes = namesakes(&look.endpoints, &nodes);
        for topic in self.topics().iter() {
            let name = &topic.info().topic;
            let mut uncounted = self.unlisted(topic, &state, &look);
            uncounted.extend(topic.hidden(&look, &namesakes, uncounted.len()));
            let uncounted: Vec<String> = uncounted.into_iter().collect();
            topic.refresh(&look, Some(&uncounted)).map_err(failed)?;
            let publishing = self.publishing(&state, name);
            topic.note_publishers(publishing.chain(people_who_publish(&nodes, name)));
        }
        let types = self.topics_of_graph()?;
        let subscribed = self.subscribe_to_wanted(&types, &look.endpoints);
        for (input, handed) in inputs.iter().zip(handed) {
            self.note_others(input, &nodes, &state);
            self.compare(input, &handed, &look);
            self.look_for_other_types(input, &types, &look);
        }
        self.look_for_unnamed(&nodes, &types, &look);
        self.look_for_unmet(&look);
        subscribed?;
        Ok(Seen { state, again: 0 })
    }

    fn topics(&self) -> MutexGuard<'_, Vec<Arc<Topic>>> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wanted(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// How what the stack's nodes publish goes out.
fn flow(controlled: bool, paced_by: PacedBy) -> Flow {
    match paced_by {
        _ if !controlled => Flow::Free,
        PacedBy::Schedule => Flow::ByTheClock,
        PacedBy::Subscribers => Flow::Controlled,
    }
}

impl Node for Graph {
    fn name(&self) -> &str {
        &self.name
    }

    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Publication>, GraphError> {
        let otherwise = otherwise_installed(&info, &self.prefixes);
        let wanted = self.qos.get(&info.topic).copied().unwrap_or_default();
        let mut played = qos::played(&info, wanted);
        if info.topic == CLOCK && wanted.reliability.is_none() {
            played.reliability = Reliability::Reliable;
        }
        let publisher = self.means.player.advertise(&info.topic, &info.datatype, &played);
        let (means, publisher) = (Arc::clone(&self.means), publisher.map_err(failed)?);
        if let Some(gid) = means.player.gid(publisher) {
            self.ledger().own(&gid).map_err(failed)?;
        }
        let topic = Arc::new(Topic::new(means, info, publisher, played, otherwise));
        self.topics().push(Arc::clone(&topic));
        Ok(topic)
    }

    fn subscribe(&self, topic: &str) -> Result<(), GraphError> {
        self.unnamed_topics.ask(topic);
        if self.inputs.of(topic).is_none() {
            self.wanted().insert(topic.to_owned());
        }
        Ok(())
    }

    fn look(&self) -> Result<Seen, GraphError> {
        let looked = self.look_once();
        self.is_unread.store(looked.is_err(), Ordering::Relaxed);
        looked
    }

    fn unnamed_topics(&self, state: &SystemState) -> Result<Vec<String>, GraphError> {
        self.topics_without_names(state)
    }

    fn absent(&self) -> Vec<String> {
        self.inputs.lives.absent()
    }

    fn all_spin(&self, processes: &BTreeSet<i32>) -> bool {
        self.all_spin.load(Ordering::Relaxed) && processes.iter().all(|pid| self.is_there(*pid))
    }

    fn begin(&self) -> Vec<String> {
        // A ledger that can't be read fails the next look.
        let _ = self.undetermined.begin(self.ledger());
        self.begin_without_unmet();
        self.begin_without_unrecordable();
        self.inputs.lives.hold()
    }

    fn restarted(&self, again: u64) -> String {
        format!("{again} registrations were lost")
    }

    fn subscribed_topics(&self) -> Vec<String> {
        let known = self.inputs.all().into_iter().map(|input| input.topic.clone());
        known.chain(self.wanted().iter().cloned()).collect()
    }

    fn publishers_of(&self, topic: &str) -> usize {
        let Some(input) = self.inputs.of(topic) else { return 0 };
        let matched = self.means.player.publishers(input.subscription).unwrap_or_default();
        input.acquaintance().among(matched)
    }

    /// In lock-step and at full speed the stack's own messages are worked off first, from the first
    /// sweep on.
    fn sweep(&self, limit: Duration) {
        if self.means.paced_by == PacedBy::Subscribers {
            let all = self.topics().clone();
            let sent: Vec<(String, u64)> =
                all.iter().map(|topic| (topic.info().topic.clone(), topic.messages())).collect();
            // A ledger that can't be read fails the next look.
            let ours = (self.means.player.pid(), &sent[..]);
            let _ = self.stillness.wait(self.ledger(), ours, self.means.stall);
        }
        // Nor can what lacks then be known: it is reported.
        let Ok(due) = self.due() else { return };
        let missing = || due.iter().map(|(input, due)| input.arrivals.missing(due)).sum();
        let exact = self.means.paced_by == PacedBy::Subscribers;
        let first = exact && !self.lacked.load(Ordering::Relaxed);
        let limit = if first { limit.max(recorded::ON_ITS_WAY) } else { limit };
        // What did not come then is lacking: nothing after it is waited for as long, nor it again.
        if !self.inputs.await_arrivals(limit, self.means.stall, missing) {
            self.lacked.store(true, Ordering::Relaxed);
            due.iter().for_each(|(input, due)| input.arrivals.give_up(due));
        }
    }

    fn counts_publishes(&self) -> bool {
        true
    }

    fn lacking(&self) -> Vec<String> {
        // Before what is due, whose marks are its own.
        let mut lacking = self.unmet();
        let due = match self.due_at_last() {
            Ok(due) => due,
            Err(error) => {
                return vec![format!("what was published can't be known: {}", error.source)];
            }
        };
        // Once more for a play that was shorter than who comes needs to be seen.
        if let Ok(nodes) = self.means.player.graph() {
            self.must_be_alone(&nodes);
        }
        self.look_for_other_types_at_last();
        if self.is_unread.load(Ordering::Relaxed)
            && let Err(error) = self.look()
        {
            lacking.push(format!("the graph can't be read to its end: {}", error.source));
        }
        lacking.extend(self.inputs.failure());
        // Who came behind the last message has got those that are kept.
        lacking.extend(self.topics().iter().filter_map(|topic| topic.misread().map(str::to_owned)));
        for (input, due) in &due {
            lacking.extend(input.unrecordable().iter().cloned());
            lacking.extend(input.other_types.lacking(&input.topic, &input.publisher.datatype));
            let (handed, published) = (input.arrivals.handed_by_mark(), input.accounts().offered());
            lacking.extend(self.own(input, handed.all.saturating_sub(published)));
            lacking.extend(due.lacking(&input.topic, &handed, published));
        }
        lacking.sort();
        lacking
    }

    fn remarks(&self) -> Vec<String> {
        self.look_for_unnamed_at_last();
        [self.stillness.remarks(), self.uncounted(), self.unnamed_topics.remarks()].concat()
    }

    fn undetermined(&self) -> Vec<String> {
        let unread = |error: LedgerError| vec![format!("who may differ can't be known: {error}")];
        self.undetermined.remarks(self.ledger()).unwrap_or_else(unread)
    }

    fn audit(&self, _: Duration) -> Box<dyn Audit> {
        let topics = self.topics().clone();
        let (ledger, inputs) = (Arc::clone(&self.means.ledger), Arc::clone(&self.inputs));
        Box::new(Reader { ledger, topics, inputs })
    }
}
