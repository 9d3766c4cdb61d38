//! A master for one graph: the Master API (<https://wiki.ros.org/ROS/Master_API>) and the Parameter
//! Server API (<https://wiki.ros.org/ROS/Parameter%20Server%20API>), as Debian's rosmaster serves
//! them, which the tests compare.

mod call;
mod methods;
mod names;
mod notices;
mod parameters;
mod registrations;

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use crate::listener::Listener;
use crate::peer_queue::far_socket;
use crate::sockets::lock;
use crate::{RosError, calls, http};
use methods::Graph;
use notices::Notices;

/// Connections that are served at once, of which roscpp and rospy keep some for each node: a part of
/// the descriptors that the process may have, which the player and the recorder need as well.
fn most_served() -> usize {
    let files = rustix::process::getrlimit(rustix::process::Resource::Nofile).current;
    usize::try_from(files.unwrap_or(u64::MAX) / 4).unwrap_or(usize::MAX).clamp(64, 1024)
}

/// Takes in a node that registers, while it waits for the answer: its name, and the number of the socket by which it
/// asks, as /proc/PID/fd has it.
pub type Meet = dyn Fn(&str, u32) + Send + Sync;

/// A master that serves until it is dropped.
pub struct Rosmaster {
    listener: Listener,
    notices: Notices,
    uri: String,
}

impl Rosmaster {
    /// Listens on `address`, whose port 0 means a free one, and answers from then on.
    ///
    /// # Errors
    /// The address can't be had.
    pub fn serve(address: SocketAddr) -> Result<Rosmaster, RosError> {
        Rosmaster::serve_noting(address, Box::new(|_, _| {}))
    }

    /// The same, with who is to know of nodes that register.
    ///
    /// # Errors
    /// As of [`Rosmaster::serve`].
    pub fn serve_noting(address: SocketAddr, meet: Box<Meet>) -> Result<Rosmaster, RosError> {
        let (notices, room) = (Notices::default(), http::Room::default());
        let graph = Arc::new(Mutex::new(Graph::new(notices.clone())));
        let listener = Listener::start("rosmaster", address, most_served(), move |connection| {
            let own = connection.stream.local_addr();
            http::serve(connection, &room, |body| {
                // Over all of a call, so that memory for one is all that any number need.
                let mut calling = lock(&graph);
                if let Ok(own) = own {
                    calling.uri = format!("http://{own}/");
                }
                let answer = calls::answer(body, |method, params| calling.call(method, &params));
                let met = calling.take_met();
                drop(calling);
                for node in met {
                    if let Some(far) = far_socket(&connection.stream) {
                        meet(&node, far.inode);
                    }
                }
                answer
            });
        })?;
        let uri = format!("http://{}/", listener.address());
        Ok(Rosmaster { listener, notices, uri })
    }

    /// Where it answers.
    pub fn uri(&self) -> &str {
        &self.uri
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.listener.address()
    }
}

impl Drop for Rosmaster {
    /// A node that has the address of one of this graph's, later, gets nothing that was for that.
    fn drop(&mut self) {
        self.notices.end();
    }
}
