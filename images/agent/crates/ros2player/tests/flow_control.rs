//! What is sent to a process of this machine waits for it, as long as it takes something.
#![allow(clippy::unwrap_used)]

mod scenes;
mod standin;

use std::collections::BTreeMap;
use std::ffi::OsStr;

use scenes::{own, printed};
use standin::{ALL, eventually, message, publish, with_each_player};

/// The scenes of `scenes/flow_control_scenes.c`, each with its figures.
fn scenes() -> BTreeMap<String, Vec<i64>> {
    let (player, scene) = (own("player"), own("tests/scenes/flow_control_scenes.c"));
    let strict = ["-Wall", "-Wextra", "-Werror", "-lpthread", "-I"].map(OsStr::new);
    let text = printed("flow-control", &[&strict[..], &[player.as_ref(), scene.as_ref()]].concat());
    let words = |line: &str| {
        let (scene, figures) = line.split_once(' ').unwrap();
        (scene.to_owned(), figures.split(' ').map(|word| word.parse().unwrap()).collect())
    };
    text.lines().map(words).collect()
}

/// What a scene shows: datagrams that went out, those that came, microseconds that were waited, and
/// questions to the kernel.
#[test]
fn a_sender_is_held_back_by_who_reads_and_by_nobody_else() {
    let scenes = scenes();
    let of = |scene: &str| <[i64; 4]>::try_from(scenes[scene].as_slice()).unwrap();
    // Its socket holds one of these datagrams: before each but the first it is waited for once.
    assert_eq!(of("slow"), [200, 200, 199 * 50, 200 + 199]);
    // Who keeps up costs a question for each 40 small datagrams.
    let [sent, came, waited, asked] = of("quick");
    assert_eq!((sent, came, waited), (20_000, 20_000, 0));
    assert!(asked <= 20_000 / 40, "{asked}");
    // Who has stopped is waited for once, and again only after it has read.
    for scene in ["stopped", "stopped-again"] {
        assert_eq!(of(scene)[2], 1_000_000, "{scene}");
    }
    assert_eq!(of("goes-on")[..2], [400, 400]);
    assert_eq!(of("crawls")[..2], [200, 200]);
    // What waits all the time, as in kernels of 2019, holds up no datagram that needs more than half.
    assert_eq!(of("alternates")[..3], [200, 200, 0]);
    // What is due is no later than 20 ms, and a fourth of the time that it was waited.
    let waited = of("by-the-clock")[2];
    assert!((20_000..=26_700).contains(&waited), "{waited}");
    // Nobody, for whom is asked again after a megabyte, and where the kernel does not answer: as if there were no flow control.
    assert_eq!(of("nobody")[2..], [0, 7]);
    assert_eq!((of("unanswered")[2..].to_vec(), of("unanswered")[1] < 40), (vec![0, 0], true));
    assert!(scenes["charges"][0] <= 0, "the kernel counts more: {:?}", scenes["charges"]);
}

/// As most machines have, for which a message of four megabytes is too large.
const SMALL: &str = "<Internal><SocketReceiveBufferSize max=\"208kB\"/></Internal>";

#[test]
fn what_is_larger_than_a_socket_arrives_of_best_effort_too() {
    with_each_player(|graph| {
        let subscribes = ["--sub", "/far:std_msgs/msg/UInt8MultiArray:5:best_effort"];
        let _node = graph.node_with_settings(SMALL, &subscribes);
        let player = graph.player();
        let publisher = player.advertise("/far", "std_msgs/UInt8MultiArray", &ALL).unwrap();
        graph.met("/far", &player, publisher);
        for one in 1..=5 {
            publish(&player, publisher, &message(one, 4_000_000)).unwrap();
            eventually(|| graph.subscription("/far").counts.taken == one);
        }
    });
}
