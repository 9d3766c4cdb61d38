//! What can go wrong with a player.

use std::path::PathBuf;
use std::time::Duration;

/// Why something is not to be had of a ROS 2 graph.
#[derive(Debug, thiserror::Error)]
pub enum PlayerError {
    /// The program can't be started.
    #[error("the ROS 2 player {} can't be started: {error}", program.display())]
    Program {
        /// Its file.
        program: PathBuf,
        /// What the kernel says.
        error: std::io::Error,
    },
    /// The kernel gives no memory, socket or wait.
    #[error("no shared memory for the ROS 2 player: {0}")]
    Memory(#[from] std::io::Error),
    /// There is no ROS 2 in the program's environment.
    #[error(
        "there is no ROS 2 here: {0}; source the setup file of ROS 2 and of the workspace \
         (/opt/ros/DISTRIBUTION/setup.sh) in the command that starts the stack"
    )]
    NoRos(String),
    /// librcl lacks a function that each distribution from Foxy on has.
    #[error(
        "librcl has no {0}: ROS 2 from Foxy to Rolling has it; is LD_LIBRARY_PATH of one of these?"
    )]
    Symbol(String),
    /// The text is no name of a message type.
    #[error("{0:?} is no name of a message type, such as sensor_msgs/msg/Imu")]
    Datatype(String),
    /// A package of messages is not installed.
    #[error(
        "{topic} needs the messages of {package}, and {library} can't be loaded: {reason}; install \
         the package {package} in the image, and source its workspace"
    )]
    Package {
        /// The topic whose type it is.
        topic: String,
        /// The package.
        package: String,
        /// Its library of types.
        library: String,
        /// What the loader says.
        reason: String,
    },
    /// A package has no such message.
    #[error(
        "{topic} needs {datatype}, which {library} has not: install a version of its package that \
         has it in the image"
    )]
    Type {
        /// The topic whose type it is.
        topic: String,
        /// The type.
        datatype: String,
        /// Its package's library of types.
        library: String,
    },
    /// A function of the middleware has failed: rcl's or DDS's.
    #[error("{function} has failed with {code}: {reason}")]
    Call {
        /// Which function.
        function: String,
        /// What it returned.
        code: i32,
        /// Its text.
        reason: String,
    },
    /// The domain takes no more participants, or the middleware gives none for another reason.
    #[error(
        "the ROS 2 player can't join its domain: {function} has failed with {code}: {reason}; is \
         there room for one process more? Cyclone DDS has it for as many as MaxAutoParticipantIndex \
         in CYCLONEDDS_URI, Fast DDS for as many as its profile lets in{}",
        last_lines(errors)
    )]
    Join {
        /// Which function.
        function: String,
        /// What it returned.
        code: i32,
        /// rcl's text.
        reason: String,
        /// The last lines of its standard error: why there is no room stands there alone.
        errors: Vec<String>,
    },
    /// A function of rcl has failed, and ROS 2's security is on.
    #[error(
        "the ROS 2 player can't {what}: {call}; ROS_SECURITY_ENABLE is true, so that it needs all \
         keys in {enclave}: the enclave / of ROS_SECURITY_KEYSTORE, unless \
         ROS_SECURITY_ENCLAVE_OVERRIDE names another; governance and permissions must let it into \
         domain {domain}, and to what is played and recorded{}",
        last_lines(errors)
    )]
    Secured {
        /// What the player was to do.
        what: String,
        /// [`Call`](Self::Call): which function, and rcl's text.
        call: Box<PlayerError>,
        /// The folder where the player's keys are looked for.
        enclave: String,
        /// The domain that it was to join.
        domain: String,
        /// The last lines of its standard error: what is refused stands there alone.
        errors: Vec<String>,
    },
    /// The middleware has refused messages since the last call.
    #[error("{count} messages on {topic} were refused, the last since: {reason}")]
    Refused {
        /// The topic.
        topic: String,
        /// How many, since this was last reported.
        count: u64,
        /// The middleware's text on the last one.
        reason: String,
    },
    /// A message is longer than the rings can pass on.
    #[error(
        "a message of {length} bytes on {topic} is more than the player passes on, {most}: half of \
         its room; give it more"
    )]
    TooLarge {
        /// The topic.
        topic: String,
        /// Its length in bytes.
        length: u64,
        /// The most, in bytes.
        most: u64,
    },
    /// The options ask for rings that can't be.
    #[error("rings of {0} bytes can't be: at most {MOST_ROOM}, each")]
    Room(u64),
    /// A subscription gives no messages from now on.
    #[error("{topic} can't be recorded any more: {reason}")]
    Take {
        /// The topic.
        topic: String,
        /// The middleware's text.
        reason: String,
    },
    /// There are as many publishers or subscriptions as a player can have.
    #[error("{topic} is one topic too many: a player has room for {most}")]
    TooMany {
        /// The topic.
        topic: String,
        /// The most.
        most: usize,
    },
    /// A publisher or subscription that this player has not made.
    #[error("there is no such publisher or subscription of this player: is it of another one?")]
    Stranger,
    /// The caller asked to wait no longer.
    #[error("cancelled")]
    Cancelled,
    /// The program did not answer in time.
    #[error(
        "the ROS 2 player has not answered within {} s while it was to {what}; does the \
         middleware wait for something, such as a router or a daemon?",
        limit.as_secs_f64()
    )]
    Late {
        /// What it was to do.
        what: String,
        /// How long it was waited for.
        limit: Duration,
    },
    /// The program has ended.
    #[error("the ROS 2 player has ended ({status}){}", last_lines(errors))]
    Ended {
        /// How: its status, or the signal.
        status: String,
        /// The last lines of its standard error.
        errors: Vec<String>,
    },
    /// Somebody wrote over the shared memory, or the program answers nonsense.
    #[error(
        "the ROS 2 player's memory is damaged at byte {offset}: {what}; a process of the stack \
         wrote it"
    )]
    Damaged {
        /// Where, in bytes.
        offset: usize,
        /// What stands there.
        what: String,
    },
    /// The program's answer can't be one.
    #[error("the ROS 2 player's answer can't be understood: {0}")]
    Answer(String),
}

impl PlayerError {
    /// Whether it says that no librcl can be used here, so that only a player without one can play:
    /// the loader has none, or one that lacks a function; or there is no loader for the program.
    pub fn is_without_librcl(&self) -> bool {
        match self {
            PlayerError::NoRos(_) | PlayerError::Symbol(_) => true,
            PlayerError::Program { error, .. } => error.kind() == std::io::ErrorKind::NotFound,
            // By which a loader says that a C library is too old, or another one.
            PlayerError::Ended { status, .. } => status == "exit status: 127",
            _ => false,
        }
    }
}

/// The most that a ring may have, in bytes: offsets of records are 32 bits with room to spare.
pub(crate) const MOST_ROOM: u64 = 1 << 30;

fn last_lines(errors: &[String]) -> String {
    if errors.is_empty() {
        return String::new();
    }
    format!("; its last lines: {}", errors.join(" | "))
}
