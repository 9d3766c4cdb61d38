//! Recordings in memory, played to nodes of the stand-in over Cyclone DDS.
#![allow(dead_code, clippy::unwrap_used)] // Each of those who use it needs a part.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use bagpipe_graph::{Incoming, Middleware as _, Node as OurNode, NodeOptions, PacedBy, Sink};
use bagpipe_log::{Connection, MessageEncoding, RecordingWriter, SchemaEncoding};
use bagpipe_mcap::{Mcap, McapWriter, WriterOptions};
use bagpipe_replay::{
    AnswerBy, CLOCK_RATE, Mode, Progress, ReplayError, ReplayRequest, Replayed, StartWhen, Step,
    Window, replay,
};
use bagpipe_ros2::{Ros2, Ros2Options};
use bagpipe_ros2ledger::{Endpoint, Kind, Ledger};
use bagpipe_ros2player::PlayerOptions;

use crate::standin::{Graph, LONG, Node, eventually, hash};

pub const MS: u64 = 1_000_000;
/// A node that answers what it gets.
pub const RELAY: [&str; 8] = [
    "--name",
    "/relay",
    "--sub",
    "/in:sensor_msgs/msg/Imu:10:reliable",
    "--pub",
    // Deep enough for all answers: the recorder is in nobody's way, and a busy machine may keep it
    // from its socket until that is full.
    "/out:std_msgs/msg/String:5000:reliable",
    "--relay",
    "/in=/out",
];
const QOS: &str =
    "- history: keep_last\n  depth: 10\n  reliability: reliable\n  durability: volatile\n";

/// A recorded topic whose messages begin with a header.
pub fn imu(topic: &str) -> Connection {
    Connection {
        topic: topic.to_owned(),
        datatype: "sensor_msgs/msg/Imu".to_owned(),
        definition: "std_msgs/Header header\n".into(),
        message_encoding: MessageEncoding::Cdr,
        schema_encoding: SchemaEncoding::Ros2Msg,
        offered_qos: Some(QOS.to_owned()),
        ..Connection::default()
    }
}

/// A message in CDR: a header of this time, and so many bytes that its number decides.
pub fn stamped(time: u64, number: u64, length: usize) -> Vec<u8> {
    let (seconds, rest) = ((time / 1_000_000_000) as u32, (time % 1_000_000_000) as u32);
    let mut bytes =
        [[0, 1, 0, 0], seconds.to_le_bytes(), rest.to_le_bytes(), [1, 0, 0, 0]].concat();
    bytes.extend([0; 4]);
    bytes.extend(number.to_le_bytes());
    bytes.resize(28.max(length), number as u8);
    bytes
}

/// Messages on each of these topics, a millisecond after the other, round and round.
pub fn recording(topics: &[&str], messages: u64, length: usize) -> Mcap {
    let all: Vec<Connection> = topics.iter().map(|topic| imu(topic)).collect();
    recorded_as(&all, messages, length)
}

/// The same of one channel.
pub fn recording_of(channel: &Connection, messages: u64, length: usize) -> Mcap {
    recorded_as(std::slice::from_ref(channel), messages, length)
}

fn recorded_as(channels: &[Connection], messages: u64, length: usize) -> Mcap {
    let mut writer = McapWriter::new(WriterOptions::default());
    let ids: Vec<u32> = channels
        .iter()
        .map(|channel| RecordingWriter::add_connection(&mut writer, channel))
        .collect();
    for number in 0..messages {
        let (time, id) = ((1000 + number) * MS, ids[number as usize % ids.len()]);
        RecordingWriter::write(&mut writer, id, time, &stamped(time, number, length)).unwrap();
    }
    Mcap::open(RecordingWriter::finish(Box::new(writer)).unwrap()).unwrap()
}

/// A prefix where a package with a message is installed that begins with a header; gone with its
/// scene.
struct Prefix(PathBuf);

impl Prefix {
    fn new() -> Prefix {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("ros2-prefix-{}-{number}", std::process::id());
        let prefix = std::env::temp_dir().join(name);
        for (package, name, text) in [
            ("geometry_msgs", "PoseStamped", "std_msgs/Header header\nfloat64[7] pose\n"),
            ("std_msgs", "Header", "builtin_interfaces/Time stamp\nstring frame_id\n"),
            ("std_msgs", "String", "string data\n"),
            ("builtin_interfaces", "Time", "int32 sec\nuint32 nanosec\n"),
        ] {
            let folder = prefix.join("share").join(package).join("msg");
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(name).with_extension("msg"), text).unwrap();
        }
        Prefix(prefix)
    }
}

impl Drop for Prefix {
    fn drop(&mut self) {
        std::fs::remove_dir_all(&self.0).unwrap();
    }
}

