//! Our node in the graph.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use bagpipe_graph::{
    Audit, GraphError, Node, NodeOptions, PacedBy, Publication, Publisher, Seen, Sink, SystemState,
    TopicInfo,
};
use bagpipe_ros2ledger::{Endpoint, Kind, Ledger, Unlisted};
use bagpipe_ros2player::{GraphNode, Player, Qos, Reliability};

use crate::audit::Reader;
use crate::definition::{installed, otherwise_installed, schema_encoding};
use crate::error::failed;
use crate::recording::{Input, Inputs, Receiving};
use crate::seen::{namesakes, state};
use crate::stillness::{Stillness, counted};
use crate::topic::{Look, Means, Topic, uncounted};
use crate::{QosOverride, Ros2Options, qos, stamp};

/// What our players' names begin with; their process and a number follow.
pub(crate) const PLAYER: &str = "/bagpipe_player_";
/// How long a subscription may be in the graph before its process has listed it: a moment, unless that
/// gets no processor just then.
const UNLISTED: Duration = Duration::from_millis(500);
/// How often it is looked for meanwhile.
const AGAIN: Duration = Duration::from_millis(5);
/// How long a message may be on its way to us once all is over.
const ON_ITS_WAY: Duration = Duration::from_secs(1);

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
    /// Whether what was published did once not come to us.
    lacked: AtomicBool,
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
        let means = Arc::new(Means {
            player,
            ledger: Arc::clone(ledger),
            paced_by: options.paced_by,
            stall: options.stall,
            links: AtomicU64::new(1),
            patience: Mutex::new(options.stall),
            watching: AtomicBool::new(true),
        });
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
            lacked: AtomicBool::new(false),
        })
    }

    fn ledger(&self) -> &Ledger {
        &self.means.ledger
    }

    fn topics(&self) -> MutexGuard<'_, Vec<Arc<Topic>>> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn wanted(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.wanted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Subscribes to what is wanted and whose type is known by now.
    fn subscribe_to_wanted(
        &self,
        endpoints: &[Endpoint],
        nodes: &[GraphNode],
    ) -> Result<(), GraphError> {
        let wanted: Vec<String> = self.wanted().iter().cloned().collect();
        for topic in wanted {
            let publishing = nodes.iter().filter(|node| node.name != self.name);
            let types = publishing.flat_map(|node| node.publishes.iter());
            let Some((_, datatype)) = types.clone().find(|(name, _)| *name == topic) else {
                continue;
            };
            let all: Vec<&Endpoint> = published_on(&topic, endpoints).collect();
            let wanted = qos::recorded(all.iter().map(|one| &one.qos));
            let names: BTreeSet<&String> = all.iter().map(|one| &one.node).collect();
            let node = match names.into_iter().collect::<Vec<_>>()[..] {
                [only] => Some(only.clone()),
                _ => None,
            };
            let publisher = self.publisher(node, datatype, &all, &wanted);
            let subscription =
                self.means.player.listen(&topic, datatype, &wanted).map_err(failed)?;
            self.inputs.add(&topic, (subscription, wanted), publisher);
            self.wanted().remove(&topic);
        }
        Ok(())
    }

    /// How a recording introduces who publishes a topic.
    fn publisher(
        &self,
        node: Option<String>,
        datatype: &str,
        publishers: &[&Endpoint],
        recorded: &Qos,
    ) -> Publisher {
        let played = self.topics().iter().map(|topic| topic.info().clone()).collect::<Vec<_>>();
        let same = || played.iter().find(|info| info.datatype == datatype);
        let definition = installed(datatype, &self.prefixes)
            .or_else(|| Some(same()?.definition.to_string()))
            .unwrap_or_default();
        Publisher {
            node,
            datatype: datatype.to_owned(),
            md5sum: String::new(),
            read_stamp: stamp::reader(&definition),
            message_encoding: "cdr",
            schema_encoding: schema_encoding(&definition),
            definition,
            latching: recorded.durability == bagpipe_ros2player::Durability::TransientLocal,
            may_latch: false,
            offered_qos: Some(qos::yaml(publishers.iter().map(|one| &one.qos))),
        }
    }

    /// Takes in what was published on a recorded topic and handed on, by now.
    fn compare(&self, input: &Input, handed: u64, look: &Look) {
        let all = || published_on(&input.topic, &look.endpoints);
        let met = self.has_met(input, look);
        let now = all().map(|one| (one.id, one.counts.published));
        input.account().look(now, handed, met);
        for one in all().filter(|one| one.counts.published > 0) {
            if let Some(why) = qos::unrecordable(&one.qos, &input.qos) {
                input.unrecordable().insert(format!(
                    "{} publishes {} {why}, for which the recorder was there already: publish it \
                     with one quality of service",
                    one.node, input.topic
                ));
            }
        }
    }

    /// Takes in who publishes a recorded topic as another type, which reaches no recorder of this one.
    fn compare_types(&self, input: &Input, nodes: &[GraphNode], endpoints: &[Endpoint]) {
        let recorded = &input.publisher.datatype;
        for node in nodes.iter().filter(|node| node.name != self.name) {
            let mut types = node.publishes.iter().filter(|(topic, _)| *topic == input.topic);
            let Some((_, other)) = types.find(|(_, datatype)| datatype != recorded) else {
                continue;
            };
            let mut own = published_on(&input.topic, endpoints).filter(|one| one.node == node.name);
            if own.any(|one| one.counts.published > 0) {
                input.unrecordable().insert(format!(
                    "{} publishes {} as {other}, and it is recorded as {recorded}: a topic has one \
                     type",
                    node.name, input.topic
                ));
            }
        }
    }

    /// Fails where another case plays into the same domain.
    fn must_be_alone(&self, nodes: &[GraphNode]) {
        if let Some(other) = nodes.iter().find_map(|node| foreign_player(&node.name)) {
            self.inputs.fail(format!(
                "{other} of another case is in the same domain, so that each receives what the \
                 other plays: the stack sets ROS_DOMAIN_ID, which must be left to the agent"
            ));
        }
    }

    /// The ledger, which was read after the graph, and who is in both. A node that the ledger does not
    /// have is new in the graph, or does not count: it is known which after a while.
    fn look_after(&self, nodes: &[GraphNode]) -> Result<(Look, SystemState), GraphError> {
        let (mut looked, mut waited) = (Instant::now(), Duration::ZERO);
        loop {
            let look = Look::at(self.ledger()).map_err(failed)?;
            let state = state(&look.endpoints, nodes);
            let settled = |topic: &Arc<Topic>| {
                self.unlisted(topic, &state, &look).iter().all(|node| topic.is_uncounted(node))
            };
            if waited >= UNLISTED || self.topics().iter().all(settled) {
                return Ok((look, state));
            }
            std::thread::sleep(AGAIN);
            let now = Instant::now();
            waited += counted(now - looked);
            looked = now;
        }
    }

    /// The nodes that subscribe to a topic, and whose subscriptions the ledger does not have. By topic: a
    /// node may count in one of its processes, or with some of its endpoints.
    fn unlisted(&self, topic: &Topic, state: &SystemState, look: &Look) -> BTreeSet<String> {
        let name = &topic.info().topic;
        let counts =
            |node: &String| subscribed_to(name, &look.endpoints).any(|one| one.node == *node);
        let named = state.subscribers.get(name).into_iter().flatten();
        named.filter(|node| **node != self.name && !counts(node)).cloned().collect()
    }

    /// The nodes but ours that publish a topic.
    fn publishing<'s>(
        &self,
        state: &'s SystemState,
        topic: &str,
    ) -> impl Iterator<Item = &'s String> {
        let all = state.publishers.get(topic).into_iter().flatten();
        all.filter(|node| **node != self.name)
    }

    /// What nobody compared or could separate, as nodes publish that do not count.
    fn uncounted(&self) -> Vec<String> {
        let Ok(endpoints) = self.ledger().endpoints() else { return Vec::new() };
        let mut remarks = Vec::new();
        for input in self.inputs.all() {
            let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
            remarks.extend(uncounted(&input.topic, &others, &endpoints).into_iter().map(|node| {
                format!(
                    "{node} publishes {} in a process that does not count, so that whether all \
                     of it was recorded can't be known",
                    input.topic
                )
            }));
        }
        for topic in self.topics().iter() {
            remarks.extend(topic.uncounted(&endpoints).into_iter().map(|node| {
                format!(
                    "{node} publishes {} too, in a process that does not count, so that what its \
                     subscribers got of ours can't be known",
                    topic.info().topic
                )
            }));
        }
        let Unlisted { processes, endpoints } = self.ledger().unlisted();
        if processes + endpoints > 0 {
            remarks.push(format!(
                "the ledger had no room for {processes} processes and {endpoints} endpoints of the \
                 stack: nothing is proved of these"
            ));
        }
        remarks.sort();
        remarks
    }

    /// What a recording has of our own messages, which are none of the stack's, where the RMW hands
    /// them to us all the same: `more` than others have published.
    fn own(&self, input: &Input, more: u64) -> Option<String> {
        let played = self.topics().iter().any(|topic| topic.info().topic == input.topic);
        let others = input.others.lock().unwrap_or_else(PoisonError::into_inner);
        let endpoints = self.ledger().endpoints().ok()?;
        let known = uncounted(&input.topic, &others, &endpoints).is_empty();
        (played && known && more > 0).then(|| {
            format!(
                "{more} messages of {} were recorded that the stack has not published: it is \
                 played too, and this RMW does not separate them; do not play it, or remap it",
                input.topic
            )
        })
    }

    /// Takes in which of the stack's publishers of a recorded topic know us; whether all do, and we
    /// know as many as there are.
    fn has_met(&self, input: &Input, look: &Look) -> bool {
        let there: Vec<&Endpoint> = look.there(Kind::Publisher, &input.topic).collect();
        let subscribed = look.there(Kind::Subscription, &input.topic).count();
        let reported = there.iter().map(|one| (one.id, one.matched));
        input.acquaintance().look(Instant::now(), reported, subscribed);
        let all = || published_on(&input.topic, &look.endpoints).map(|one| one.id);
        // The player is asked no more once all have met.
        if !input.acquaintance().is_whole() || !input.account().has_strangers(all()) {
            return false;
        }
        let known = self.means.player.publishers(input.subscription);
        known.is_ok_and(|known| known >= there.len() as u64)
    }

    /// What each recorded topic must have handed on by now at least.
    fn due(&self) -> Result<Vec<(Arc<Input>, u64)>, GraphError> {
        let all: Vec<(Arc<Input>, u64)> = self
            .inputs
            .all()
            .into_iter()
            .map(|input| (Arc::clone(&input), input.arrivals.handed()))
            .collect();
        let endpoints = self.ledger().endpoints().map_err(failed)?;
        let due = all.into_iter().map(|(input, handed)| {
            let now = published_on(&input.topic, &endpoints);
            let now = now.map(|one| (one.id, one.counts.published));
            input.account().look(now, handed, false);
            let due = input.account().due();
            (input, due)
        });
        Ok(due.collect())
    }
}

