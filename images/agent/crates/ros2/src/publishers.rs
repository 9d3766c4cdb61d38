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

/// Of each that the graph shows, which one of the ledger it is; `None` if a GID is not known.
pub(crate) fn by_gid<'k, 'e>(
    shown: &[GraphPublisher],
    known: &'k [Known<'e>],
) -> Option<Vec<Option<&'k Known<'e>>>> {
    let all =
        known.iter().all(|one| one.gid.is_some()) && shown.iter().all(|one| one.gid.is_some());
    let owner = |one: &GraphPublisher| known.iter().find(|known| known.gid == one.gid);
    all.then(|| shown.iter().map(owner).collect())
}

/// Whether the ledger has each that the graph shows, by their number where a GID is not known.
pub(crate) fn are_listed(shown: &[GraphPublisher], known: &[Known<'_>]) -> bool {
    match by_gid(shown, known) {
        Some(owners) => owners.iter().all(Option::is_some),
        None => shown.len() <= known.len(),
    }
}

/// How many do not count, beside the nodes that are `named` for it: programs that are no nodes, and nodes of a name
/// that another has, by which the graph does not show them. `None` if a GID is not known.
pub(crate) fn unnamed(
    shown: &[GraphPublisher],
    known: &[Known<'_>],
    named: &[String],
) -> Option<u64> {
    let owners = by_gid(shown, known)?;
    let strangers = shown.iter().zip(owners).filter(|(_, owner)| owner.is_none());
    let is_hidden = |one: &GraphPublisher| !one.node.as_ref().is_some_and(|of| named.contains(of));
    Some(strangers.filter(|(one, _)| is_hidden(one)).count() as u64)
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
        let owners = by_gid(&graph, &ledger).unwrap_or_default();
        let nodes: Vec<_> = owners.iter().map(|owner| owner.map(|known| known.node)).collect();
        assert_eq!(nodes, [Some("/a"), None]);
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
        assert!(are_listed(&[], &[]));
    }

    #[test]
    fn without_each_gid_nothing_is_known() {
        let (with, without) = ([known("/a", Some(1))], [known("/a", Some(1)), known("/b", None)]);
        assert!(by_gid(&[shown("/a", Some(1))], &with).is_some());
        assert!(by_gid(&[shown("/a", Some(1))], &without).is_none());
        assert!(by_gid(&[shown("/a", Some(1)), shown("/b", None)], &with).is_none());
        assert_eq!(unnamed(&[shown("", Some(2))], &without, &[]), None);
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
