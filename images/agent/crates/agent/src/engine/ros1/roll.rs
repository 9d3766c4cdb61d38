//! The nodes that the ROS master knows when the play begins, and what has become of them at its
//! end, whatever roslaunch says.

use std::collections::BTreeSet;
use std::time::Duration;

use bagpipe_ros1::{Master, RosError};

use crate::stack::nodes::{Found, Known};
use crate::stack::processes::{descendants, is_alive};

/// A node on this machine answers within milliseconds.
const ASK: Duration = Duration::from_secs(1);
const CALLER: &str = "/bagpipe_agent";
/// Our own node in the graph.
const PLAYER: &str = "/bagpipe_player_";

/// All nodes but our own. A master that does not answer fails the replay, so no error is
/// reported here.
pub fn roll(master_uri: &str) -> Vec<Known> {
    let Ok(master) = Master::new(master_uri, CALLER, ASK) else { return Vec::new() };
    let names = registered(&master);
    let ours = |name: &String| name.starts_with(PLAYER);
    let known = names.into_iter().filter(|name| !ours(name)).filter_map(|name| {
        let uri = master.lookup_node(&name).ok()?;
        // The player answers, and the master: a node that gives the address of either as its own
        // would live as long as they do.
        let pid = pid_of(&uri).ok().filter(|pid| u32::try_from(*pid) != Ok(std::process::id()));
        Some(Known { name, uri, pid, stayed: false })
    });
    known.collect()
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
    roll.iter().map(|known| look_at(&master, known)).collect()
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
    use std::net::Ipv4Addr;

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
}