/// The subscriptions of a topic that count, also those that are gone.
fn subscribed_to<'e>(
    topic: &'e str,
    endpoints: &'e [Endpoint],
) -> impl Iterator<Item = &'e Endpoint> {
    endpoints.iter().filter(move |one| one.kind == Kind::Subscription && one.topic == topic)
}

/// The publishers of a topic that count, also those that are gone.
fn published_on<'e>(
    topic: &'e str,
    endpoints: &'e [Endpoint],
) -> impl Iterator<Item = &'e Endpoint> {
    endpoints.iter().filter(move |one| one.kind == Kind::Publisher && one.topic == topic)
}

/// The name, if it is that of a player of another process that runs. One that was killed is in the
/// graph for a while, and plays no more.
fn foreign_player(name: &str) -> Option<&str> {
    let (process, _) = name.strip_prefix(PLAYER)?.split_once('_')?;
    let process: u32 = process.parse().ok()?;
    let runs = || Path::new("/proc").join(process.to_string()).exists();
    (process != std::process::id() && runs()).then_some(name)
}

impl Node for Graph {
    fn name(&self) -> &str {
        &self.name
    }

    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Publication>, GraphError> {
        let otherwise = otherwise_installed(&info, &self.prefixes);
        let wanted = self.qos.get(&info.topic).copied().unwrap_or_default();
        let mut played = qos::played(&info, wanted);
        if info.topic == "/clock" && wanted.reliability.is_none() {
            played.reliability = Reliability::Reliable;
        }
        let publisher = self.means.player.advertise(&info.topic, &info.datatype, &played);
        let (means, publisher) = (Arc::clone(&self.means), publisher.map_err(failed)?);
        let topic = Arc::new(Topic::new(means, info, publisher, played, otherwise));
        self.topics().push(Arc::clone(&topic));
        Ok(topic)
    }

