//! Each message that is taken has its publisher's GID, as the graph and the ledger have it.
#![allow(clippy::unwrap_used)]

mod standin;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use bagpipe_ros2player::{Durability, Player, Qos, Received};
use standin::{ALL, Graph, LONG, Node, eventually};

/// For who comes late as well.
const KEPT: Qos = Qos { durability: Durability::TransientLocal, ..ALL };

type Gid = [u8; 16];

/// A node that publishes so many strings on /out once somebody is there, and goes on to live.
fn start(graph: &Graph, name: &str, many: &str) -> Node {
    let publisher = ["--pub", "/out:std_msgs/msg/String:100:reliable:transient_local"];
    graph.node(&[&["--name", name, "--burst", many][..], &publisher].concat())
}

/// The GIDs that the ledger has, by their nodes.
fn listed(graph: &Graph) -> BTreeMap<String, Gid> {
    let all = graph.ledger.endpoints().unwrap().into_iter();
    all.filter_map(|one| Some((one.node, one.gid?))).collect()
}

/// How many messages came of each publisher, once there are so many.
fn received(player: &Player, many: u64) -> BTreeMap<Option<Gid>, u64> {
    let (mut of, late) = (BTreeMap::new(), Instant::now() + LONG);
    while of.values().sum::<u64>() < many {
        assert!(Instant::now() < late, "{of:?}");
        let mut count = |one: Received<'_>| *of.entry(one.publisher).or_default() += 1;
        player.receive(Duration::from_millis(100), &mut count).unwrap();
    }
    of
}

/// Of two nodes that publish three and five, how many came of each by its GID and of nobody known.
fn of_two(graph: &Graph, origins: Option<&str>) -> (u64, u64, u64) {
    let mut options = graph.options();
    options.environment.extend(origins.map(|of| ("STANDIN_ORIGINS".into(), of.into())));
    let player = Player::start(&options).unwrap();
    let _nodes = [start(graph, "/few", "3"), start(graph, "/more", "5")];
    eventually(|| listed(graph).len() == 2);
    player.subscribe("/out", "std_msgs/String", &KEPT).unwrap();
    let (of, gids) = (received(&player, 8), listed(graph));
    let many = |gid: Option<Gid>| of.get(&gid).copied().unwrap_or(0);
    (many(Some(gids["/few"])), many(Some(gids["/more"])), many(None))
}

#[test]
fn a_message_has_the_gid_of_who_published_it() {
    for graph in Graph::of_each_player() {
        assert_eq!(of_two(&graph, None), (3, 5, 0));
    }
}

#[test]
fn so_it_has_where_the_middleware_gives_it_with_each_message() {
    assert_eq!(of_two(&Graph::new(), Some("gid")), (3, 5, 0));
}

#[test]
fn where_the_middleware_does_not_say_it_is_nobody_s() {
    assert_eq!(of_two(&Graph::new(), Some("none")), (0, 0, 8));
}

#[test]
fn who_was_known_once_is_known_when_it_has_left() {
    for graph in Graph::of_each_player() {
        let player = graph.player();
        let node = start(&graph, "/few", "3");
        eventually(|| listed(&graph).len() == 1);
        let gid = listed(&graph)["/few"];
        let subscription = player.subscribe("/out", "std_msgs/String", &KEPT).unwrap();
        eventually(|| player.taken(subscription) == 3);
        drop(node);
        assert_eq!(received(&player, 3), BTreeMap::from([(Some(gid), 3)]));
    }
}
