//! Who publishes a recorded topic as another type than the recorded one: it reaches no recorder of that.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use bagpipe_ros2player::{GraphPublisher, GraphTypes};

use crate::publishers::{Known, Owners, by_gid};
use crate::unnamed::Unnamed;

/// As which types the graph has each topic.
pub(crate) type Types = BTreeMap<String, GraphTypes>;

/// Those of a topic at one look.
#[derive(Debug, Default, PartialEq, Eq)]
pub(crate) struct Differing {
    /// Nodes that count and have published, each with the type that it publishes.
    pub(crate) counting: BTreeSet<(String, String)>,
    /// How many do not count.
    pub(crate) uncounted: u64,
    /// The types of these; where no GIDs are known, of those that count too.
    pub(crate) types: BTreeSet<String>,
}

/// Takes from the publishers of a topic, but our own, those of another type than `recorded`.
pub(crate) fn differing(
    shown: &[GraphPublisher],
    recorded: &str,
    known: &[Known<'_>],
) -> Differing {
    let Some(Owners { known: owned, rest, without }) = by_gid(shown, known) else {
        return by_name(shown.iter(), recorded, known);
    };
    // Of those whose GIDs the ledger lacks as many count as it has without one.
    let mut found = by_name(rest.into_iter(), recorded, &without);
    for (one, owner) in owned {
        if one.datatype != recorded && owner.has_published {
            found.counting.insert((owner.node.to_owned(), one.datatype.clone()));
        }
    }
    found
}

/// The same where the graph's GIDs are not those of the ledger: there are no fewer.
fn by_name<'s>(
    shown: impl Iterator<Item = &'s GraphPublisher>,
    recorded: &str,
    known: &[Known<'_>],
) -> Differing {
    let mut found = Differing::default();
    let mut by_node: BTreeMap<Option<&str>, Vec<&str>> = BTreeMap::new();
    for one in shown {
        by_node.entry(one.node.as_deref()).or_default().push(&one.datatype);
    }
    let many = |node: Option<&str>| by_node.get(&node).map_or(0, |all| all.len() as u64);
    let nodes: BTreeSet<&str> = known.iter().map(|one| one.node).collect();
    let count = |node: &str, is: fn(&Known<'_>) -> bool| {
        known.iter().filter(|one| one.node == node && is(one)).count() as u64
    };
    // A publisher that counts has no node's name in the graph for a moment.
    let missing = |node: &&str| count(node, |one| one.is_there).saturating_sub(many(Some(node)));
    let more = many(None).saturating_sub(nodes.iter().map(missing).sum());
    for (node, types) in &by_node {
        let listed = |node| count(node, |one| !one.destroyed);
        let uncounted = node.map_or(more, |node| (types.len() as u64).saturating_sub(listed(node)));
        let others: Vec<&str> = types.iter().copied().filter(|of| *of != recorded).collect();
        found.uncounted += uncounted.min(others.len() as u64);
        found.types.extend(others.iter().map(|&of| of.to_owned()));
        if let (Some(node), Some(first)) = (node, others.first())
            && others.len() as u64 > uncounted
            && count(node, |one| one.has_published) > 0
        {
            found.counting.insert(((*node).to_owned(), (*first).to_owned()));
        }
    }
    found
}

/// The type that a topic is recorded as, of those of its publishers but our own: a node's before another's.
pub(crate) fn chosen(publishers: &[GraphPublisher]) -> Option<&str> {
    let first = publishers.iter().min_by_key(|one| (one.node.is_none(), &one.datatype));
    first.map(|one| &*one.datatype)
}

/// Those of a recorded topic that do not count, during a play.
#[derive(Debug, Default)]
pub(crate) struct OtherTypes(Mutex<Seen>);

#[derive(Debug, Default)]
struct Seen {
    publishers: Unnamed,
    types: BTreeSet<String>,
}

impl OtherTypes {
    /// What was seen before the play matters no more.
    pub(crate) fn begin(&self) {
        *self.seen() = Seen::default();
    }

    /// Takes in a look at a moment, if the last one is not just over.
    pub(crate) fn look(&self, now: Instant, differing: impl FnOnce() -> Differing) {
        let mut seen = self.seen();
        let Seen { publishers, types } = &mut *seen;
        publishers.look(now, || {
            let found = differing();
            if found.uncounted > 0 {
                types.extend(found.types);
            }
            found.uncounted
        });
    }

    /// What is missing in the recording of a topic, as a sentence.
    pub(crate) fn lacking(&self, topic: &str, recorded: &str) -> Option<String> {
        let seen = self.seen();
        let many = seen.publishers.seen();
        let types: Vec<&str> = seen.types.iter().map(String::as_str).collect();
        (many > 0).then(|| {
            format!(
                "{topic} has publishers (at least {many}) that do not count and publish it as {}, and it is recorded \
                 as {recorded}: a topic has one type",
                types.join(" and as ")
            )
        })
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    fn shown(publishers: &[(&str, &str)]) -> Vec<GraphPublisher> {
        let one = |&(node, datatype): &(&str, &str)| GraphPublisher {
            node: (!node.is_empty()).then(|| node.to_owned()),
            datatype: datatype.to_owned(),
            gid: None,
        };
        publishers.iter().map(one).collect()
    }

    fn known(node: &str) -> Known<'_> {
        Known { node, gid: None, has_published: true, destroyed: false, is_there: true }
    }

    /// Who counts, and how many do not, where A is recorded.
    fn found(publishers: &[(&str, &str)], counting: &[(&str, u64)]) -> (Vec<String>, u64) {
        let counting =
            counting.iter().flat_map(|&(node, many)| (0..many).map(move |_| known(node)));
        named(differing(&shown(publishers), "A", &counting.collect::<Vec<_>>()))
    }

    fn named(found: Differing) -> (Vec<String>, u64) {
        let counting = found.counting.into_iter().map(|(node, of)| format!("{node} {of}"));
        (counting.collect(), found.uncounted)
    }

    fn none(uncounted: u64) -> (Vec<String>, u64) {
        (Vec::new(), uncounted)
    }

    #[test]
    fn of_one_type_nobody_differs() {
        assert_eq!(found(&[], &[]), none(0));
        assert_eq!(found(&[("/a", "A"), ("/b", "A"), ("", "A")], &[("/a", 1)]), none(0));
    }

    #[test]
    fn who_counts_is_named_with_its_type() {
        let all = [("/a", "A"), ("/b", "B"), ("/c", "C"), ("/c", "C")];
        let counting = [("/a", 1), ("/b", 1), ("/c", 2)];
        assert_eq!(found(&all, &counting), (vec!["/b B".to_owned(), "/c C".to_owned()], 0));
    }

    #[test]
    fn who_has_a_name_that_another_has_and_does_not_count_is_one_more_than_the_ledger_has() {
        assert_eq!(found(&[("/a", "A"), ("/a", "B")], &[("/a", 1)]), none(1));
        assert_eq!(found(&[("/a", "B"), ("/a", "B")], &[("/a", 1)]), (vec!["/a B".to_owned()], 1));
        // Which of them is of the other type can't be known.
        assert_eq!(found(&[("/a", "A"), ("/a", "A"), ("/a", "B")], &[("/a", 1)]), none(1));
        // One that is in the graph no more is in the ledger until it is destroyed.
        assert_eq!(found(&[("/a", "B")], &[("/a", 2)]), (vec!["/a B".to_owned()], 0));
    }

    #[test]
    fn who_has_no_name_may_be_one_that_counts() {
        assert_eq!(found(&[("/a", "A"), ("", "B")], &[("/a", 1)]), none(1));
        assert_eq!(found(&[("", "A"), ("", "B")], &[("/a", 1), ("/b", 1)]), none(0));
        assert_eq!(found(&[("", "B"), ("", "C"), ("", "A")], &[("/a", 1)]), none(2));
    }

    #[test]
    fn who_was_killed_makes_room_for_nobody_that_has_no_name() {
        let counting = [known("/a"), Known { is_there: false, ..known("/a") }];
        let found = differing(&shown(&[("/a", "A"), ("", "B")]), "A", &counting);
        assert_eq!(named(found), none(1));
        // Nor one of its name who has destroyed it.
        let counting = [known("/a"), Known { destroyed: true, ..counting[1] }];
        let found = differing(&shown(&[("/a", "A"), ("/a", "B")]), "A", &counting);
        assert_eq!(named(found), none(1));
    }

    #[test]
    fn who_has_published_nothing_is_not_named() {
        let silent = [Known { has_published: false, ..known("/a") }];
        assert_eq!(named(differing(&shown(&[("/a", "B")]), "A", &silent)), none(0));
        let both = [silent[0], known("/a")];
        let of_names = vec!["/a B".to_owned()];
        assert_eq!(named(differing(&shown(&[("/a", "B")]), "A", &both)), (of_names, 0));
    }

    #[test]
    fn by_their_gids_who_counts_and_who_does_not_is_known_one_by_one() {
        let gid = |one: u8| Some([one; 16]);
        let mut graph = shown(&[("/a", "A"), ("/a", "B"), ("", "C"), ("/b", "D"), ("/c", "A")]);
        (1..).zip(&mut graph).for_each(|(number, one)| one.gid = gid(number));
        // A killed one of a name makes no room for another, and one without a name may count.
        let killed = Known { gid: gid(9), is_there: false, ..known("/a") };
        // One that is destroyed counts as long as the graph still has it.
        let ledger = [
            Known { gid: gid(1), ..known("/a") },
            Known { gid: gid(3), destroyed: true, ..known("/d") },
        ];
        let [first, second] = ledger;
        let found = differing(&graph, "A", &[first, second, killed]);
        assert_eq!(found.types, BTreeSet::from(["B".to_owned(), "D".to_owned()]));
        assert_eq!(named(found), (vec!["/d C".to_owned()], 2));
        let silent = Known { has_published: false, ..second };
        assert_eq!(named(differing(&graph, "A", &[first, silent, killed])), none(2));
        // One without a GID is one of its name, and switches off no other's.
        let without = Known { gid: None, ..known("/b") };
        let found = differing(&graph, "A", &[first, second, killed, without]);
        assert_eq!(found.types, BTreeSet::from(["B".to_owned(), "D".to_owned()]));
        assert_eq!(named(found), (vec!["/b D".to_owned(), "/d C".to_owned()], 1));
    }

    #[test]
    fn a_node_s_type_is_recorded_before_a_program_s() {
        let of = |publishers: &[(&str, &str)]| chosen(&shown(publishers)).map(str::to_owned);
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("", "A"), ("/a", "C"), ("/b", "B")]).as_deref(), Some("B"));
        assert_eq!(of(&[("", "B"), ("", "A")]).as_deref(), Some("A"));
    }

    #[test]
    fn who_is_there_at_three_looks_in_a_row_is_missed() {
        let (others, begun) = (OtherTypes::default(), Instant::now());
        let look = |at: u64, uncounted: u64| {
            let types = BTreeSet::from(["B".to_owned()]);
            let differing = Differing { uncounted, types, ..Differing::default() };
            others.look(begun + Duration::from_millis(at * 200), || differing);
        };
        (0..).zip([1, 1, 0, 2, 1]).for_each(|(at, uncounted)| look(at, uncounted));
        assert_eq!(others.lacking("/talk", "A"), None);
        look(5, 1);
        let lacking = others.lacking("/talk", "A").unwrap_or_default();
        let begin = "/talk has publishers (at least 1) that do not count and publish it as B, and it is recorded as A:";
        assert!(lacking.starts_with(begin), "{lacking}");
        others.begin();
        assert_eq!(others.lacking("/talk", "A"), None);
    }
}
