//! A listening socket with one short thread per connection, which all end on drop.

use std::collections::HashMap;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags};

use crate::RosError;
use crate::sockets::{Waker, lock, wait};

/// How long the end waits for the serving threads, whose sockets are shut down first.
const END: Duration = Duration::from_secs(5);

/// Serves connections until it is dropped.
pub(crate) struct Listener {
    address: SocketAddr,
    shared: Arc<Served>,
    accepting: Option<JoinHandle<()>>,
}

struct Served {
    stop: AtomicBool,
    waker: Waker,
    streams: Mutex<HashMap<u64, TcpStream>>,
    fewer: Condvar,
}

impl Listener {
    /// Listens on `address`, whose port 0 means a free one; `serve` runs on a thread of its own
    /// for each connection and must end when its stream is shut down. `limit` connections are
    /// served at once; more wait in the kernel's backlog.
    pub(crate) fn start(
        name: &str,
        address: SocketAddr,
        limit: usize,
        serve: impl Fn(TcpStream) + Send + Sync + 'static,
    ) -> Result<Listener, RosError> {
        let failed = || format!("{name} can't listen on {address}");
        let listener = TcpListener::bind(address).map_err(RosError::io(failed()))?;
        listener.set_nonblocking(true).map_err(RosError::io(failed()))?;
        let address = listener.local_addr().map_err(RosError::io(failed()))?;
        let shared = Arc::new(Served {
            stop: AtomicBool::new(false),
            waker: Waker::new().map_err(RosError::io(failed()))?,
            streams: Mutex::default(),
            fewer: Condvar::new(),
        });
        let accepting = std::thread::Builder::new()
            .name(name.to_owned())
            .spawn({
                let shared = Arc::clone(&shared);
                move || shared.accept(&listener, limit, &Arc::new(serve))
            })
            .map_err(RosError::io(failed()))?;
        Ok(Listener { address, shared, accepting: Some(accepting) })
    }

    /// The address that it listens on.
    pub(crate) fn address(&self) -> SocketAddr {
        self.address
    }
}

impl Served {
    fn accept<F>(self: &Arc<Self>, listener: &TcpListener, limit: usize, serve: &Arc<F>)
    where
        F: Fn(TcpStream) + Send + Sync + 'static,
    {
        let mut next = 0;
        while !self.stop.load(Ordering::Acquire) {
            let room = || lock(&self.streams).len() < limit;
            let mut fds = [self.waker.poll_fd(), PollFd::new(listener, PollFlags::IN)];
            let watched = if room() { 2 } else { 1 };
            if wait(&mut fds[..watched], Duration::from_millis(100)).is_err() {
                return;
            }
            self.waker.clear();
            while room()
                && let Ok((stream, _)) = listener.accept()
            {
                next += 1;
                self.serve(next, stream, Arc::clone(serve));
            }
        }
    }

    /// A connection that can't get a thread is closed, which its peer sees and retries.
    fn serve<F>(self: &Arc<Self>, id: u64, stream: TcpStream, serve: Arc<F>)
    where
        F: Fn(TcpStream) + Send + Sync + 'static,
    {
        let Ok(copy) = stream.try_clone() else { return };
        if stream.set_nonblocking(false).is_err() {
            return;
        }
        lock(&self.streams).insert(id, copy);
        let shared = Arc::clone(self);
        let spawned = std::thread::Builder::new().name("connection".into()).spawn(move || {
            serve(stream);
            lock(&shared.streams).remove(&id);
            shared.waker.wake();
            shared.fewer.notify_all();
        });
        if spawned.is_err() {
            lock(&self.streams).remove(&id);
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        self.shared.waker.wake();
        if let Some(thread) = self.accepting.take() {
            // A panic in it was already printed; there is nothing left to stop.
            let _ended = thread.join();
        }
        let mut streams = lock(&self.shared.streams);
        for stream in streams.values() {
            let _already_closed = stream.shutdown(Shutdown::Both);
        }
        while !streams.is_empty() {
            match self.shared.fewer.wait_timeout(streams, END) {
                Ok((left, timeout)) if !timeout.timed_out() => streams = left,
                _ => return,
            }
        }
    }
}
