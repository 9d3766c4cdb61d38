//! A middleware in memory behind the seam: the player needs no change for it, and its plays are
//! proved as any other's.
#![allow(clippy::unwrap_used)] // clippy does not see that these helpers are tests
#[path = "scene/bags.rs"]
mod bags;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use bagpipe_graph::{
    Audit, Cancelled, FarEnd, GraphError, Incoming, LinkState, Middleware, Node, NodeOptions,
    Outlet, Publication, Publisher, ReadStamp, Received, Seen, SendError, Share, Sink, SystemState,
    TopicInfo,
};
use bagpipe_replay::{
    AnswerBy, CLOCK_RATE, Mode, ReplayError, ReplayRequest, Replayed, StartWhen, Step, Strength,
    Window, replay,
};
use bagpipe_rosbag::{Bag, MemoryChunkedFile};

const MS: u64 = 1_000_000;
const STACK: &str = "/relay";

/// A graph with one other node, which answers each message of /a on /answer unless it is deaf.
#[derive(Debug, Default)]
struct Loopback {
    deaf: bool,
    gone: bool,
}

struct Member {
    topics: Mutex<Vec<Arc<Relayed>>>,
    sink: Arc<Mutex<Box<dyn Sink>>>,
    deaf: bool,
    gone: bool,
}

struct Relayed {
    info: TopicInfo,
    sink: Arc<Mutex<Box<dyn Sink>>>,
    link: Mutex<LinkState>,
    deaf: bool,
}

impl Middleware for Loopback {
    fn join(&self, _: NodeOptions, sink: Box<dyn Sink>) -> Result<Box<dyn Node>, GraphError> {
        let sink = Arc::new(Mutex::new(sink));
        let &Loopback { deaf, gone } = self;
        Ok(Box::new(Member { topics: Mutex::default(), sink, deaf, gone }))
    }

    fn encoding(&self) -> &'static str {
        "ros1"
    }

    fn schema_encoding(&self) -> &'static str {
        "ros1msg"
    }

    fn read_stamp(&self, _: &str) -> Option<ReadStamp> {
        None
    }

    fn clock_topic(&self) -> TopicInfo {
        TopicInfo { topic: "/clock".to_owned(), ..TopicInfo::default() }
    }

    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8> {
        [&8u32.to_le_bytes()[..], &nanoseconds.to_le_bytes()].concat()
    }
}

impl Node for Member {
    fn name(&self) -> &str {
        "/player"
    }

    fn advertise(&self, info: TopicInfo) -> Result<Arc<dyn Publication>, GraphError> {
        let node = STACK.to_owned();
        let (instance, lead_in, counted, counted_bytes) = (0, 0, 0, 0);
        let link = LinkState {
            id: 1,
            node,
            instance,
            lead_in,
            counted,
            counted_bytes,
            open: true,
            ..LinkState::default()
        };
        let sink = Arc::clone(&self.sink);
        let topic = Relayed { info, sink, link: Mutex::new(link), deaf: self.deaf };
        let topic = Arc::new(topic);
        self.topics.lock().unwrap().push(Arc::clone(&topic));
        Ok(topic)
    }

    fn subscribe(&self, _: &str) -> Result<(), GraphError> {
        let (reason, what) = ("DomainFailed", "the domain failed");
        let failed = GraphError { reason, what, source: "nobody is there".into() };
        if self.gone { Err(failed) } else { Ok(()) }
    }

    fn look(&self) -> Result<Seen, GraphError> {
        let nodes = |name: &str| vec![name.to_owned()];
        let state = SystemState {
            publishers: BTreeMap::from([("/answer".to_owned(), nodes(STACK))]),
            subscribers: BTreeMap::from([("/a".to_owned(), nodes(STACK))]),
        };
        Ok(Seen { state, again: 0 })
    }

    fn restarted(&self, again: u64) -> String {
        format!("the domain lost {again}")
    }

    fn subscribed_topics(&self) -> Vec<String> {
        vec!["/answer".to_owned()]
    }

    fn publishers_of(&self, _: &str) -> usize {
        1
    }

    fn sweep(&self, _: Duration) {}

    fn audit(&self, _: Duration) -> Box<dyn Audit> {
        Box::new(Counts(self.topics.lock().unwrap().clone(), self.deaf))
    }
}

impl Outlet for Relayed {
    fn topic(&self) -> &str {
        &self.info.topic
    }

    fn latch(&self, _: &str, _: Share, _: &[u8]) {}

    fn send(&self, share: Share, frames: &[&[u8]], _: Cancelled<'_>) -> Result<(), SendError> {
        let publisher = Publisher {
            node: Some(STACK.to_owned()),
            datatype: "std_msgs/String".to_owned(),
            md5sum: "992ce8a1687cec8c8bd883ec73ca41d1".to_owned(),
            definition: "string data\n".into(),
            ..Publisher::default()
        };
        for frame in frames {
            let mut link = self.link.lock().unwrap();
            match share {
                Share::LeadIn => link.lead_in += 1,
                Share::Counted => link.counted += 1,
            }
            if self.info.topic == "/a" && !self.deaf {
                let publisher = &publisher;
                let answer = Incoming { topic: "/answer", publisher, link: 9, data: &frame[4..] };
                self.sink.lock().unwrap().message(answer);
            }
        }
        Ok(())
    }

