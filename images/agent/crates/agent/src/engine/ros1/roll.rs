//! The nodes that the ROS master knows when the play begins, and what has become of them at its
//! end, whatever roslaunch says.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::thread::{Builder, ScopedJoinHandle};
use std::time::{Duration, Instant};

use bagpipe_ros1::{Master, RosError, is_closed};

use crate::engine::ros1::names::is_of_stack;
use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{descendants, is_alive};

/// A node on this machine answers within milliseconds.
const ASK: Duration = Duration::from_secs(1);
/// How long is waited in all for answers of the master that do not come; it is asked for the next one
/// no sooner than `AGAIN`.
const PATIENCE: Duration = Duration::from_secs(4);
const AGAIN: Duration = Duration::from_millis(200);
/// How many are asked at once: each that does not answer takes its time, in which the case's deadline
/// passes unseen.
const AT_ONCE: usize = 32;
const CALLER: &str = "/bagpipe_agent";

/// All nodes but our own and those of the command line, which end as they like.
///
/// # Errors
/// The master does not answer: which nodes there are can't be known.
pub fn roll(master_uri: &str) -> Result<Vec<Known>, RosError> {
    let master = Patient::new(master_uri)?;
    let names = registered(&master)?;
    let others: Vec<String> = names.into_iter().filter(|name| is_of_stack(name)).collect();
    let addresses = addresses(&master, others.iter())?;
    let listed: Vec<(String, Address)> = others.into_iter().zip(addresses).collect();
    let known = of_each(&listed, |(name, address)| {
        let Address::At(uri) = address else { return None };
        let pid = process_of(uri);
        Some(Known { name: name.clone(), uri: uri.clone(), pid, stayed: false, began: None })
    });
    Ok(known.into_iter().flatten().flatten().collect())
}

/// A master that is asked again where it does not answer, as one does not whose queue was full for a
/// moment.
struct Patient {
    master: Master,
    left: Cell<Duration>,
}

impl Patient {
    fn new(uri: &str) -> Result<Patient, RosError> {
        Ok(Patient { master: Master::new(uri, CALLER, ASK)?, left: Cell::new(PATIENCE) })
    }

    fn ask<T>(&self, call: impl Fn(&Master) -> Result<T, RosError>) -> Result<T, RosError> {
        loop {
            let begun = Instant::now();
            let answer = call(&self.master);
            if !matches!(answer, Err(RosError::Unreachable { .. })) || self.left.get().is_zero() {
                return answer;
            }
            std::thread::sleep(AGAIN.saturating_sub(begun.elapsed()));
            self.left.set(self.left.get().saturating_sub(begun.elapsed()));
        }
    }
}

/// Where a node is, as its master has it.
enum Address {
    At(String),
    Unregistered,
}

