//! What is sent to a process of this machine waits for it, as long as it takes something.
#![allow(clippy::unwrap_used)]

mod standin;

use standin::{ALL, eventually, message, publish, with_each_player};

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
        for one in 1..=2 {
            publish(&player, publisher, &message(one, 4_000_000)).unwrap();
            eventually(|| graph.subscription("/far").counts.taken == one);
        }
    });
}