    fn subscribe(&self, topic: &str) -> Result<(), GraphError> {
        if self.inputs.of(topic).is_none() {
            self.wanted().insert(topic.to_owned());
        }
        Ok(())
    }

    fn look(&self) -> Result<Seen, GraphError> {
        if let Some(why) = self.inputs.failure() {
            return Err(failed(why));
        }
        let nodes = self.means.player.graph().map_err(failed)?;
        self.must_be_alone(&nodes);
        self.inputs.lives.ask(&self.means.player)?;
        // Before what was published is read, so that what comes meanwhile is missing for a moment.
        let inputs = self.inputs.all();
        let handed: Vec<u64> = inputs.iter().map(|input| input.arrivals.handed()).collect();
        let (look, state) = self.look_after(&nodes)?;
        let namesakes = namesakes(&look.endpoints, &nodes);
        for topic in self.topics().iter() {
            let name = &topic.info().topic;
            let mut uncounted = self.unlisted(topic, &state, &look);
            uncounted.extend(topic.hidden(&look, &namesakes, uncounted.len()));
            let uncounted: Vec<String> = uncounted.into_iter().collect();
            topic.refresh(&look, Some(&uncounted)).map_err(failed)?;
            topic.note_publishers(self.publishing(&state, name));
        }
        self.subscribe_to_wanted(&look.endpoints, &nodes)?;
        for (input, handed) in inputs.iter().zip(handed) {
            let others = self.publishing(&state, &input.topic).cloned();
            input.others.lock().unwrap_or_else(PoisonError::into_inner).extend(others);
            self.compare(input, handed, &look);
            self.compare_types(input, &nodes, &look.endpoints);
        }
        Ok(Seen { state, again: 0 })
    }

