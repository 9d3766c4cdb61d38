//! What a player is started with.

use std::ffi::OsString;
use std::path::PathBuf;
use std::time::Duration;

/// How the program is started.
#[derive(Clone, Debug)]
pub struct PlayerOptions {
    /// A file with [`PROGRAM`](crate::PROGRAM) or [`DDS_PROGRAM`](crate::DDS_PROGRAM), which may be
    /// executed.
    pub program: PathBuf,
    /// Variables that it gets besides this process's own: those of the user's sourced setup.
    pub environment: Vec<(OsString, OsString)>,
    /// Variables that it does not get, wherever they come from, such as `LD_PRELOAD`.
    pub removed: Vec<OsString>,
    /// Its node's name.
    pub node: String,
    /// Its node's namespace, such as `/` or `/bagpipe`.
    pub namespace: String,
    /// Bytes of each of the two rings, taken as the next power of two from 64 KiB to 1 GiB. A
    /// message may have half of it, less 16 bytes. Over time all of it is memory in use.
    pub room: u64,
    /// The most that the start may take, and each call that asks the program something.
    pub deadline: Duration,
}
