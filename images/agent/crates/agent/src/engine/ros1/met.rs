//! Nodes that register before the play begins, with their processes: one that ends at once has no address to be asked at.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use bagpipe_ros1::Meet;

use crate::engine::ros1::names::is_of_stack;
use crate::stack::nodes::Known;
use crate::stack::processes::{holder, is_alive};
use crate::stack::witness::Watcher;

/// Nodes that are noted at the most: whoever registers more under names of its own is no stack.
const MOST: usize = 4096;

/// Those of a case.
#[derive(Clone, Default)]
pub struct Met(Arc<Mutex<Noted>>);

#[derive(Default)]
struct Noted {
    nodes: Vec<Known>,
    /// Who comes from now on is not noted.
    is_over: bool,
    watcher: Option<Watcher>,
}

impl Met {
    fn noted(&self) -> MutexGuard<'_, Noted> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has each that comes from now on watched, before its registration is answered: one may end at once after that.
    pub fn watch_by(&self, watcher: Watcher) {
        self.noted().watcher = Some(watcher);
    }

    /// What a master calls for each node that registers.
    pub fn note(&self) -> Box<Meet> {
        let met = self.clone();
        Box::new(move |name, socket| met.add(name, socket))
    }

    fn add(&self, name: &str, socket: u32) {
        if !is_of_stack(name) || self.noted().is_full() {
            return;
        }
        // Without the lock: it looks at each process of the stack, the newest first.
        let Some(pid) = holder(socket) else { return };
        let watcher = self.noted().watcher.clone();
        watcher.iter().for_each(|watcher| watcher.watch(pid));
        let node = Known {
            name: name.to_owned(),
            uri: String::new(),
            pid: Some(pid),
            stayed: false,
            began: None,
        };
        self.noted().nodes.push(node);
    }

    /// Gives nodes that did not say it the process that has registered them last; one whose process has ended is not
    /// there, though the master has it: it took no leave.
    pub fn name_processes(&self, roll: &mut Vec<Known>) {
        let mut noted = self.noted();
        roll.retain_mut(|node| {
            if node.pid.is_some() {
                return true;
            }
            let mut latest = noted.nodes.iter_mut().rev();
            let Some(same) = latest.find(|met| met.name == node.name) else { return true };
            node.pid = same.pid;
            same.stayed = !node.pid.is_none_or(is_alive);
            !same.stayed
        });
    }

    /// All that have come by now; later ones are not noted.
    pub fn take(&self) -> Vec<Known> {
        let mut noted = self.noted();
        noted.is_over = true;
        std::mem::take(&mut noted.nodes)
    }
}

impl Noted {
    fn is_full(&self) -> bool {
        self.is_over || self.nodes.len() >= MOST
    }
}

#[cfg(test)]
mod tests {
    use std::net::Ipv4Addr;
    use std::time::Duration;

    use bagpipe_ros1::{Master, Rosmaster};

    use super::*;
    use crate::stack::processes::Spared;
    use crate::stack::witness::Witness;

    fn unnamed(name: &str) -> Known {
        let (name, uri) = (name.to_owned(), String::new());
        Known { name, uri, pid: None, stayed: false, began: None }
    }

    #[test]
    fn who_registers_before_the_play_is_noted_with_its_process() {
        let met = Met::default();
        let served = Rosmaster::serve_noting((Ipv4Addr::LOCALHOST, 0).into(), met.note()).unwrap();
        let register = |name: &str| {
            // Of this process, which is no process of a stack.
            let node = Master::new(served.uri(), name, Duration::from_secs(5)).unwrap();
            node.register_publisher("/t", "std_msgs/String", "http://127.0.0.1:1/").unwrap();
        };
        register("/ours");
        assert_eq!(met.take(), []);
        let met = Met::default();
        let witness = Witness::start(&Spared::default()).unwrap();
        let watcher = witness.watcher();
        // It looks for nobody any more.
        witness.finish();
        met.watch_by(watcher.clone());
        let program = "import sys, xmlrpc.client
node = xmlrpc.client.ServerProxy(sys.argv[1])
for name in sys.argv[2:]:
    node.registerPublisher(name, '/t', 'std_msgs/String', 'http://127.0.0.1:1/')
sys.exit(3)";
        let served = Rosmaster::serve_noting((Ipv4Addr::LOCALHOST, 0).into(), met.note()).unwrap();
        let run = |names: &[&str]| {
            let words = [&["-c", program, served.uri()], names].concat();
            let mut child =
                std::process::Command::new("/usr/bin/python3").args(words).spawn().unwrap();
            assert_eq!(child.wait().unwrap().code(), Some(3));
            i32::try_from(child.id()).unwrap()
        };
        let people = ["/rostopic_7_8", "/robot/rostopic_7_8", "/rosservice_7_8"];
        let pid = run(&[&["/a", "/a", "/b", "/bagpipe_player_7"][..], &people].concat());
        let before = [unnamed("/a"), unnamed("/c"), Known { pid: Some(7), ..unnamed("/b") }];
        let mut roll = before.to_vec();
        met.name_processes(&mut roll);
        assert_eq!(roll, before[1..], "its process has ended");
        let own = i32::try_from(std::process::id()).unwrap();
        met.noted().nodes.push(Known { pid: Some(own), ..unnamed("/c") });
        met.name_processes(&mut roll);
        assert_eq!(roll.iter().map(|one| one.pid).collect::<Vec<_>>(), [Some(own), Some(7)]);
        met.noted().nodes.pop();
        let noted = met.take();
        let named = noted.iter().map(|one| (one.name.as_str(), one.pid, one.stayed));
        // The master had /a when its process had ended.
        let expected = [("/a", Some(pid), true), ("/b", Some(pid), false)];
        assert_eq!(named.collect::<Vec<_>>(), expected);
        run(&["/late"]);
        assert_eq!(met.take(), []);
        assert!(watcher.watches(pid), "who registers is watched from then on");
    }
}
