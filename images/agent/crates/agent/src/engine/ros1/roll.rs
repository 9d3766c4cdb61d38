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
    let known = of_each(&others, |name| {
        let uri = master.lookup_node(name).ok()?;
        // The player answers, and the master: a node that gives the address of either as its own
        // would live as long as they do.
        let pid = pid_of(&uri).ok().filter(|pid| u32::try_from(*pid) != Ok(std::process::id()));
        Some(Known { name: name.clone(), uri, pid, stayed: false })
    });
    known.into_iter().flatten().flatten().collect()
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
    let found = of_each(roll, |known| look_at(&master, known));
    found.into_iter().map(|found| found.unwrap_or(Found::Same)).collect()
}

fn look_at(master: &Master, known: &Known) -> Found {
    let uri = match master.lookup_node(&known.name) {
        Ok(uri) => uri,
        Err(RosError::Refused { .. }) => return Found::Unregistered,
        Err(_) => return Found::Same,
    };
    match (answering(&uri, known), known.pid) {
        (Some(pid), Some(before)) if pid != before => Found::Another,
        (Some(_), _) if uri != known.uri => Found::Another,
        (Some(_), _) => Found::Same,
        // One that hangs still has its socket: that is for the ledger to say.
        (None, Some(pid)) if is_alive(pid) && uri == known.uri => Found::Same,
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
    use std::net::{Ipv4Addr, TcpListener};
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
}
