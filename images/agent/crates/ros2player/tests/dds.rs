//! What the player on DDS alone knows of others: ROS 2's nodes by what they announce, programs of DDS
//! without a name; and the same messages by either player.
#![allow(clippy::unwrap_used)]

mod standin;

use std::time::{Duration, Instant};

use bagpipe_ros2player::{Durability, GraphNode, Player, PlayerOptions, Presence, Qos};
use standin::{ALL, Graph, LONG, Node, RELIABLE, eventually, message, publish};

const TYPE: &str = "sensor_msgs/Imu";

/// A program of DDS that passes /in on to /out; `name`: as it announces itself, with the length of its
/// GUIDs.
fn relay(graph: &Graph, name: Option<[&str; 2]>) -> Node {
    let mut arguments = vec!["/in", "/out", TYPE];
    arguments.extend(name.into_iter().flatten());
    graph.start_uncounted("dds_relay", &arguments)
}

/// The nodes that have an endpoint, but the player's.
fn others(player: &Player) -> Vec<GraphNode> {
    let mut nodes = player.graph().unwrap();
    nodes.retain(|node| !node.name.starts_with("/bagpipe/"));
    nodes.retain(|node| !(node.publishes.is_empty() && node.subscribes.is_empty()));
    nodes.sort_by(|one, other| one.name.cmp(&other.name));
    nodes
}

fn whole(name: &str) -> GraphNode {
    let topic = |name: &str| vec![(name.to_owned(), "sensor_msgs/msg/Imu".to_owned())];
    GraphNode { name: name.to_owned(), publishes: topic("/out"), subscribes: topic("/in") }
}

#[test]
fn a_node_is_known_by_what_it_announces_of_any_distribution() {
    for size in ["16", "24"] {
        let graph = Graph::on_dds();
        let _node = relay(&graph, Some([size, "/ns/relay"]));
        let _other = relay(&graph, Some([size, "/bare"]));
        let player = graph.player();
        eventually(|| others(&player).len() == 2);
        eventually(|| others(&player) == [whole("/bare"), whole("/ns/relay")]);
    }
}

#[test]
fn one_that_announces_nothing_has_a_number_that_it_keeps() {
    let graph = Graph::on_dds();
    let first = relay(&graph, None);
    let player = graph.player();
    eventually(|| others(&player) == [whole("/unnamed_dds_participant_1")]);
    let second = relay(&graph, None);
    let both = [whole("/unnamed_dds_participant_1"), whole("/unnamed_dds_participant_2")];
    eventually(|| others(&player) == both);
    assert!(first.end());
    eventually(|| others(&player) == [whole("/unnamed_dds_participant_2")]);
    assert!(second.end());
    eventually(|| others(&player).is_empty());
}

/// What a relay of DDS made of messages of any length: sent by one player, recorded by another.
fn relayed(sender: &Graph, recorder: &Graph) -> Vec<Vec<u8>> {
    let deep = Qos { history: bagpipe_ros2player::History::KeepLast(1000), ..RELIABLE };
    let (from, to) = (sender.player(), recorder.player());
    let publisher = from.advertise("/in", TYPE, &deep).unwrap();
    let subscription = to.listen("/out", TYPE, &ALL).unwrap();
    let _relay = relay(sender, None);
    eventually(|| from.subscribers(publisher).unwrap() == 1);
    eventually(|| to.publishers(subscription).unwrap() == 1);
    // It learns of each of us by itself: what arrives shows that it has.
    let mut all = Vec::new();
    let mut keep = || {
        let limit = Duration::from_millis(20);
        to.receive(limit, &mut |one| all.push(one.data.to_vec())).unwrap();
        all.last().map(|one: &Vec<u8>| standin::number(one))
    };
    let late = Instant::now() + LONG;
    while keep().is_none() {
        assert!(Instant::now() < late);
        publish(&from, publisher, &message(0, 8)).unwrap();
    }
    // The others are behind it, and before this one.
    publish(&from, publisher, &message(1, 8)).unwrap();
    eventually(|| keep() == Some(1));
    let sent: Vec<Vec<u8>> = [0, 1, 2, 3, 4, 1000, 65_536, 1 << 20]
        .iter()
        .enumerate()
        .map(|(one, length)| message(100 + one as u64, *length))
        .collect();
    all.clear();
    for bytes in &sent {
        publish(&from, publisher, bytes).unwrap();
    }
    eventually(|| {
        to.receive(Duration::from_millis(20), &mut |one| all.push(one.data.to_vec())).unwrap();
        all.len() >= sent.len()
    });
    for (one, sent) in all.iter().zip(&sent) {
        // DDS sends whole groups of 4 bytes.
        assert!(one.starts_with(sent) && one.len() < sent.len() + 4);
    }
    all
}

#[test]
fn the_same_bytes_go_through_either_player() {
    let by_rcl = Graph::new();
    let on_dds = by_rcl.with_player_on_dds();
    let expected = relayed(&by_rcl, &by_rcl);
    assert_eq!(expected.len(), 8);
    for (sender, recorder) in [(&on_dds, &on_dds), (&by_rcl, &on_dds), (&on_dds, &by_rcl)] {
        assert!(relayed(sender, recorder) == expected);
    }
}

