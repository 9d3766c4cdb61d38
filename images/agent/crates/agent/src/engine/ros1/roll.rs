//! The nodes that the ROS master knows when the play begins, and what has become of them at its
//! end, whatever roslaunch says.

use std::collections::BTreeSet;
use std::thread::{Builder, ScopedJoinHandle};
use std::time::Duration;

use bagpipe_ros1::{Master, RosError};

use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{descendants, is_alive};

/// A node on this machine answers within milliseconds.
const ASK: Duration = Duration::from_secs(1);
/// How many are asked at once: each that does not answer takes its time, in which the case's deadline
/// passes unseen.
const AT_ONCE: usize = 32;
const CALLER: &str = "/bagpipe_agent";
/// Our own node in the graph.
const PLAYER: &str = "/bagpipe_player_";

/// All nodes but our own. A master that does not answer fails the replay, so no error is
/// reported here.
pub fn roll(master_uri: &str) -> Vec<Known> {
    let Ok(master) = Master::new(master_uri, CALLER, ASK) else { return Vec::new() };
    let names = registered(&master);
    let ours = |name: &String| name.starts_with(PLAYER);
    let others: Vec<String> = names.into_iter().filter(|name| !ours(name)).collect();
    let addresses = addresses(&master, others.iter());
    let listed: Vec<(String, Address)> = others.into_iter().zip(addresses).collect();
    let known = of_each(&listed, |(name, address)| {
        let Address::At(uri) = address else { return None };
        // The player answers, and the master: a node that gives the address of either as its own
        // would live as long as they do.
        let pid = pid_of(uri).ok().filter(|pid| u32::try_from(*pid) != Ok(std::process::id()));
        Some(Known { name: name.clone(), uri: uri.clone(), pid, stayed: false })
    });
    known.into_iter().flatten().flatten().collect()
}

/// Where a node is, as its master has it.
enum Address {
    At(String),
    Unregistered,
    /// The master does not answer.
    Unknown,
}

/// Where each node is. The master is asked for one after another: rosmaster has a queue of five
/// connections, of which the kernel drops more until a second later. One that does not answer is
/// asked no more.
fn addresses<'n>(master: &Master, names: impl Iterator<Item = &'n String>) -> Vec<Address> {
    let mut answers = true;
    let ask = |name: &String| match answers.then(|| master.lookup_node(name)) {
        Some(Ok(uri)) => Address::At(uri),
        Some(Err(RosError::Refused { .. })) => Address::Unregistered,
        Some(Err(_)) | None => {
            answers = false;
            Address::Unknown
        }
    };
    names.map(ask).collect()
}

/// What is found of each, in their order; `None` where looking for it broke.
fn of_each<O: Sync, F: Send>(of: &[O], find: impl Fn(&O) -> F + Sync) -> Vec<Option<F>> {
    let find = &find;
    let together = |some: &[O]| {
        std::thread::scope(|scope| {
            let ask = |one| {
                let asked = Builder::new().spawn_scoped(scope, move || find(one));
                // A stack may leave no room for threads.
                asked.map_err(|_| find(one))
            };
            let asked: Vec<_> = some.iter().map(ask).collect();
            let found = |asked: Result<ScopedJoinHandle<'_, F>, F>| match asked {
                Ok(asked) => asked.join().ok(),
                Err(found) => Some(found),
            };
            asked.into_iter().map(found).collect::<Vec<_>>()
        })
    };
    of.chunks(AT_ONCE).flat_map(together).collect()
}

/// Notes who is still there when all input is out: who leaves after that is done.
pub fn note_stayed(master_uri: &str, roll: &mut [Known]) {
    let Ok(master) = Master::new(master_uri, CALLER, ASK) else { return };
    let names = registered(&master);
    for known in roll {
        known.stayed = names.contains(&known.name);
    }
}

fn registered(master: &Master) -> BTreeSet<String> {
    let state = master.get_system_state().unwrap_or_default();
    let topics = state.publishers.into_values().chain(state.subscribers.into_values());
    topics.flatten().collect()
}

/// What has become of each; the stack's processes are all below this one.
pub fn look(master_uri: &str, roll: &[Known]) -> Vec<Found> {
    let Ok(master) = Master::new(master_uri, CALLER, ASK) else {
        return vec![Found::Same; roll.len()];
    };
    let addresses = addresses(&master, roll.iter().map(|known| &known.name));
    let listed: Vec<(&Known, Address)> = roll.iter().zip(addresses).collect();
    let found = of_each(&listed, |(known, address)| look_at(known, address));
    found.into_iter().map(|found| found.unwrap_or(Found::Same)).collect()
}

fn look_at(known: &Known, address: &Address) -> Found {
    let uri = match address {
        Address::At(uri) => uri,
        Address::Unregistered => return Found::Unregistered,
        Address::Unknown => return Found::Same,
    };
    match (answering(uri, known), known.pid) {
        (Some(pid), Some(before)) if pid != before => Found::Another,
        (Some(_), _) if *uri != known.uri => Found::Another,
        (Some(_), _) => Found::Same,
        // One that hangs still has its socket: that is for the ledger to say.
        (None, Some(pid)) if is_alive(pid) && *uri == known.uri => Found::Same,
        (None, _) => Found::Unreachable,
    }
}

