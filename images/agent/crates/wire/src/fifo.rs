//! Making and opening named pipes, with deadlines.

use std::os::fd::{AsFd, OwnedFd};
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{CWD, FileType, Mode, OFlags};
use rustix::io::Errno;

/// The size that each end asks for.
pub const PIPE_BYTES: usize = 256 * 1024;

/// How long to wait between two tries to open a pipe that nobody reads yet.
const RETRY: Duration = Duration::from_millis(2);

/// Makes a FIFO that everybody may read and write, whatever the umask; one that exists is
/// kept, and anything else of that name is replaced.
pub fn make(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::FileTypeExt;
    match std::fs::symlink_metadata(path) {
        Ok(found) if found.file_type().is_fifo() => {}
        Ok(_) => {
            std::fs::remove_file(path)?;
            make_new(path)?;
        }
        Err(_) => make_new(path)?,
    }
    open_to_all(path)
}

fn make_new(path: &Path) -> std::io::Result<()> {
    let mode = Mode::from_raw_mode(0o666);
    Ok(rustix::fs::mknodat(CWD, path, FileType::Fifo, mode, 0)?)
}

/// Sets mode 0666: Spark's workers run as another user than the agent.
pub fn open_to_all(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o666))
}

/// Opens for reading, which never waits.
pub fn open_reader(path: &Path) -> std::io::Result<OwnedFd> {
    let flags = OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    Ok(rustix::fs::open(path, flags, Mode::empty())?)
}

/// Opens for writing as soon as somebody reads. `None` when `stop` says so or the deadline
/// passes first.
pub fn open_writer(
    path: &Path,
    deadline: Instant,
    stop: &dyn Fn() -> bool,
) -> std::io::Result<Option<OwnedFd>> {
    let flags = OFlags::WRONLY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    loop {
        match rustix::fs::open(path, flags, Mode::empty()) {
            Ok(pipe) => return Ok(Some(pipe)),
            Err(Errno::NXIO | Errno::INTR) => {}
            Err(error) => return Err(error.into()),
        }
        if stop() || Instant::now() >= deadline {
            return Ok(None);
        }
        // Nothing can be polled for: the pipe has no other end yet.
        std::thread::sleep(RETRY);
    }
}

/// Asks for [`PIPE_BYTES`] and returns what the pipe has. Past the node's soft limit the
/// kernel refuses, which costs speed and nothing else.
pub fn grow(pipe: impl AsFd) -> usize {
    let asked = rustix::pipe::fcntl_setpipe_size(&pipe, PIPE_BYTES);
    asked.or_else(|_| rustix::pipe::fcntl_getpipe_size(&pipe)).unwrap_or(0)
}

/// What waiting for a pipe's first bytes came to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readiness {
    /// Bytes can be read.
    Bytes,
    /// A writer came and went without a byte.
    HangUp,
    /// Nobody wrote.
    Nothing,
}

/// Waits for the first bytes. (Reading at once would not do: a pipe that nobody has opened
/// for writing yet looks like one at its end.)
pub fn await_bytes(pipe: impl AsFd, timeout: Duration) -> std::io::Result<Readiness> {
    let mut one = [PollFd::new(&pipe, PollFlags::IN)];
    let timeout = Timespec {
        tv_sec: i64::try_from(timeout.as_secs()).unwrap_or(i64::MAX),
        tv_nsec: i64::from(timeout.subsec_nanos()),
    };
    match poll(&mut one, Some(&timeout)) {
        Ok(_) | Err(Errno::INTR) => {}
        Err(error) => return Err(error.into()),
    }
    let found = one[0].revents();
    Ok(if found.contains(PollFlags::IN) {
        Readiness::Bytes
    } else if found.contains(PollFlags::HUP) {
        Readiness::HangUp
    } else {
        Readiness::Nothing
    })
}
