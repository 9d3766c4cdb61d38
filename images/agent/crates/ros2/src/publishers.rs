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

/// How many do not count, and are not named for it: programs that are no nodes, and nodes of a name that one has
/// that counts. `None` if a GID is not known.
pub(crate) fn unnamed(shown: &[GraphPublisher], known: &[Known<'_>]) -> Option<u64> {
    let owners = by_gid(shown, known)?;
    let is_hidden = |one: &GraphPublisher| {
        one.node.as_deref().is_none_or(|node| known.iter().any(|known| known.node == node))
    };
    let strangers = shown.iter().zip(owners).filter(|(_, owner)| owner.is_none());
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
    fn without_each_gid_nothing_is_known() {
        let (with, without) = ([known("/a", Some(1))], [known("/a", Some(1)), known("/b", None)]);
        assert!(by_gid(&[shown("/a", Some(1))], &with).is_some());
        assert!(by_gid(&[shown("/a", Some(1))], &without).is_none());
        assert!(by_gid(&[shown("/a", Some(1)), shown("/b", None)], &with).is_none());
        assert_eq!(unnamed(&[shown("", Some(2))], &without), None);
    }

    #[test]
    fn hidden_are_programs_and_nodes_of_a_name_that_counts() {
        let ledger = [known("/a", Some(1)), known("/a", Some(2))];
        let hidden = |all: &[(&str, u8)]| {
            let graph: Vec<_> = all.iter().map(|(node, gid)| shown(node, Some(*gid))).collect();
            unnamed(&graph, &ledger)
        };
        assert_eq!(hidden(&[]), Some(0));
        assert_eq!(hidden(&[("/a", 1), ("", 2)]), Some(0));
        // Who is named by the graph and counts nowhere is reported by that name.
        assert_eq!(hidden(&[("/a", 1), ("/b", 3)]), Some(0));
        assert_eq!(hidden(&[("/a", 3), ("", 4), ("", 5), ("/b", 6)]), Some(3));
    }
}