#[test]
fn either_player_offers_a_deadline_and_its_liveliness_and_asks_for_them() {
    let by_rcl = Graph::new();
    let on_dds = by_rcl.with_player_on_dds();
    let presence = Presence {
        deadline: Some(Duration::from_secs(3)),
        lease: Some(Duration::from_secs(9)),
        manual: true,
    };
    let stricter = Presence { deadline: Some(Duration::from_secs(2)), ..presence };
    for (one, other) in [(&by_rcl, &on_dds), (&on_dds, &by_rcl)] {
        let options = PlayerOptions { node: "far".to_owned(), ..other.options() };
        let (near, far) = (one.player(), Player::start(&options).unwrap());
        let of = |presence| Qos { presence, ..RELIABLE };
        let publisher = near.advertise("/in", TYPE, &of(presence)).unwrap();
        let strict = far.subscribe("/in", TYPE, &of(stricter)).unwrap();
        let same = far.subscribe("/in", TYPE, &of(presence)).unwrap();
        let none = far.subscribe("/in", TYPE, &RELIABLE).unwrap();
        eventually(|| near.subscribers(publisher).unwrap() == 2);
        eventually(|| [same, none].map(|one| far.publishers(one).unwrap()) == [1, 1]);
        assert_eq!(far.publishers(strict).unwrap(), 0);
        let plain = near.advertise("/other", TYPE, &RELIABLE).unwrap();
        far.subscribe("/other", TYPE, &of(Presence { manual: true, ..Presence::NONE })).unwrap();
        far.subscribe("/other", TYPE, &RELIABLE).unwrap();
        eventually(|| near.subscribers(plain).unwrap() == 1);
    }
}

#[test]
fn either_player_sees_the_other_and_gets_what_is_kept() {
    let by_rcl = Graph::new();
    let on_dds = by_rcl.with_player_on_dds();
    for (one, other) in [(&by_rcl, &on_dds), (&on_dds, &by_rcl)] {
        let options = PlayerOptions { node: "far".to_owned(), ..other.options() };
        let (near, far) = (one.player(), Player::start(&options).unwrap());
        let kept = Qos { durability: Durability::TransientLocal, ..RELIABLE };
        let publisher = near.advertise("/map", TYPE, &kept).unwrap();
        for number in 0..15 {
            publish(&near, publisher, &message(number, 10)).unwrap();
        }
        assert!(near.flush(Instant::now() + LONG).unwrap());
        let late = Qos { durability: Durability::TransientLocal, ..ALL };
        far.subscribe("/map", TYPE, &late).unwrap();
        let mut numbers = Vec::new();
        eventually(|| {
            let limit = Duration::from_millis(20);
            far.receive(limit, &mut |one| numbers.push(standin::number(one.data))).unwrap();
            numbers.len() >= 10
        });
        assert_eq!(numbers, (5..15).collect::<Vec<u64>>());
        let names = |player: &Player| {
            let mut names: Vec<String> =
                player.graph().unwrap().into_iter().map(|node| node.name).collect();
            names.sort();
            names
        };
        eventually(|| names(&near) == ["/bagpipe/far", "/bagpipe/player"]);
        eventually(|| names(&far) == ["/bagpipe/far", "/bagpipe/player"]);
    }
}

#[test]
fn what_is_no_domain_or_no_setting_is_a_sentence() {
    let graph = Graph::on_dds();
    for (name, value, sentence) in [
        ("ROS_DOMAIN_ID", "233", "ROS_DOMAIN_ID is no number from 0 to 232"),
        ("ROS_DOMAIN_ID", "1x", "ROS_DOMAIN_ID is no number from 0 to 232"),
        ("CYCLONEDDS_URI", "<CycloneDDS><Nonsense/>", "dds_create_domain (with CYCLONEDDS_URI)"),
    ] {
        let mut options = graph.options();
        options.environment.push((name.into(), value.into()));
        let error = Player::start(&options).err().unwrap().to_string();
        assert!(error.contains(sentence), "{error}");
    }
}

/// Whoever has no librcl is distinguished from whoever has one that fails.
#[test]
fn only_where_librcl_cannot_be_loaded_another_player_is_asked_for() {
    let graph = Graph::new();
    let nowhere = vec![("LD_LIBRARY_PATH".into(), "/nowhere".into())];
    let without = PlayerOptions { environment: nowhere, ..graph.options() };
    assert!(Player::start(&without).err().unwrap().is_without_librcl());
    let absent = PlayerOptions { program: "/nowhere/player".into(), ..graph.options() };
    assert!(Player::start(&absent).err().unwrap().is_without_librcl());
    let refused = PlayerOptions { node: "1st player".into(), ..graph.options() };
    assert!(!Player::start(&refused).err().unwrap().is_without_librcl());
    let ended = PlayerOptions { program: "/bin/false".into(), ..graph.options() };
    assert!(!Player::start(&ended).err().unwrap().is_without_librcl());
}
