//! Which publishers of a topic count that the graph has: by their GIDs, which are exact, or else by their nodes'
//! names, of which several may be the same.

use bagpipe_ros2player::GraphPublisher;

/// A publisher of a topic that the ledger has.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Known<'e> {
    /// Its node's whole name.
    pub(crate) node: &'e str,
    /// The GID by which the graph has it, where that is known.
    pub(crate) gid: Option<[u8; 16]>,
    /// Whether it has published.
    pub(crate) has_published: bool,
    /// Whether its node has destroyed it.
    pub(crate) destroyed: bool,
    /// Whether its node has it and runs: the graph has those of a killed one for a while.
    pub(crate) is_there: bool,
}

/// The publishers of a topic that the graph shows, by whose they are.
#[derive(Debug)]
pub(crate) struct Owners<'s, 'e> {
    /// Those that the ledger has by their GIDs, each with what it has of it.
    pub(crate) known: Vec<(&'s GraphPublisher, Known<'e>)>,
    /// Those whose GIDs it does not have.
    pub(crate) rest: Vec<&'s GraphPublisher>,
    /// Those that it has without a GID and that are there: as many of the rest may be these.
    pub(crate) without: Vec<Known<'e>>,
}

/// Whose each is that the graph shows, by the GIDs; `None` where these are not known: the graph has one without, or the
/// ledger has none. One without a GID that is destroyed or has ended makes room for nobody.
pub(crate) fn by_gid<'s, 'e>(
    shown: &'s [GraphPublisher],
    known: &[Known<'e>],
) -> Option<Owners<'s, 'e>> {
    let has_none = known.iter().all(|one| one.gid.is_none());
    if shown.iter().any(|one| one.gid.is_none())
        || (has_none && known.iter().any(|one| !one.destroyed))
    {
        return None;
    }
    let is_without = |one: &&Known<'_>| one.gid.is_none() && !one.destroyed && one.is_there;
    let without = known.iter().filter(is_without).copied().collect();
    let mut owners = Owners { known: Vec::new(), rest: Vec::new(), without };
    for one in shown {
        match known.iter().find(|known| known.gid == one.gid) {
            Some(owner) => owners.known.push((one, *owner)),
            None => owners.rest.push(one),
        }
    }
    Some(owners)
}

/// Whether the ledger has each that the graph shows, by their number where a GID is not known.
pub(crate) fn are_listed(shown: &[GraphPublisher], known: &[Known<'_>]) -> bool {
    match by_gid(shown, known) {
        Some(owners) => owners.rest.len() <= owners.without.len(),
        None => shown.len() <= known.iter().filter(|one| one.is_there).count(),
    }
}

/// How many do not count, beside the nodes that are `named` for it: programs that are no nodes, and nodes of a name
/// that another has, by which the graph does not show them. `None` if no GIDs are known.
pub(crate) fn unnamed(
    shown: &[GraphPublisher],
    known: &[Known<'_>],
    named: &[String],
) -> Option<u64> {
    let Owners { rest, without, .. } = by_gid(shown, known)?;
    let is_hidden = |one: &&&GraphPublisher| one.node.as_ref().is_none_or(|of| !named.contains(of));
    let hidden = rest.iter().filter(is_hidden).count();
    Some(hidden.saturating_sub(without.len()) as u64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shown(node: &str, gid: Option<u8>) -> GraphPublisher {
        GraphPublisher {
            node: (!node.is_empty()).then(|| node.to_owned()),
            datatype: "A".to_owned(),
            gid: gid.map(|byte| [byte; 16]),
        }
    }

    /// Of a node that runs.
    fn known(node: &str, gid: Option<u8>) -> Known<'_> {
        let gid = gid.map(|byte| [byte; 16]);
        Known { node, gid, has_published: true, destroyed: false, is_there: true }
    }

    #[test]
    fn who_counts_is_known_by_the_gid_whatever_the_graph_has_of_its_name() {
        let (graph, ledger) = (
            [shown("", Some(1)), shown("/a", Some(2))],
            [known("/a", Some(1)), known("/b", Some(3))],
        );
        let owners = by_gid(&graph, &ledger).unwrap();
        let nodes: Vec<_> = owners.known.iter().map(|(_, known)| known.node).collect();
        assert_eq!((nodes, owners.rest), (vec!["/a"], vec![&graph[1]]));
        assert!(owners.without.is_empty());
    }

    #[test]
    fn who_is_listed_is_known_by_gids_or_else_by_their_number() {
        let graph = [shown("/a", Some(1)), shown("/b", Some(2))];
        let (one, other, third) =
            (known("/a", Some(1)), known("/b", Some(2)), known("/c", Some(3)));
        assert!(are_listed(&graph, &[one, third, other]));
        assert!(!are_listed(&graph, &[one, third]));
        let unknown = Known { gid: None, ..third };
        assert!(are_listed(&graph, &[one, unknown]));
        assert!(!are_listed(&graph, &[unknown]));
        assert!(are_listed(&graph, &[unknown, unknown]));
        let ended = Known { is_there: false, ..unknown };
        assert!(!are_listed(&graph, &[one, ended]));
        assert!(!are_listed(&graph, &[unknown, ended]));
        assert!(are_listed(&[], &[]));
    }

    #[test]
    fn without_gids_in_the_graph_or_the_ledger_nothing_is_known() {
        let (with, without) = ([known("/a", Some(1))], [known("/a", None), known("/b", None)]);
        assert!(by_gid(&[shown("/a", Some(1))], &with).is_some());
        assert!(by_gid(&[shown("/a", Some(1))], &without).is_none());
        assert!(by_gid(&[shown("/a", Some(1)), shown("/b", None)], &with).is_none());
        assert_eq!(unnamed(&[shown("", Some(2))], &without, &[]), None);
    }

    #[test]
    fn one_without_a_gid_makes_room_for_one_and_only_while_it_is_there() {
        let killed = Known { is_there: false, ..known("/a", Some(2)) };
        let there = known("/b", None);
        let destroyed = Known { destroyed: true, is_there: false, ..there };
        let ended = Known { is_there: false, ..there };
        let graph = [shown("/a", Some(1)), shown("/c", Some(9))];
        let hidden = |one: Known<'_>| unnamed(&graph, &[known("/a", Some(1)), killed, one], &[]);
        assert_eq!(hidden(destroyed), Some(1));
        assert_eq!(hidden(ended), Some(1));
        assert_eq!(hidden(there), Some(0));
        // Nor does one that is destroyed switch off the GIDs of the others.
        assert_eq!(unnamed(&graph, &[destroyed], &[]), Some(2));
    }

    #[test]
    fn hidden_are_programs_and_nodes_that_the_graph_does_not_show_by_their_names() {
        let gone = Known { destroyed: true, is_there: false, ..known("/a", Some(2)) };
        let (ledger, named) = ([known("/a", Some(1)), gone], ["/b".to_owned()]);
        let hidden = |all: &[(&str, u8)], ledger: &[Known<'_>]| {
            let graph: Vec<_> = all.iter().map(|(node, gid)| shown(node, Some(*gid))).collect();
            unnamed(&graph, ledger, &named)
        };
        assert_eq!(hidden(&[], &ledger), Some(0));
        assert_eq!(hidden(&[("/a", 1), ("", 2)], &ledger), Some(0));
        assert_eq!(hidden(&[("/a", 1), ("/b", 3)], &ledger), Some(0));
        assert_eq!(hidden(&[("/a", 3), ("", 4), ("", 5), ("/b", 6)], &ledger), Some(3));
        // Of two of a name the graph may show what the other has.
        assert_eq!(hidden(&[("/a", 3)], &[]), Some(1));
    }
}