/// A stack that starts, and what it is played into.
pub struct Scene {
    pub graph: Graph,
    pub ledger: Arc<Ledger>,
    /// Whether what its nodes publish waits for room in sockets.
    pub flow_control: bool,
    /// Whose player is started: with librcl that of `graph`.
    player: PlayerOptions,
    prefix: Prefix,
}

impl Scene {
    pub fn new() -> Scene {
        let ledger = Arc::new(Ledger::new().unwrap());
        ledger.watch_matches(true);
        let graph = Graph::new();
        let player = graph.options();
        Scene { graph, ledger, flow_control: true, player, prefix: Prefix::new() }
    }

    /// One whose player knows no librcl.
    pub fn on_dds() -> Scene {
        let scene = Scene::new();
        let player = scene.graph.with_player_on_dds().options();
        Scene { player, ..scene }
    }

    /// A node that counts in the scene's ledger.
    pub fn start(&self, program: &str, arguments: &[&str]) -> Node {
        self.graph.start_counting(program, arguments, &self.ledger)
    }

    /// A node that knows of no ledger.
    pub fn start_uncounted(&self, program: &str, arguments: &[&str]) -> Node {
        self.graph.start_uncounted(program, arguments)
    }

    /// Waits until so many subscriptions count.
    pub fn await_subscriptions(&self, many: usize) {
        let all = || self.ledger.endpoints().unwrap();
        eventually(|| all().iter().filter(|one| one.kind == Kind::Subscription).count() == many);
    }

    /// Waits until so many messages were published on a topic.
    pub fn await_published(&self, topic: &str, many: u64) {
        self.await_counted(topic, many, |one| one.counts.published);
    }

    /// Until so many calls have begun that publish.
    pub fn await_offered(&self, topic: &str, many: u64) {
        self.await_counted(topic, many, |one| one.counts.offered);
    }

    fn await_counted(&self, topic: &str, many: u64, count: fn(&Endpoint) -> u64) {
        let publishes = |one: &&Endpoint| one.kind == Kind::Publisher && one.topic == topic;
        eventually(|| {
            let all = self.ledger.endpoints().unwrap();
            all.iter().filter(publishes).map(count).sum::<u64>() >= many
        });
    }

    /// Where a file of this scene may be, which is gone with it.
    pub fn file(&self, name: &str) -> PathBuf {
        self.prefix.0.join(name)
    }

    pub fn middleware(&self) -> Ros2 {
        self.middleware_of(&[])
    }

    /// One that is to wait until these nodes are active.
    fn middleware_of(&self, active: &[&str]) -> Ros2 {
        Ros2::start(Ros2Options {
            ledger: Arc::clone(&self.ledger),
            program: self.player.program.clone(),
            environment: self.player.environment.clone(),
            qos: BTreeMap::new(),
            active: names(active),
            flow_control: self.flow_control,
            prefixes: vec![self.prefix.0.clone()],
            deadline: LONG,
        })
        .unwrap()
    }

    pub fn play(&self, mcap: &Mcap, ask: &Ask<'_>) -> Result<Replayed, ReplayError> {
        self.play_while(mcap, ask, &mut |_| {})
    }

    /// `seen` is called now and then while it plays.
    pub fn play_while(
        &self,
        mcap: &Mcap,
        ask: &Ask<'_>,
        seen: &mut dyn FnMut(Progress),
    ) -> Result<Replayed, ReplayError> {
        let (first, last) = mcap.time_range().unwrap();
        let step = |(trigger, answer): &(&str, &str)| Step {
            trigger: (*trigger).to_owned(),
            answer: (*answer).to_owned(),
            deadline: LONG,
            by: ask.by,
            optional: false,
        };
        let request = ReplayRequest {
            middleware: Arc::new(self.middleware_of(ask.active)),
            window: Window { lead_in_start: first, start: first + ask.lead_in, end: last + 1 },
            topics: names(ask.topics),
            late: BTreeMap::new(),
            remap: BTreeMap::new(),
            mode: ask.mode,
            steps: ask.steps.iter().map(step).collect(),
            rate: ask.rate,
            record_topics: names(ask.record),
            record_as: Arc::new(WriterOptions::default()),
            byte_budget: 1 << 30,
            record_to: None,
            subscribe_deadline: ask.deadline,
            drain_deadline: ask.drain,
            case_deadline: Instant::now() + 4 * LONG,
            use_sim_time: ask.use_sim_time,
            clock_rate: CLOCK_RATE,
            // In place of the rest of all processes, of which other tests have some: a writer may
            // know of its reader a moment later than that of it.
            start: StartWhen {
                nodes: names(ask.wait_for),
                at_rest_below: ask.at_rest.then(std::process::id),
                stable: ask.stable,
                delay: Duration::from_millis(if ask.at_rest { 0 } else { 200 }),
                ..StartWhen::default()
            },
            pause: None,
            meter: Arc::default(),
        };
        replay(mcap, &request, seen, &|| None)
    }
}

