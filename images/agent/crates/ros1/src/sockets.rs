//! Sockets: waiting with a deadline, waking a waiting thread, unsent bytes.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Locks, also after a thread has died while it held the lock: the data are counters and
/// lists that are whole between any two statements.
pub(crate) fn lock<T: ?Sized>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits until one of `fds` is ready; fills their `revents`. `false` after the timeout.
pub(crate) fn wait(fds: &mut [PollFd<'_>], timeout: Duration) -> std::io::Result<bool> {
    let timeout = Timespec {
        tv_sec: timeout.as_secs().try_into().unwrap_or(i64::MAX),
        tv_nsec: timeout.subsec_nanos().into(),
    };
    match poll(fds, Some(&timeout)) {
        Ok(ready) => Ok(ready > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

/// Waits until `stream` takes bytes again, or is broken (the next write says so).
pub(crate) fn wait_writable(stream: &TcpStream, timeout: Duration) -> std::io::Result<bool> {
    wait(&mut [PollFd::new(stream, PollFlags::OUT)], timeout)
}

/// Whether the peer has closed the connection. Subscribers send nothing after their
/// header, so a readable socket without bytes is a closed one.
pub(crate) fn peer_has_closed(stream: &TcpStream) -> bool {
    let mut byte = [0; 1];
    match stream.peek(&mut byte) {
        Ok(0) => true,
        Ok(_) => false,
        Err(error) => error.kind() != std::io::ErrorKind::WouldBlock,
    }
}

/// Bytes that were written to the socket and that the peer's kernel has not yet
/// acknowledged (`SIOCOUTQ`, tcp(7)).
#[allow(unsafe_code)] // rustix has no safe wrapper of SIOCOUTQ; the opcode fills one int.
pub(crate) fn unsent(stream: &TcpStream) -> std::io::Result<u64> {
    const SIOCOUTQ: rustix::ioctl::Opcode = 0x5411;
    // SAFETY: SIOCOUTQ writes a C int, which is the getter's output type.
    let bytes = unsafe {
        rustix::ioctl::ioctl(stream.as_fd(), rustix::ioctl::Getter::<SIOCOUTQ, i32>::new())
    }?;
    Ok(bytes.max(0) as u64)
}

/// Wakes a thread that waits in `poll`.
#[derive(Debug)]
pub(crate) struct Waker {
    near: UnixStream,
    far: UnixStream,
}

impl Waker {
    pub(crate) fn new() -> std::io::Result<Waker> {
        let (near, far) = UnixStream::pair()?;
        near.set_nonblocking(true)?;
        far.set_nonblocking(true)?;
        Ok(Waker { near, far })
    }

    /// Makes [`Waker::poll_fd`] readable. A full socket means that it already is.
    pub(crate) fn wake(&self) {
        let _already_awake = (&self.near).write(&[1]);
    }

    /// What the waiting thread polls.
    pub(crate) fn poll_fd(&self) -> PollFd<'_> {
        PollFd::new(&self.far, PollFlags::IN)
    }

    /// Takes the wakes back.
    pub(crate) fn clear(&self) {
        let mut bytes = [0; 64];
        while matches!((&self.far).read(&mut bytes), Ok(n) if n > 0) {}
    }
}