/// Where each node is. The master is asked for one after another: rosmaster has a queue of five
/// connections, of which the kernel drops more until a second later.
fn addresses<'n>(
    master: &Patient,
    names: impl Iterator<Item = &'n String>,
) -> Result<Vec<Address>, RosError> {
    let ask = |name: &String| match master.ask(|master| master.lookup_node(name)) {
        Ok(uri) => Ok(Address::At(uri)),
        Err(RosError::Refused { .. }) => Ok(Address::Unregistered),
        Err(error) => Err(error),
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

/// Notes who is still there when all input is out, as it was: who leaves after that is done. Who did
/// not say its process is asked again, as one may have been busy.
///
/// # Errors
/// As [`roll`].
pub fn note_stayed(master_uri: &str, roll: &mut [Known]) -> Result<(), RosError> {
    let master = Patient::new(master_uri)?;
    let addresses = addresses(&master, roll.iter().map(|known| &known.name))?;
    for (known, address) in roll.iter_mut().zip(addresses) {
        known.stayed = matches!(address, Address::At(uri) if uri == known.uri);
    }
    // One that leaves while the master is busy may stay registered.
    let closed = of_each(roll, |known| known.stayed && is_closed(&known.uri, ASK));
    for (known, closed) in roll.iter_mut().zip(closed) {
        known.stayed &= closed != Some(true);
    }
    let asked = of_each(roll, |known| known.pid.or_else(|| process_of(&known.uri)));
    for (known, pid) in roll.iter_mut().zip(asked) {
        known.pid = pid.flatten();
    }
    Ok(())
}

fn registered(master: &Patient) -> Result<BTreeSet<String>, RosError> {
    let state = master.ask(Master::get_system_state)?;
    let topics = state.publishers.into_values().chain(state.subscribers.into_values());
    Ok(topics.flatten().collect())
}

/// What has become of each; the stack's processes are all below this one.
///
/// # Errors
/// As [`roll`].
pub fn look(master_uri: &str, roll: &[Known]) -> Result<Vec<Found>, RosError> {
    let master = Patient::new(master_uri)?;
    let addresses = addresses(&master, roll.iter().map(|known| &known.name))?;
    let listed: Vec<(&Known, Address)> = roll.iter().zip(addresses).collect();
    let found = of_each(&listed, |(known, address)| look_at(known, address));
    Ok(found.into_iter().map(|found| found.unwrap_or(Found::Same)).collect())
}

fn look_at(known: &Known, address: &Address) -> Found {
    let uri = match address {
        Address::At(uri) => uri,
        Address::Unregistered => return Found::Unregistered,
    };
    // A node in a namespace of its own gives a number that is another's here.
    let lives = |pid| is_alive(pid) && stack().contains(&pid);
    let answer = pid_of(uri);
    let is_silent = answer.is_err();
    match (of_the_node(answer, known), known.pid) {
        (Some(pid), Some(before)) if pid != before => Found::Another,
        (Some(_), _) if *uri != known.uri => Found::Another,
        (Some(_), _) => Found::Same,
        // One that hangs still has its socket: that is for the ledger to say. One that leaves while the master is
        // busy may stay registered.
        (None, Some(pid)) if *uri == known.uri && lives(pid) => match is_closed(uri, ASK) {
            true => Found::Unregistered,
            false => Found::Same,
        },
        (None, None) if *uri == known.uri && is_silent && !is_closed(uri, ASK) => Found::Same,
        (None, _) => Found::Unreachable,
    }
}

/// Who answers in the node's name: where one ended, the kernel may have given its port to
/// a node of another slot.
fn of_the_node(answer: Result<i32, RosError>, known: &Known) -> Option<i32> {
    answer.ok().filter(|pid| known.pid == Some(*pid) || stack().contains(pid))
}

/// The stack's processes, and what else is below this one.
fn stack() -> BTreeSet<i32> {
    descendants(std::process::id(), &[])
}

/// The process that answers there, if it is none of ours: the player answers, and the master, so that
/// a node that gives the address of either as its own would live as long as they do.
fn process_of(uri: &str) -> Option<i32> {
    pid_of(uri).ok().filter(|pid| u32::try_from(*pid) != Ok(std::process::id()))
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

    /// How long a master may take to answer the tests' own calls.
    const REGISTER: Duration = Duration::from_secs(20);

    #[test]
    fn a_node_that_gives_an_address_of_the_agent_as_its_own_is_not_kept_alive_by_it() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let liar = Master::new(served.uri(), "/liar", REGISTER).unwrap();
        liar.register_publisher("/t", "std_msgs/String", served.uri()).unwrap();
        let known = roll(served.uri()).unwrap();
        assert_eq!(known.len(), 1);
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Unreachable]);
    }

    #[test]
    fn nodes_that_do_not_answer_are_waited_for_together() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        // The kernel takes connections, and nobody reads them.
        let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", mute.local_addr().unwrap());
        for number in 0..24 {
            let node = Master::new(served.uri(), &format!("/mute{number}"), REGISTER).unwrap();
            node.register_publisher("/t", "std_msgs/String", &uri).unwrap();
        }
        let begun = Instant::now();
        let known = roll(served.uri()).unwrap();
        let found = look(served.uri(), &known).unwrap();
        assert!(begun.elapsed() < 12 * ASK, "{:?}", begun.elapsed());
        // They have their sockets.
        assert_eq!((known.len(), found), (24, vec![Found::Same; 24]));
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
            let node = Master::new(served.uri(), &format!("/node{number}"), REGISTER).unwrap();
            node.register_publisher("/t", "std_msgs/String", served.uri()).unwrap();
        }
        let address = served.uri().trim_start_matches("http://").trim_end_matches('/');
        let (uri, most) = counted(address.to_owned());
        let known = roll(&uri).unwrap();
        assert_eq!((known.len(), look(&uri, &known).unwrap().len()), (40, 40));
        assert_eq!(most.load(Ordering::SeqCst), 1);
    }

    #[test]
    fn where_a_master_does_not_answer_nobody_knows_which_nodes_there_are() {
        let mute = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", mute.local_addr().unwrap());
        let of = |number| Known {
            name: format!("/node{number}"),
            uri: String::new(),
            pid: None,
            stayed: false,
            began: None,
        };
        let mut known: Vec<Known> = (0..3).map(of).collect();
        assert!(matches!(look(&uri, &known), Err(RosError::Unreachable { .. })));
        mute.set_nonblocking(true).unwrap();
        // Once, and again for four seconds.
        let asked = std::iter::from_fn(|| mute.accept().ok()).count();
        assert!((2..=5).contains(&asked), "{asked}");
        drop(mute);
        // Nobody listens, which is known at once: it may be about to come back.
        assert!(matches!(roll(&uri), Err(RosError::Unreachable { .. })));
        assert!(matches!(note_stayed(&uri, &mut known), Err(RosError::Unreachable { .. })));
    }

    /// The address of who passes calls on to a master, but keeps the first one of this method waiting.
    fn busy_once(master: String, method: &'static str) -> String {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", listener.local_addr().unwrap());
        std::thread::spawn(move || {
            let mut kept = Vec::new();
            for asking in listener.incoming() {
                let mut asking = asking.unwrap();
                let request = message(&mut asking);
                if kept.is_empty() && String::from_utf8_lossy(&request).contains(method) {
                    kept.push(asking);
                    continue;
                }
                let mut asked = TcpStream::connect(&master).unwrap();
                asked.write_all(&request).unwrap();
                asking.write_all(&message(&mut asked)).unwrap();
            }
        });
        uri
    }

    #[test]
    fn a_master_that_is_busy_for_a_moment_hides_no_node() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        for number in 0..3 {
            let node = Master::new(served.uri(), &format!("/node{number}"), REGISTER).unwrap();
            node.register_publisher("/t", "std_msgs/String", served.uri()).unwrap();
        }
        let address = served.uri().trim_start_matches("http://").trim_end_matches('/');
        for method in ["getSystemState", "lookupNode"] {
            let mut known = roll(&busy_once(address.to_owned(), method)).unwrap();
            assert_eq!(known.len(), 3, "{method}");
            note_stayed(&busy_once(address.to_owned(), method), &mut known).unwrap();
            assert!(known.iter().all(|known| known.stayed), "{method}");
            let found = look(&busy_once(address.to_owned(), method), &known).unwrap();
            assert_eq!(found, [Found::Unreachable; 3], "{method}");
        }
    }

    #[test]
    fn a_node_that_lives_without_its_address_has_left_and_one_that_hangs_has_not() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let node = Master::new(served.uri(), "/node", REGISTER).unwrap();
        // The kernel takes connections, and nobody reads them.
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", listener.local_addr().unwrap());
        node.register_publisher("/t", "std_msgs/String", &uri).unwrap();
        let mut process = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        let pid = i32::try_from(process.id()).ok();
        let known = [Known { name: "/node".to_owned(), uri, pid, stayed: true, began: None }];
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Same]);
        // More than its queue has room for.
        let kept: Vec<_> = (0..200)
            .map_while(|_| {
                let address = listener.local_addr().unwrap();
                TcpStream::connect_timeout(&address, Duration::from_millis(200)).ok()
            })
            .collect();
        assert!(kept.len() < 200);
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Same]);
        let stayed = |mut roll: [Known; 1]| {
            note_stayed(served.uri(), &mut roll).unwrap();
            roll[0].stayed
        };
        assert!(stayed(known.clone()));
        drop((listener, kept));
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Unregistered]);
        assert!(!stayed(known.clone()));
        process.kill().unwrap();
        process.wait().unwrap();
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Unreachable]);
    }

    #[test]
    fn a_node_of_another_namespace_is_gone_when_nobody_answers_though_its_number_lives() {
        let served = Rosmaster::serve((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        let uri = format!("http://{}/", listener.local_addr().unwrap());
        let node = Master::new(served.uri(), "/node", REGISTER).unwrap();
        node.register_publisher("/t", "std_msgs/String", &uri).unwrap();
        // In a namespace of processes of its own, as below `unshare --pid --fork`, it is 1.
        let lives = std::thread::spawn(move || {
            for _call in 0..2 {
                let mut asking = listener.accept().unwrap().0;
                message(&mut asking);
                let one = "<value><int>1</int></value>";
                let body = format!(
                    "<?xml version=\"1.0\"?><methodResponse><params><param><value><array><data>{one}\
                     <value><string></string></value>{one}</data></array></value></param></params>\
                     </methodResponse>"
                );
                let length = body.len();
                let head = format!("HTTP/1.1 200 OK\r\nContent-Length: {length}\r\n\r\n");
                asking.write_all((head + &body).as_bytes()).unwrap();
            }
        });
        let known = roll(served.uri()).unwrap();
        assert_eq!((known.len(), known[0].pid), (1, Some(1)));
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Same]);
        lives.join().unwrap();
        // Now its port refuses connections.
        assert_eq!(look(served.uri(), &known).unwrap(), [Found::Unreachable]);
    }
}
