//! The nodes that are there when the play begins, and what has become of them at its end.

use std::collections::BTreeSet;

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
}

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
    /// Those that had left by then.
    pub absent: Vec<Known>,
}

/// Those of the nodes that were `met`, in their order, that had left when the play began: not those of a process of which a
/// node was there again by then, and of several processes of one name the last.
pub fn absent(met: &[Known], roll: &[Known]) -> Vec<Known> {
    let is_there = |node: &Known| roll.iter().any(|known| known.name == node.name);
    let same_process =
        |node: &Known, other: &Known| (node.pid, &node.uri) == (other.pid, &other.uri);
    let is_back =
        |node: &Known| met.iter().any(|other| same_process(node, other) && is_there(other));
    let last = |(at, node): &(usize, &Known)| met[at + 1..].iter().all(|one| one.name != node.name);
    let gone = met.iter().enumerate().filter(last).map(|(_, node)| node);
    gone.filter(|node| !is_back(node)).cloned().collect()
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

    #[test]
    fn who_had_left_is_not_absent_once_it_is_back_or_another_process_of_it_is_done() {
        let known = |name: &str, pid: i32| Known {
            name: name.to_owned(),
            uri: String::new(),
            pid: Some(pid),
            stayed: false,
        };
        let (first, second) = (known("/spawner", 4), known("/spawner", 5));
        assert_eq!(absent(&[first.clone(), second.clone()], &[]), [second]);
        let listener = known("/listener_55aa", 4);
        let there = [Known { pid: Some(6), ..first.clone() }];
        assert_eq!(absent(&[first.clone(), listener.clone()], &there), []);
        assert_eq!(absent(&[first, known("/other", 7)], &there), [known("/other", 7)]);
        let alone = [listener];
        assert_eq!(absent(&alone, &there), alone);
    }
}
