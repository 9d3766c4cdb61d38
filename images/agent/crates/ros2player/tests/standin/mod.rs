//! The stand-in of ROS 2 over Debian's Cyclone DDS (`tests/ros2`), built by its Makefile, with nodes
//! and players in graphs of their own.
#![allow(dead_code, clippy::unwrap_used)] // Each of those who use it needs a part.

use std::ffi::OsString;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixListener};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{Endpoint, Kind, LIBRARY, Ledger};
use bagpipe_ros2player::{
    DDS_PROGRAM, Durability, History, PROGRAM, Player, PlayerError, PlayerOptions, Presence,
    PublisherId, Qos, Reliability, SubscriptionId,
};

/// What no test should need, however slow the machine is.
pub const LONG: Duration = Duration::from_secs(120);

pub const RELIABLE: Qos = Qos {
    history: History::KeepLast(10),
    reliability: Reliability::Reliable,
    durability: Durability::Volatile,
    presence: Presence::NONE,
};
pub const ALL: Qos = Qos { history: History::KeepAll, ..RELIABLE };

/// The encapsulation of little-endian CDR, with which each message begins.
pub const CDR: [u8; 4] = [0, 1, 0, 0];

fn sources() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../../tests/ros2")
}

/// Of everything that is built.
fn digest() -> u64 {
    let mut hasher = DefaultHasher::new();
    let mut files: Vec<_> =
        std::fs::read_dir(sources()).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for file in files.into_iter().filter(|file| file.is_file()) {
        std::fs::read(file).unwrap().hash(&mut hasher);
    }
    (LIBRARY, PROGRAM, DDS_PROGRAM).hash(&mut hasher);
    hasher.finish()
}

/// Where the stand-in is, with the ledger's library and the player's program: built when a source
/// differs, in a folder that appears as a whole.
pub fn built() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let parent = option_env!("CARGO_TARGET_TMPDIR").map_or_else(std::env::temp_dir, Into::into);
        let folder = parent.join(format!("ros2-{:016x}", digest()));
        if !folder.exists() {
            let unfinished = parent.join(format!("ros2-{}", std::process::id()));
            build(&unfinished);
            // Another process may have been faster.
            if std::fs::rename(&unfinished, &folder).is_err() {
                std::fs::remove_dir_all(&unfinished).unwrap();
            }
        }
        folder
    })
}

fn build(folder: &Path) {
    let made = Command::new("make")
        .args(["--silent", "-C"])
        .arg(sources())
        .arg(format!("INTO={}", folder.display()))
        .env_remove("MAKEFLAGS")
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&made.stderr);
    assert!(made.status.success(), "is Debian's cyclonedds-dev installed? {errors}");
    std::fs::write(folder.join("ledger.so"), LIBRARY).unwrap();
    write_program(&folder.join("player"), PROGRAM);
    write_program(&folder.join("player-dds"), DDS_PROGRAM);
}

/// Writes a file that may be executed. A child of another thread's fork may have it open for a
/// moment, so that it can't be executed: a copy by another process is nobody's.
pub fn write_program(file: &Path, bytes: &[u8]) {
    use std::os::unix::fs::PermissionsExt;
    let draft = file.with_extension("draft");
    std::fs::write(&draft, bytes).unwrap();
    std::fs::set_permissions(&draft, std::fs::Permissions::from_mode(0o755)).unwrap();
    assert!(Command::new("cp").arg(&draft).arg(file).status().unwrap().success());
}

/// What those of other processes don't have, and places beside theirs: a case of forty processes may
/// be in a domain of this number, and a tag keeps apart who is met, but not the ports.
fn tag() -> String {
    let places = "<MaxAutoParticipantIndex>119</MaxAutoParticipantIndex>";
    format!("<Tag>bagpipe-{}</Tag>{places}", std::process::id())
}

/// A graph that nobody else is in: a domain with a tag of this process, or one that is held.
pub struct Graph {
    domain: u32,
    /// Its players' program.
    program: &'static str,
    /// What keeps other processes out of a domain without a tag.
    held: Option<UnixListener>,
    pub ledger: Ledger,
}

/// Domains without a tag, beyond those of the agent's cases.
const UNTAGGED: std::ops::Range<u32> = 102..165;

impl Graph {
    pub fn new() -> Graph {
        Graph::of("player")
    }

    /// One whose players know no librcl.
    pub fn on_dds() -> Graph {
        Graph::of("player-dds")
    }

    /// One with each program.
    pub fn of_each_player() -> [Graph; 2] {
        [Graph::new(), Graph::on_dds()]
    }

