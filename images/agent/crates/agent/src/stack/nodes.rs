//! The nodes that are there when the play begins, and what has become of them at its end.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// A node when the play began.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Known {
    pub name: String,
    /// Where it answers, or whatever else distinguishes it from one that takes its name later.
    pub uri: String,
    /// None where it did not say.
    pub pid: Option<i32>,
    /// Whether the graph still had it when all input was out; of one that had ended before the play, when that began:
    /// it took no leave.
    pub stayed: bool,
    /// When its process began, where that is known and several may have one name.
    pub began: Option<Instant>,
}

impl Known {
    fn is_of_process(&self, other: &Known) -> bool {
        (self.pid, &self.uri) == (other.pid, &other.uri)
    }
}

/// How much later an end may be noticed than it was, where the processes are being looked at or the machine is busy.
const NOTICED: Duration = Duration::from_secs(1);

/// What has become of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// It is there, as it was; or nobody could say.
    Same,
    /// The graph does not have it any more.
    Unregistered,
    /// The graph has it, and nobody answers.
    Unreachable,
    /// Another process has its name.
    Another,
}

/// The nodes of a case.
#[derive(Debug, Default)]
pub struct Nodes {
    /// Those that were there when the play began, and what has become of each.
    pub there: Vec<(Known, Found)>,
    pub before: Before,
}

/// Those of before the play.
#[derive(Debug, Default)]
pub struct Before {
    /// All that had come by its begin, with processes that are known, in their order.
    pub met: Vec<Known>,
    /// Who was there then.
    pub roll: Vec<Known>,
}

/// Those that the play began without: a node is there again where another process has its name that began when its own
/// had `ended`, and all of a process's nodes are where one of them is there again, and that process has as many. Where it
/// is not known when a process began, the later one is the other's successor.
pub fn absent(
    Before { met, roll }: &Before,
    ended: impl Fn(&Known) -> Option<Instant>,
) -> Vec<&Known> {
    let succeeds = |one: &Known, node: &Known| {
        let is_after = one.began.zip(ended(node)).is_none_or(|(began, end)| began + NOTICED >= end);
        one.name == node.name && !one.is_of_process(node) && is_after
    };
    let is_there =
        |node: &Known| roll.iter().any(|one| one.name == node.name && one.is_of_process(node));
    // Those that have left again count on both sides: one that serves for a moment has another name each time.
    let of_process = |node: &Known| {
        let all = met.iter().chain(roll).filter(|one| one.pid == node.pid);
        all.map(|one| one.name.as_str()).collect::<BTreeSet<&str>>().len()
    };
    let has_successor =
        |at: usize, node: &Known| roll.iter().chain(&met[at + 1..]).any(|one| succeeds(one, node));
    let is_back = |node: &Known| {
        let mut own = met.iter().filter(|one| one.is_of_process(node));
        own.any(|own| {
            let mut successors = roll.iter().filter(|one| succeeds(one, own));
            successors.any(|one| of_process(one) >= of_process(node))
        })
    };
    let gone = met.iter().enumerate().filter(|(at, node)| !has_successor(*at, node));
    gone.map(|(_, node)| node).filter(|node| !is_there(node) && !is_back(node)).collect()
}

/// The processes of nodes that have left the graph, without those that other nodes still live in.
pub fn left(roll: &[Known], found: &[Found]) -> BTreeSet<i32> {
    let of = |gone: bool| {
        let is_gone = |found: &Found| matches!(found, Found::Unregistered | Found::Unreachable);
        let nodes = roll.iter().zip(found).filter(move |(_, found)| is_gone(found) == gone);
        nodes.filter_map(|(node, _)| node.pid).collect::<BTreeSet<i32>>()
    };
    &of(true) - &of(false)
}

