//! ROS 2 behind the seam of `bagpipe-graph`.

use std::ffi::OsString;
use std::fmt::{self, Debug};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};

use bagpipe_graph::{GraphError, Middleware, NodeOptions, ReadStamp, Sink, TopicInfo};
use bagpipe_ros2player::{Player, PlayerError, PlayerOptions};

use crate::error::failed;
use crate::node::Graph;
use crate::topic::PLAYER;
use crate::{Ros2Options, clock, stamp};

/// Room for messages on their way to the player's program, and for those on their way from it, in
/// bytes each; a message may have half of it. Memory is taken as it is used.
const ROOM: u64 = 64 << 20;

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
    pub fn start(options: Ros2Options) -> Result<Ros2, PlayerError> {
        static NEXT: AtomicU64 = AtomicU64::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("{PLAYER}{}_{number}", std::process::id());
        let node = name.trim_start_matches('/').to_owned();
        let player = Player::start(&PlayerOptions {
            program: options.program.clone(),
            environment: options.environment.clone(),
            removed: removed(&options.environment),
            node,
            namespace: "/".to_owned(),
            room: ROOM,
            deadline: options.deadline,
        })?;
        let pid = player.pid();
        Ok(Ros2 { name, pid, player: Mutex::new(Some(player)), options })
    }

    /// Whether somebody else publishes or subscribes to something; not once it was joined.
    ///
    /// # Errors
    /// The player does not say, or not within the deadline.
    pub fn sees_others(&self) -> Result<bool, PlayerError> {
        let player = self.player.lock().unwrap_or_else(PoisonError::into_inner);
        let nodes = player.as_ref().map_or(Ok(Vec::new()), Player::graph)?;
        let others = nodes.iter().filter(|node| node.name != self.name);
        Ok(others
            .into_iter()
            .any(|node| !(node.publishes.is_empty() && node.subscribes.is_empty())))
    }

    /// The process of the player.
    pub fn pid(&self) -> u32 {
        self.pid
    }
}

/// What a player does not get of this process' own variables. What it takes and publishes is ours, and none of
/// the stack's.
fn removed(environment: &[(OsString, OsString)]) -> Vec<OsString> {
    let preloads = environment.iter().any(|(name, _)| name == "LD_PRELOAD");
    let preload = (!preloads).then(|| OsString::from("LD_PRELOAD"));
    preload.into_iter().chain(["BAGPIPE_LEDGER".into()]).collect()
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

    fn schema_encoding(&self) -> &'static str {
        "ros2msg"
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
