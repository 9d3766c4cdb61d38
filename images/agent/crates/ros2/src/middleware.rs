//! ROS 2 behind the seam of `bagpipe-graph`.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fmt::{self, Debug};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bagpipe_graph::{GraphError, Middleware, NodeOptions, ReadStamp, Sink, TopicInfo};
use bagpipe_ros2ledger::Ledger;
use bagpipe_ros2player::{Player, PlayerOptions};

use crate::node::{Graph, failed};
use crate::{QosOverride, clock, stamp};

/// Room for messages on their way to the player's program, and for those on their way from it, in
/// bytes each; a message may have half of it. Memory is taken as it is used.
const ROOM: u64 = 64 << 20;

/// How a graph is joined.
#[derive(Clone)]
pub struct Ros2Options {
    /// What the stack's nodes count in: they were started with its environment, while it watched
    /// matches ([`Ledger::watch_matches`]).
    pub ledger: Arc<Ledger>,
    /// A file with [`bagpipe_ros2player::PROGRAM`].
    pub program: PathBuf,
    /// The player's variables beside those of this process, such as the domain's number.
    pub environment: Vec<(OsString, OsString)>,
    /// Quality of service by topic, in place of what was recorded.
    pub qos: BTreeMap<String, QosOverride>,
    /// Where packages are installed, for the definitions of recorded types (AMENT_PREFIX_PATH).
    pub prefixes: Vec<PathBuf>,
    /// Until when the player must be there, and each answer of it.
    pub deadline: Duration,
}

/// The graph of one domain, on this machine, with our player in it.
pub struct Ros2 {
    name: String,
    pid: u32,
    /// Taken by the one who joins.
    player: Mutex<Option<Player>>,
    options: Ros2Options,
}

impl Ros2 {
    /// Starts the player; its node is there when this returns.
    ///
    /// # Errors
    /// There is no ROS 2 in the environment, or it makes no node.
    pub fn start(options: Ros2Options) -> Result<Ros2, GraphError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let node = format!("bagpipe_player_{}_{number}", std::process::id());
        let player = Player::start(&PlayerOptions {
            program: options.program.clone(),
            environment: options.environment.clone(),
            // What the player takes and publishes is ours, and none of the stack's.
            removed: vec!["LD_PRELOAD".into(), "BAGPIPE_LEDGER".into()],
            node: node.clone(),
            namespace: "/".to_owned(),
            room: ROOM,
            deadline: options.deadline,
        })
        .map_err(failed)?;
        let (name, pid) = (format!("/{node}"), player.pid());
        Ok(Ros2 { name, pid, player: Mutex::new(Some(player)), options })
    }

    /// The process of the player.
    pub fn pid(&self) -> u32 {
        self.pid
    }
}

impl Debug for Ros2 {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Ros2Options { qos, prefixes, .. } = &self.options;
        let mut shown = formatter.debug_struct("Ros2");
        shown.field("name", &self.name).field("qos", qos).field("prefixes", prefixes);
        shown.finish_non_exhaustive()
    }
}

impl Middleware for Ros2 {
    /// The name in `options` is not used: the player has one. It can be joined once.
    fn join(
        &self,
        options: NodeOptions,
        sink: Box<dyn Sink>,
    ) -> Result<Box<dyn bagpipe_graph::Node>, GraphError> {
        let player = self.player.lock().unwrap_or_else(PoisonError::into_inner).take();
        let player = player.ok_or_else(|| failed("its player is in another replay"))?;
        Ok(Box::new(Graph::join(&self.name, player, &self.options, &options, sink)?))
    }

    fn encoding(&self) -> &'static str {
        "cdr"
    }

    fn read_stamp(&self, definition: &str) -> Option<ReadStamp> {
        stamp::reader(definition)
    }

    fn clock_topic(&self) -> TopicInfo {
        clock::clock_topic()
    }

    fn clock_frame(&self, nanoseconds: u64) -> Vec<u8> {
        clock::clock_frame(nanoseconds)
    }
}