fn names(all: &[&str]) -> Vec<String> {
    all.iter().map(|&one| one.to_owned()).collect()
}

/// Counts what it is handed.
struct Counting(Arc<AtomicU64>);

impl Sink for Counting {
    fn message(&mut self, _: Incoming<'_>) {
        self.0.fetch_add(1, Ordering::SeqCst);
    }

    fn too_large(&mut self, topic: &str, bytes: u64) {
        panic!("{bytes} bytes on {topic}");
    }
}

/// A node of ours that counts what it receives.
pub fn joined(middleware: &Ros2, handed: Arc<AtomicU64>) -> Box<dyn OurNode> {
    let options = NodeOptions {
        name: "/unused".to_owned(),
        call_deadline: LONG,
        stall: LONG,
        max_message: 1 << 20,
        paced_by: PacedBy::Schedule,
    };
    middleware.join(options, Box::new(Counting(handed))).unwrap()
}

/// How something is played.
#[derive(Clone, Copy)]
pub struct Ask<'a> {
    pub mode: Mode,
    pub rate: f64,
    pub lead_in: u64,
    pub steps: &'a [(&'a str, &'a str)],
    pub by: AnswerBy,
    pub record: &'a [&'a str],
    pub use_sim_time: bool,
    /// Nodes that have to be active.
    pub active: &'a [&'a str],
    /// Nodes that have to subscribe to what is played, as the player has it.
    pub wait_for: &'a [&'a str],
    /// Topics that each need a subscriber; with none of them any will do, once no more come.
    pub topics: &'a [&'a str],
    /// Whether it waits for the rest of this process' children in place of a moment.
    pub at_rest: bool,
    /// How long no subscriber may have come, if nothing shows before that none is to come.
    pub stable: Duration,
    /// How long to wait for the subscribers.
    pub deadline: Duration,
    /// How long the last answers may take.
    pub drain: Duration,
}

pub const DEFAULT: Ask<'static> = Ask {
    mode: Mode::Max,
    rate: 1.0,
    lead_in: 0,
    steps: &[],
    by: AnswerBy::Count,
    record: &["/out.*"],
    use_sim_time: false,
    active: &[],
    wait_for: &[],
    topics: &[],
    at_rest: false,
    stable: Duration::from_millis(500),
    deadline: LONG,
    drain: Duration::from_secs(10),
};

impl Default for Ask<'_> {
    fn default() -> Self {
        DEFAULT
    }
}

/// Topic, time and bytes of each recorded message.
pub fn recorded(replayed: &Replayed) -> Vec<(String, u64, Vec<u8>)> {
    let mcap = Mcap::open(replayed.recorded_bag.clone()).unwrap();
    let topics: BTreeMap<u32, String> =
        mcap.connections().iter().map(|one| (one.id, one.topic.clone())).collect();
    let timeline = bagpipe_log::Recording::timeline(&mcap, &|_| true).unwrap();
    let all = (0..timeline.len()).filter_map(|at| timeline.get(at));
    all.map(|one| (topics[&one.connection].clone(), one.time, one.data.to_vec())).collect()
}

/// The number of the message that each answer is to, in the order of their coming, of so many messages of
/// so many bytes.
pub fn answered_numbers(replayed: &Replayed, messages: u64, length: usize) -> Vec<u64> {
    let hashed = |number| {
        let mut bytes = stamped((1000 + number) * MS, number, length);
        // As DDS hands them on.
        bytes.resize(length.next_multiple_of(4), 0);
        format!("{:016x}", hash(&bytes))
    };
    let numbers: BTreeMap<String, u64> =
        (0..messages).map(|number| (hashed(number), number)).collect();
    let number = |answer: &[u8]| numbers[str::from_utf8(&answer[8..24]).unwrap()];
    recorded(replayed).iter().map(|(_, _, answer)| number(answer)).collect()
}

/// That each message of the window has its answer in the recording. The one to the last message before may be
/// published when the window has begun.
pub fn assert_window_answered(replayed: &Replayed, window: Range<u64>, length: usize) {
    let numbers = answered_numbers(replayed, window.end, length);
    let last_before = usize::from(numbers.first().is_some_and(|one| one + 1 == window.start));
    assert!(numbers[last_before..].iter().copied().eq(window), "{numbers:?}");
}