    /// The same, for players that know no librcl.
    pub fn with_player_on_dds(&self) -> Graph {
        Graph { domain: self.domain, ..Graph::on_dds() }
    }

    fn of(program: &'static str) -> Graph {
        static NEXT: AtomicU32 = AtomicU32::new(1);
        Graph::in_domain(NEXT.fetch_add(1, Ordering::SeqCst), program, None)
    }

    /// A graph without a tag, which Cyclone DDS alone has: other implementations can be in it.
    pub fn untagged() -> Graph {
        let hold = |domain: u32| {
            let name = SocketAddr::from_abstract_name(format!("bagpipe-domain-{domain}")).ok()?;
            Some((domain, UnixListener::bind_addr(&name).ok()?))
        };
        // Another process begins elsewhere: what one that ended has started may still end.
        let count = UNTAGGED.end - UNTAGGED.start;
        let turn = |one| UNTAGGED.start + (std::process::id() + one) % count;
        let (domain, held) = (0..count).map(turn).find_map(hold).unwrap();
        Graph::in_domain(domain, "player", Some(held))
    }

    fn in_domain(domain: u32, program: &'static str, held: Option<UnixListener>) -> Graph {
        let ledger = Ledger::new().unwrap();
        ledger.watch_matches(true);
        Graph { domain, program, held, ledger }
    }

    /// What a sourced setup would set.
    pub fn environment(&self) -> Vec<(OsString, OsString)> {
        self.environment_with(built())
    }

    pub fn environment_with(&self, folder: &Path) -> Vec<(OsString, OsString)> {
        let tag = match self.held {
            Some(_) => String::new(),
            None => tag(),
        };
        let settings = format!(
            "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name=\"lo\" \
             multicast=\"false\"/></Interfaces></General>\
             <Discovery>{tag}</Discovery></Domain></CycloneDDS>"
        );
        vec![
            ("LD_LIBRARY_PATH".into(), folder.into()),
            ("ROS_DOMAIN_ID".into(), self.domain.to_string().into()),
            ("CYCLONEDDS_URI".into(), settings.into()),
        ]
    }

    pub fn options(&self) -> PlayerOptions {
        let mut environment = self.environment();
        if self.program == "player-dds" {
            // Where nodes are is in its own settings.
            let settings = format!(
                "<CycloneDDS><Domain><Discovery>{}</Discovery></Domain></CycloneDDS>",
                tag()
            );
            environment.push(("CYCLONEDDS_URI".into(), settings.into()));
            environment.push(("LD_LIBRARY_PATH".into(), "/nowhere".into()));
        }
        PlayerOptions {
            program: built().join(self.program),
            environment,
            removed: vec!["LD_PRELOAD".into()],
            node: "player".into(),
            namespace: "/bagpipe".into(),
            room: 16 << 20,
            deadline: LONG,
        }
    }

    pub fn player(&self) -> Player {
        Player::start(&self.options()).unwrap()
    }

    /// A node like rclcpp's that counts in the ledger.
    pub fn node(&self, arguments: &[&str]) -> Node {
        self.start("standin_node", arguments)
    }

    pub fn start(&self, program: &str, arguments: &[&str]) -> Node {
        self.start_counting(program, arguments, &self.ledger)
    }

    /// A node that counts in another ledger.
    pub fn start_counting(&self, program: &str, arguments: &[&str], ledger: &Ledger) -> Node {
        self.spawn(program, arguments, &ledger.environment(&built().join("ledger.so"), None))
    }

    /// A node of which the domain has more settings of Cyclone DDS.
    pub fn node_with_settings(&self, settings: &str, arguments: &[&str]) -> Node {
        let variables = self.environment();
        let own = variables.iter().find(|(name, _)| name == "CYCLONEDDS_URI").unwrap();
        let domain = format!("<CycloneDDS><Domain>{settings}</Domain></CycloneDDS>");
        let all = format!("{},{domain}", own.1.to_str().unwrap());
        let counts = self.ledger.environment(&built().join("ledger.so"), None);
        let variables = [&counts[..], &[("CYCLONEDDS_URI", all.into())]].concat();
        self.spawn("standin_node", arguments, &variables)
    }

    /// A node that knows of no ledger.
    pub fn start_uncounted(&self, program: &str, arguments: &[&str]) -> Node {
        self.spawn(program, arguments, &[])
    }