    fn absent(&self) -> Vec<String> {
        self.inputs.lives.absent()
    }

    fn begin(&self) -> Vec<String> {
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
        let missing = || due.iter().map(|(input, due)| input.arrivals.missing(*due)).sum();
        let exact = self.means.paced_by == PacedBy::Subscribers;
        let first = exact && !self.lacked.load(Ordering::Relaxed);
        let limit = if first { limit.max(ON_ITS_WAY) } else { limit };
        // What did not come then is lacking: nothing after it is waited for as long, nor it again.
        if !self.inputs.await_arrivals(limit, self.means.stall, missing) {
            self.lacked.store(true, Ordering::Relaxed);
            due.iter().for_each(|(input, due)| input.arrivals.give_up(*due));
        }
    }

    fn counts_publishes(&self) -> bool {
        true
    }

    fn lacking(&self) -> Vec<String> {
        let due = match self.due() {
            Ok(due) => due,
            Err(error) => {
                return vec![format!("what was published can't be known: {}", error.source)];
            }
        };
        // What goes out at this moment is on its way.
        let missing =
            || due.iter().map(|(input, due)| due.saturating_sub(input.arrivals.handed())).sum();
        self.inputs.await_arrivals(ON_ITS_WAY, self.means.stall, missing);
        // Once more for a play that was shorter than who comes needs to be seen.
        if let Ok(nodes) = self.means.player.graph() {
            self.must_be_alone(&nodes);
            if let Ok(endpoints) = self.ledger().endpoints() {
                due.iter().for_each(|(input, _)| self.compare_types(input, &nodes, &endpoints));
            }
        }
        let mut lacking = Vec::new();
        lacking.extend(self.inputs.failure());
        // Who came behind the last message has got those that are kept.
        lacking.extend(self.topics().iter().filter_map(|topic| topic.misread().map(str::to_owned)));
        for (input, due) in &due {
            lacking.extend(input.unrecordable().iter().cloned());
            let (handed, published) = (input.arrivals.handed(), input.account().published());
            lacking.extend(self.own(input, handed.saturating_sub(published)));
            let missing = due.saturating_sub(handed);
            if missing > 0 {
                lacking.push(format!(
                    "{missing} messages of {} did not reach the recorder, which has {handed} of \
                     {published} published",
                    input.topic
                ));
            }
        }
        lacking.sort();
        lacking
    }

    fn remarks(&self) -> Vec<String> {
        [self.stillness.remarks(), self.uncounted()].concat()
    }

    fn audit(&self, _: Duration) -> Box<dyn Audit> {
        let topics = self.topics().clone();
        Box::new(Reader { ledger: Arc::clone(&self.means.ledger), topics })
    }
}