/// Who answers there in the node's name: where one ended, the kernel may have given its port to
/// a node of another slot.
fn answering(uri: &str, known: &Known) -> Option<i32> {
    let pid = pid_of(uri).ok()?;
    let stack = || descendants(std::process::id(), &[]);
    (known.pid == Some(pid) || stack().contains(&pid)).then_some(pid)
}

fn pid_of(uri: &str) -> Result<i32, RosError> {
    // The Slave API's getPid is the master's word for word.
    let pid = Master::new(uri, CALLER, ASK)?.get_pid()?;
    Ok(i32::try_from(pid).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use std::io::{Read as _, Write as _};
    use std::net::{Ipv4Addr, TcpListener, TcpStream};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};
    use std::time::Instant;

    use bagpipe_ros1::Rosmaster;

    use super::*;

    #[test]
    fn a_node_that_gives_an_address_of_the_agent_as_its_own_is_not_kept_alive_by_it() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let liar = Master::new(served.uri(), "/liar", ASK).unwrap();
        liar.register_publisher("/t", "std_msgs/String", served.uri()).unwrap();
        let known = roll(served.uri());
        assert_eq!(known.len(), 1);
        assert_eq!(look(served.uri(), &known), [Found::Unreachable]);
    }

    #[test]
    fn nodes_that_do_not_answer_are_waited_for_together() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        // The kernel takes connections, and nobody reads them.
        let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", mute.local_addr().unwrap());
        for number in 0..8 {
            let node = Master::new(served.uri(), &format!("/mute{number}"), ASK).unwrap();
            node.register_publisher("/t", "std_msgs/String", &uri).unwrap();
        }
        let begun = Instant::now();
        let known = roll(served.uri());
        let found = look(served.uri(), &known);
        assert!(begun.elapsed() < 6 * ASK, "{:?}", begun.elapsed());
        assert_eq!((known.len(), found), (8, vec![Found::Unreachable; 8]));
    }

    /// A request or an answer of HTTP.
    fn message(from: &mut TcpStream) -> Vec<u8> {
        let (mut all, mut byte) = (Vec::new(), [0]);
        while !all.ends_with(b"\r\n\r\n") {
            from.read_exact(&mut byte).unwrap();
            all.push(byte[0]);
        }
        let head = String::from_utf8(all.clone()).unwrap().to_lowercase();
        let length = head.split_once("content-length:").unwrap().1;
        let mut body = vec![0; length.lines().next().unwrap().trim().parse().unwrap()];
        from.read_exact(&mut body).unwrap();
        [all, body].concat()
    }

    /// The address of who passes calls on to a master, and the most that were under way at once.
    fn counted(master: String) -> (String, Arc<AtomicUsize>) {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", listener.local_addr().unwrap());
        let (most, under_way) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicUsize::new(0)));
        let seen = Arc::clone(&most);
        std::thread::spawn(move || {
            for asking in listener.incoming() {
                let (mut asking, to) = (asking.unwrap(), master.clone());
                let (seen, under_way) = (Arc::clone(&seen), Arc::clone(&under_way));
                std::thread::spawn(move || {
                    let request = message(&mut asking);
                    seen.fetch_max(under_way.fetch_add(1, Ordering::SeqCst) + 1, Ordering::SeqCst);
                    let mut asked = TcpStream::connect(to).unwrap();
                    asked.write_all(&request).unwrap();
                    let answer = message(&mut asked);
                    under_way.fetch_sub(1, Ordering::SeqCst);
                    asking.write_all(&answer).unwrap();
                });
            }
        });
        (uri, most)
    }

    #[test]
    fn a_master_is_asked_for_one_node_after_another() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        for number in 0..40 {
            let node = Master::new(served.uri(), &format!("/node{number}"), ASK).unwrap();
            node.register_publisher("/t", "std_msgs/String", served.uri()).unwrap();
        }
        let address = served.uri().trim_start_matches("http://").trim_end_matches('/');
        let (uri, most) = counted(address.to_owned());
        let known = roll(&uri);
        assert_eq!((known.len(), look(&uri, &known).len()), (40, 40));
        assert_eq!(most.load(Ordering::SeqCst), 1);
    }

    #[test]
    fn a_master_that_does_not_answer_is_asked_once() {
        let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", mute.local_addr().unwrap());
        let of = |number| Known {
            name: format!("/node{number}"),
            uri: String::new(),
            pid: None,
            stayed: false,
        };
        let known: Vec<Known> = (0..3).map(of).collect();
        assert_eq!(look(&uri, &known), [Found::Same, Found::Same, Found::Same]);
        mute.set_nonblocking(true).unwrap();
        assert_eq!(std::iter::from_fn(|| mute.accept().ok()).count(), 1);
    }
}