    fn spawn(
        &self,
        program: &str,
        arguments: &[&str],
        variables: &[(&'static str, OsString)],
    ) -> Node {
        let child = Command::new(built().join(program))
            .args(arguments)
            .envs(self.environment())
            .envs(variables.iter().map(|(name, value)| (name, value)))
            .stdin(Stdio::null())
            .spawn()
            .unwrap();
        Node(child)
    }

    /// Waits until a node's subscription and the one publisher of its topic know of each other, which
    /// each learns by itself: what is published from then on arrives there.
    pub fn met(&self, topic: &str, player: &Player, publisher: PublisherId) -> Endpoint {
        eventually(|| self.subscription(topic).matched == Some(1));
        eventually(|| player.subscribers(publisher).unwrap() == 1);
        self.subscription(topic)
    }

    /// The subscription of a node on a topic, once there is one.
    pub fn subscription(&self, topic: &str) -> Endpoint {
        self.endpoint(Kind::Subscription, topic)
    }

    /// What a node has on a topic, once it is there.
    pub fn endpoint(&self, kind: Kind, topic: &str) -> Endpoint {
        let found = || {
            let all = self.ledger.endpoints().unwrap();
            all.into_iter().find(|one| one.topic == topic && one.kind == kind)
        };
        eventually(|| found().is_some());
        found().unwrap()
    }
}

/// Does the same in a graph with each player's program.
pub fn with_each_player(test: impl Fn(Graph)) {
    Graph::of_each_player().into_iter().for_each(test);
}

/// A node that runs; dropping it kills it.
pub struct Node(Child);

impl Node {
    pub fn pid(&self) -> u32 {
        self.0.id()
    }

    /// Sends a signal by its name.
    pub fn signal(&self, name: &str) {
        let pid = self.pid().to_string();
        assert!(Command::new("kill").args(["-s", name, &pid]).status().unwrap().success());
        // Until one of its threads has had the processor the others go on.
        if name == "STOP" {
            eventually(|| self.is_stopped());
        }
    }

    /// Whether each thread of it is stopped.
    fn is_stopped(&self) -> bool {
        let threads = std::fs::read_dir(format!("/proc/{}/task", self.pid())).unwrap();
        threads.map(|thread| thread.unwrap().path().join("stat")).all(|file| {
            let stat = std::fs::read_to_string(file).unwrap_or_default();
            stat.rsplit_once(')').is_none_or(|(_, rest)| rest.starts_with(" T"))
        })
    }

    /// Sends SIGTERM, and waits until it has ended: whether with success.
    pub fn end(mut self) -> bool {
        self.signal("TERM");
        self.0.wait().unwrap().success()
    }

    /// Waits until it has ended by itself: whether with success.
    pub fn ended(mut self) -> bool {
        self.0.wait().unwrap().success()
    }
}

impl Drop for Node {
    fn drop(&mut self) {
        let _ended_already = self.0.kill();
        let _status = self.0.wait();
    }
}

/// Waits until it holds.
pub fn eventually(mut holds: impl FnMut() -> bool) {
    let late = Instant::now() + LONG;
    while !holds() {
        assert!(Instant::now() < late, "it never held");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Whether each thread of a process is in a state, as `/proc` has it.
pub fn threads_are(pid: u32, state: char) -> bool {
    let threads = std::fs::read_dir(format!("/proc/{pid}/task")).unwrap();
    threads.map(|thread| thread.unwrap().path().join("stat")).all(|file| {
        let stat = std::fs::read_to_string(file).unwrap();
        stat.rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with(state))
    })
}

/// Bytes that their number decides, behind the encapsulation.
pub fn message(number: u64, length: usize) -> Vec<u8> {
    let mut state = number.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let mut bytes = CDR.to_vec();
    bytes.extend(number.to_le_bytes());
    while bytes.len() < 12 + length {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        bytes.extend(state.to_le_bytes());
    }
    bytes.truncate(12 + length);
    bytes
}

/// FNV-1a, which a node's answer has of a message whose length is a multiple of 4.
pub fn hash(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |value, byte| {
        (value ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3)
    })
}

/// The number of a message that [`message`] made.
pub fn number(message: &[u8]) -> u64 {
    u64::from_le_bytes(message[4..12].try_into().unwrap())
}

pub fn publish(player: &Player, publisher: PublisherId, bytes: &[u8]) -> Result<(), PlayerError> {
    player.publish(publisher, &[bytes], &mut || false)
}

/// Until both have matched: what is published then arrives.
pub fn match_own(player: &Player, publisher: PublisherId, subscription: SubscriptionId) {
    eventually(|| player.publishers(subscription).unwrap() == 1);
    eventually(|| player.subscribers(publisher).unwrap() == 1);
}
