//! A master for one graph: the Master API (<https://wiki.ros.org/ROS/Master_API>) and the Parameter
//! Server API (<https://wiki.ros.org/ROS/Parameter%20Server%20API>), as Debian's rosmaster serves
//! them, which the tests compare.

mod methods;
mod names;
mod notices;
mod parameters;
mod registrations;

use std::net::SocketAddr;
use std::sync::{Arc, Mutex};

use crate::listener::Listener;
use crate::sockets::lock;
use crate::{RosError, calls, http};
use methods::Graph;
use notices::Notices;

/// Connections that are served at once. roscpp and rospy keep some for each node.
const MOST_SERVED: usize = 4096;

/// A master that serves until it is dropped.
pub struct Rosmaster {
    listener: Listener,
    uri: String,
}

impl Rosmaster {
    /// Listens on `address`, whose port 0 means a free one, and answers from then on.
    ///
    /// # Errors
    /// The address can't be had.
    pub fn serve(address: SocketAddr) -> Result<Rosmaster, RosError> {
        let graph: Arc<Mutex<Graph>> = Arc::default();
        let notices = Notices::default();
        let listener = Listener::start("rosmaster", address, MOST_SERVED, move |stream| {
            let own = stream.local_addr();
            http::serve(stream, |body| {
                calls::answer(body, |method, params| {
                    let mut graph = lock(&graph);
                    if let Ok(own) = own {
                        graph.uri = format!("http://{own}/");
                    }
                    let answer = graph.call(method, &params);
                    // While the graph is held, so that a later call's notices are later ones.
                    for (uri, notice) in graph.take_notices() {
                        notices.send(&uri, notice);
                    }
                    answer
                })
            });
        })?;
        let uri = format!("http://{}/", listener.address());
        Ok(Rosmaster { listener, uri })
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