/// What has become of nodes by a later look: one that had gone by the first stays gone, also where
/// its launcher has started it again.
pub fn later(found: Vec<Found>, again: Vec<Found>) -> Vec<Found> {
    let either = |(first, then)| if first == Found::Same { then } else { first };
    found.into_iter().zip(again).map(either).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_process_is_left_once_none_of_its_nodes_is_there() {
        let node = |pid: i32| Known {
            name: format!("/node{pid}"),
            uri: String::new(),
            pid: Some(pid),
            stayed: true,
            began: None,
        };
        let roll = [node(4), node(5), node(5), node(6), node(7), Known { pid: None, ..node(8) }];
        let found = [
            Found::Same,
            Found::Unregistered,
            Found::Same,
            Found::Unregistered,
            Found::Unreachable,
            Found::Unregistered,
        ];
        assert_eq!(left(&roll, &found), BTreeSet::from([6, 7]));
        // Of one that was replaced nothing is left to wait for.
        assert_eq!(left(&roll[..1], &[Found::Another]), BTreeSet::new());
    }

    #[test]
    fn a_later_look_finds_who_has_gone_since() {
        let first = vec![Found::Same, Found::Same, Found::Unregistered];
        let again = vec![Found::Same, Found::Unregistered, Found::Another];
        assert_eq!(later(first, again), [Found::Same, Found::Unregistered, Found::Unregistered]);
    }

    fn known(name: &str, pid: i32) -> Known {
        Known {
            name: name.to_owned(),
            uri: String::new(),
            pid: Some(pid),
            stayed: false,
            began: None,
        }
    }

    /// Of which of these nodes the play began without.
    fn names(met: &[Known], roll: &[Known]) -> Vec<(String, Option<i32>)> {
        let before = Before { met: met.to_vec(), roll: roll.to_vec() };
        let all = absent(&before, |_| None);
        all.into_iter().map(|node| (node.name.clone(), node.pid)).collect()
    }

    fn named(name: &str, pid: i32) -> (String, Option<i32>) {
        (name.to_owned(), Some(pid))
    }

    #[test]
    fn who_had_left_is_not_absent_once_it_is_back_or_another_process_of_it_is_done() {
        let (first, second) = (known("/spawner", 4), known("/spawner", 5));
        assert_eq!(names(&[first.clone(), second], &[]), [named("/spawner", 5)]);
        let there = [known("/spawner", 6)];
        assert_eq!(names(&[first.clone(), known("/other", 7)], &there), [named("/other", 7)]);
        // Those that are there were met as well, with other addresses.
        let address = Known { uri: "http://127.0.0.1:1/".to_owned(), ..known("/spawner", 4) };
        assert_eq!(names(&[first], &[address]), []);
    }

    #[test]
    fn a_process_is_back_that_has_as_many_nodes_of_which_one_has_a_name_of_before() {
        let met = [known("/spawner", 4), known("/listener_55aa", 4)];
        let there = [known("/spawner", 6), known("/listener_77bb", 6)];
        assert_eq!(names(&met, &there), []);
        // Of the successor, too, one has left again, which is nothing as long as that process lives.
        let again = [&met[..], &[known("/listener_77bb", 6)]].concat();
        assert_eq!(names(&again, &there[..1]), [named("/listener_77bb", 6)]);
        // A container that comes back without its node.
        assert_eq!(names(&met, &there[..1]), [named("/listener_55aa", 4)]);
        assert_eq!(names(&met[1..], &there), [named("/listener_55aa", 4)]);
    }

    #[test]
    fn of_two_processes_of_one_name_at_once_neither_succeeds_the_other() {
        let (zero, seconds) = (Instant::now(), Duration::from_secs);
        let at = |pid: i32, began: u64| Known {
            began: Some(zero + seconds(began)),
            ..known("/spawner", pid)
        };
        let met = [at(4, 1), at(5, 2), at(6, 31)];
        let ended = |pid: Option<i32>| match pid {
            Some(4) => Some(zero + seconds(30)),
            Some(5) => Some(zero + seconds(3)),
            _ => None,
        };
        let pids = |met: &[Known], roll: &[Known]| -> Vec<Option<i32>> {
            let before = Before { met: met.to_vec(), roll: roll.to_vec() };
            absent(&before, |one| ended(one.pid)).into_iter().map(|one| one.pid).collect()
        };
        assert_eq!(pids(&met[..2], &[]), [Some(4), Some(5)]);
        assert_eq!(pids(&met[..2], &met[1..2]), [Some(4)], "the younger one is there");
        assert_eq!(pids(&met, &[]), [Some(6)]);
        assert_eq!(pids(&met, &met[2..]), []);
    }
}