    fn await_unread(&self, _: u64, _: Cancelled<'_>) -> Result<(), SendError> {
        Ok(())
    }
}

impl Publication for Relayed {
    fn info(&self) -> &TopicInfo {
        &self.info
    }

    fn subscribers(&self) -> Vec<LinkState> {
        vec![self.link.lock().unwrap().clone()]
    }

    fn unsent(&self) -> u64 {
        0
    }

    fn far_ends(&self) -> Vec<FarEnd> {
        Vec::new()
    }

    fn refused(&self) -> Vec<String> {
        Vec::new()
    }
}

/// What the relay reports: each message that was sent to it, unless it is deaf.
struct Counts(Vec<Arc<Relayed>>, bool);

impl Audit for Counts {
    fn ask(
        &mut self,
        _: &str,
        _: &BTreeMap<String, Vec<u64>>,
    ) -> Result<BTreeMap<(String, u64), Received>, GraphError> {
        let of = |topic: &Arc<Relayed>| {
            let link = topic.link.lock().unwrap();
            let messages = if self.1 { 0 } else { link.lead_in + link.counted };
            ((topic.info.topic.clone(), link.id), Received { messages, drops: Some(0) })
        };
        Ok(self.0.iter().map(of).collect())
    }

    fn pid(&mut self, _: &str) -> Result<i32, GraphError> {
        Err(GraphError { reason: "DomainFailed", what: "no process", source: "none".into() })
    }

    fn subscribers(&mut self, _: &str) -> Result<BTreeSet<(String, String)>, GraphError> {
        Ok(BTreeSet::new())
    }
}

fn played(middleware: Loopback, mode: Mode) -> Result<Replayed, ReplayError> {
    let step = Step {
        trigger: "/a".to_owned(),
        answer: "/answer".to_owned(),
        deadline: Duration::from_secs(20),
        by: AnswerBy::Count,
        optional: false,
    };
    let spoken = [(0, 1, "one"), (0, 5, "two"), (0, 20, "three")];
    let bag = bags::bag_of_words(&[bags::words("/a", "/car", false)], &spoken);
    let (first, last) = bag.time_range().unwrap();
    let request = ReplayRequest {
        middleware: Arc::new(middleware),
        window: Window { lead_in_start: first, start: first, end: last + 1 },
        topics: vec!["/a".to_owned()],
        late: BTreeMap::new(),
        remap: BTreeMap::new(),
        mode,
        steps: if mode == Mode::Lockstep { vec![step] } else { Vec::new() },
        rate: 1.0,
        record_topics: vec!["/answer".to_owned()],
        record_as: Arc::new(bags::in_lz4()),
        byte_budget: 1 << 20,
        record_to: None,
        subscribe_deadline: Duration::from_secs(20),
        drain_deadline: Duration::from_millis(500),
        case_deadline: Instant::now() + Duration::from_secs(60),
        use_sim_time: true,
        clock_rate: CLOCK_RATE,
        start: StartWhen::default(),
        pause: None,
        meter: Arc::default(),
    };
    replay(&bag, &request, &mut |_| {}, &|| None)
}

/// The recorded answers: milliseconds of bag time, text.
fn answers(replayed: &Replayed) -> Vec<(u64, String)> {
    let bag = Bag::open(MemoryChunkedFile::new(replayed.recorded_bag.clone())).unwrap();
    let answer = |m: bagpipe_rosbag::Message<'_>| {
        (m.time / MS, String::from_utf8_lossy(&m.data[4..]).into_owned())
    };
    bag.timeline(|_| true).unwrap().iter().map(answer).collect()
}

#[test]
fn a_middleware_in_memory_is_played_recorded_and_proved_in_every_mode() {
    for (mode, strength) in [
        (Mode::Realtime, Strength::Received),
        (Mode::Max, Strength::Received),
        (Mode::Lockstep, Strength::Called),
    ] {
        let replayed = played(Loopback::default(), mode).unwrap();
        let ledger = &replayed.ledger;
        assert_eq!((ledger.sent, ledger.received, ledger.dropped), (3, 3, 0), "{mode:?}");
        assert_eq!(ledger.strength, Some(strength), "{mode:?}");
        let answers = answers(&replayed);
        let texts: Vec<&str> = answers.iter().map(|(_, text)| text.as_str()).collect();
        assert_eq!(texts, ["one", "two", "three"], "{mode:?}");
        if mode == Mode::Lockstep {
            let times: Vec<u64> = answers.iter().map(|(time, _)| *time).collect();
            assert_eq!(times, [1, 5, 20]);
        }
    }
}

#[test]
fn what_its_nodes_did_not_receive_is_lost_in_the_ledger() {
    let ledger = played(Loopback { deaf: true, ..Loopback::default() }, Mode::Max).unwrap().ledger;
    assert_eq!((ledger.sent, ledger.received, ledger.dropped), (3, 0, 3));
}

#[test]
fn a_graph_that_fails_is_an_error_with_its_own_reason_and_words() {
    let gone = Loopback { gone: true, ..Loopback::default() };
    let error = played(gone, Mode::Max).err().unwrap();
    assert_eq!(error.reason(), "DomainFailed");
    assert_eq!(error.to_string(), "the domain failed: nobody is there");
}
