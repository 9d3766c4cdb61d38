//! A listening socket with one short thread per connection, which all end on drop.

use std::collections::HashMap;
use std::io::ErrorKind;
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags};

use crate::RosError;
use crate::sockets::{Waker, lock, wait};

/// How long the end waits for the serving threads, whose sockets are shut down first.
const END: Duration = Duration::from_secs(5);

/// How long the listener waits where it can't go on by itself.
const PAUSE: Duration = Duration::from_millis(100);

/// A connection that is served.
pub(crate) struct Connection {
    pub(crate) stream: TcpStream,
    /// Since when nothing is asked on it, if its server says so.
    quiet_since: Mutex<Option<Instant>>,
}

impl Connection {
    /// Notes whether somebody waits for an answer on it. One that is quiet may be closed in favour of
    /// another.
    pub(crate) fn is_quiet(&self, quiet: bool) {
        *lock(&self.quiet_since) = quiet.then(Instant::now);
    }
}

/// Serves connections until it is dropped.
pub(crate) struct Listener {
    address: SocketAddr,
    shared: Arc<Served>,
    accepting: Option<JoinHandle<()>>,
}

struct Served {
    stop: AtomicBool,
    waker: Waker,
    connections: Mutex<HashMap<u64, Arc<Connection>>>,
    fewer: Condvar,
}

impl Listener {
    /// Listens on `address`, whose port 0 means a free one; `serve` runs on a thread of its own
    /// for each connection and must end when its stream is shut down. `limit` connections are
    /// served at once; of those that are quiet, the longest so is closed when another one comes, and
    /// if none is, that waits in the kernel's backlog.
    pub(crate) fn start(
        name: &str,
        address: SocketAddr,
        limit: usize,
        serve: impl Fn(&Connection) + Send + Sync + 'static,
    ) -> Result<Listener, RosError> {
        let failed = || format!("{name} can't listen on {address}");
        let listener = TcpListener::bind(address).map_err(RosError::io(failed()))?;
        listener.set_nonblocking(true).map_err(RosError::io(failed()))?;
        let address = listener.local_addr().map_err(RosError::io(failed()))?;
        let shared = Arc::new(Served {
            stop: AtomicBool::new(false),
            waker: Waker::new().map_err(RosError::io(failed()))?,
            connections: Mutex::default(),
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
        F: Fn(&Connection) + Send + Sync + 'static,
    {
        let mut next = 0;
        let room = || lock(&self.connections).len() < limit;
        while !self.stop.load(Ordering::Acquire) {
            let mut fds = [self.waker.poll_fd(), PollFd::new(listener, PollFlags::IN)];
            if wait(&mut fds, PAUSE).is_err() {
                return;
            }
            let mut stuck = !fds[1].revents().is_empty();
            self.waker.clear();
            while room() {
                match listener.accept() {
                    Ok((stream, _)) => {
                        (next, stuck) = (next + 1, false);
                        self.serve(next, stream, Arc::clone(serve));
                    }
                    // A peer that has gone again, or a process without descriptors: that may last.
                    Err(error) => {
                        stuck = error.kind() != ErrorKind::WouldBlock;
                        break;
                    }
                }
            }
            if stuck {
                if !room() {
                    self.close_the_quietest();
                }
                if wait(&mut fds[..1], PAUSE).is_err() {
                    return;
                }
            }
        }
    }

    fn close_the_quietest(&self) {
        let connections = lock(&self.connections);
        let quiet = connections.values().filter_map(|connection| {
            let since = *lock(&connection.quiet_since);
            since.map(|since| (since, connection))
        });
        if let Some((_, connection)) = quiet.min_by_key(|(since, _)| *since) {
            connection.is_quiet(false);
            let _already_closed = connection.stream.shutdown(Shutdown::Both);
        }
    }

    /// A connection that can't get a thread is closed, which its peer sees and retries.
    fn serve<F>(self: &Arc<Self>, id: u64, stream: TcpStream, serve: Arc<F>)
    where
        F: Fn(&Connection) + Send + Sync + 'static,
    {
        if stream.set_nonblocking(false).is_err() {
            return;
        }
        let connection = Arc::new(Connection { stream, quiet_since: Mutex::default() });
        lock(&self.connections).insert(id, Arc::clone(&connection));
        let shared = Arc::clone(self);
        let spawned = std::thread::Builder::new().name("connection".into()).spawn(move || {
            serve(&connection);
            lock(&shared.connections).remove(&id);
            drop(connection);
            shared.waker.wake();
            shared.fewer.notify_all();
        });
        if spawned.is_err() {
            lock(&self.connections).remove(&id);
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
        let mut connections = lock(&self.shared.connections);
        for connection in connections.values() {
            let _already_closed = connection.stream.shutdown(Shutdown::Both);
        }
        while !connections.is_empty() {
            match self.shared.fewer.wait_timeout(connections, END) {
                Ok((left, timeout)) if !timeout.timed_out() => connections = left,
                _ => return,
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};
    use std::net::Ipv4Addr;

    use super::*;
    use crate::http;

    /// Asks on a new connection, which stays.
    fn ask(address: SocketAddr) -> std::io::Result<TcpStream> {
        let mut stream = TcpStream::connect(address)?;
        stream.set_read_timeout(Some(Duration::from_secs(20)))?;
        stream.write_all(b"POST / HTTP/1.1\r\nContent-Length: 1\r\n\r\nx")?;
        let mut answer = [0; 15];
        stream.read_exact(&mut answer)?;
        assert_eq!(&answer, b"HTTP/1.1 200 OK");
        Ok(stream)
    }

    #[test]
    fn connections_that_nobody_asks_on_keep_no_other_out() {
        let room = http::Room::default();
        let listener = Listener::start("test", (Ipv4Addr::LOCALHOST, 0).into(), 4, move |one| {
            http::serve(one, &room, |_| "answered".to_owned());
        })
        .unwrap();
        let _silent: Vec<TcpStream> =
            (0..3).map(|_| TcpStream::connect(listener.address()).unwrap()).collect();
        let asked: Vec<TcpStream> = (0..20).map(|_| ask(listener.address()).unwrap()).collect();
        assert!(lock(&listener.shared.connections).len() <= 4);
        drop(asked);
    }
}
