//! What a node publishes waits for room in its receivers' sockets if the ledger's reader asks for it, and
//! nothing else does.
#![allow(clippy::unwrap_used)]

mod standin;

use std::net::UdpSocket;
use std::time::Duration;

use bagpipe_ros2ledger::{Flow, Ledger};
use standin::{Client, Node};

/// More than half of what a socket holds on most machines.
const LARGE: usize = 60_000;

/// A node that sends what it publishes to a socket as well, which nobody has read yet: /far as Cyclone DDS
/// does, and /other as another middleware.
struct Scene {
    ledger: Ledger,
    node: Node,
    socket: UdpSocket,
}

impl Scene {
    fn new(client: Client) -> Scene {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        let wire = format!("wire {} {LARGE}", socket.local_addr().unwrap().port());
        node.obey(&["pub /other 10", &wire, "pub /far 10", "sub /child 10"]);
        Scene { ledger, node, socket }
    }

    /// Whether the node has asked the kernel how full a socket is, for which it has one of its own.
    fn has_asked(&self) -> bool {
        let all = std::fs::read_dir(format!("/proc/{}/fd", self.node.pid())).unwrap();
        let files = all.map(|file| std::fs::read_link(file.unwrap().path()).unwrap());
        files.filter(|file| file.to_string_lossy().starts_with("socket:")).count() > 0
    }

    /// So many that come.
    fn read(&self, many: usize) {
        let mut bytes = vec![0; LARGE];
        for one in 0..many {
            assert_eq!(self.socket.recv(&mut bytes).unwrap(), LARGE, "{one}");
        }
    }
}

#[test]
fn it_waits_where_that_is_asked_for() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        for way in ["plain", "serialized", "loaned"] {
            let mut scene = Scene::new(client);
            // By the clock nobody is waited for so long that more are certain to come.
            for (flow, many) in [(Flow::ByTheClock, 1), (Flow::Controlled, 20)] {
                scene.ledger.control_flow(flow);
                scene.node.send(&format!("publish /far {many} {way}"));
                scene.read(many);
                assert_eq!(scene.node.answer(), "done", "{client:?} {way} {flow:?}");
                assert!(scene.has_asked(), "{client:?} {way} {flow:?}");
            }
        }
    }
}

#[test]
fn it_goes_out_at_once_where_nobody_asks_for_more() {
    let mut scene = Scene::new(Client::Rclcpp);
    scene.node.obey(&["publish /far 100"]);
    assert!(!scene.has_asked());
    scene.ledger.control_flow(Flow::Controlled);
    scene.ledger.control_flow(Flow::Free);
    scene.node.obey(&["publish /far 100"]);
    assert!(!scene.has_asked());
}

#[test]
fn of_another_middleware_it_goes_out_at_once() {
    let mut scene = Scene::new(Client::Rclcpp);
    scene.ledger.control_flow(Flow::Controlled);
    scene.node.obey(&["publish /other 100"]);
    assert!(!scene.has_asked());
}

#[test]
fn what_is_no_message_goes_out_at_once() {
    let mut scene = Scene::new(Client::Rclcpp);
    scene.ledger.control_flow(Flow::Controlled);
    let send = format!("send {} {LARGE}", scene.socket.local_addr().unwrap().port());
    for _ in 0..100 {
        scene.node.obey(&[&send]);
    }
    assert!(!scene.has_asked());
    // As what was published before is over.
    scene.read(1);
    scene.node.obey(&["publish /far 1"]);
    assert!(scene.has_asked());
}

#[test]
fn a_child_of_one_that_publishes_is_held_back_by_itself() {
    let mut scene = Scene::new(Client::Rclcpp);
    scene.ledger.control_flow(Flow::Controlled);
    scene.node.send("publish /far 20");
    scene.read(20);
    assert_eq!(scene.node.answer(), "done");
    scene.node.send("fork");
    // One of its parent's, which is not counted for it, and three of its own.
    scene.read(4);
    assert!(scene.node.answer().starts_with("child "));
}
