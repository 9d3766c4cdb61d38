//! What the ledger has of nodes is what they have done: figure by figure.
#![allow(clippy::unwrap_used)]

mod standin;

use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::os::fd::AsRawFd;
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::{
    Counts, Durability, Endpoint, History, Kind, Ledger, Presence, Process, Qos, Reliability,
    Strength, Unlisted, Waited,
};
use rustix::fs::{MemfdFlags, memfd_create};
use standin::{Client, Middleware, Node, built, built_over};

/// The only subscription on a topic.
fn subscription(ledger: &Ledger, topic: &str) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.topic == topic && one.kind == Kind::Subscription);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

fn publisher(ledger: &Ledger, topic: &str) -> Endpoint {
    let mut found = ledger.endpoints().unwrap();
    found.retain(|one| one.topic == topic && one.kind == Kind::Publisher);
    assert_eq!(found.len(), 1, "{found:?}");
    found.remove(0)
}

fn only_process(ledger: &Ledger) -> Process {
    let processes = ledger.processes().unwrap();
    assert_eq!(processes.len(), 1, "{processes:?}");
    processes[0]
}

#[test]
fn what_is_taken_is_called_and_what_a_queue_overwrote_is_neither() {
    for client in [Client::Rclcpp, Client::Component] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 1000", "spin / 1"]);
        let own = node.report("/scan");
        assert_eq!((own.taken, own.called, own.overwritten), (10, 10, 990));
        let scan = subscription(&ledger, "/scan");
        assert_eq!((scan.strength, scan.intra_process), (Strength::Called, false), "{client:?}");
        let counts = Counts { taken: 10, started: 10, ended: 10, ..Counts::default() };
        assert_eq!(scan.counts, counts);
        assert_eq!(ledger.counts(scan.id).unwrap(), counts);
        assert_eq!(publisher(&ledger, "/scan").counts.published - counts.taken, own.overwritten);
        // What the library stands before is called all the same: 3 at the start, 2 for each call.
        assert_eq!(own.traced, 3 + 2 * 10);
    }
}

#[test]
fn a_ros_2_that_was_built_for_one_middleware_is_counted_as_any() {
    for client in [Client::Rclcpp, Client::Component, Client::Rclpy] {
        let (ledger, folder) = (Ledger::new().unwrap(), built_over(Middleware::Only));
        let mut node =
            Node::in_folder(folder, client, &ledger.environment(&folder.join("ledger.so"), None));
        node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 7", "spin / 1"]);
        let counts = subscription(&ledger, "/scan").counts;
        assert_eq!((counts.taken, publisher(&ledger, "/scan").counts.published), (7, 7));
    }
}

#[test]
fn under_overload_every_take_and_call_is_counted_whatever_the_threads() {
    for (client, threads) in [
        (Client::Rclcpp, 1),
        (Client::Rclcpp, 4),
        (Client::Component, 4),
        (Client::Rclpy, 1),
        (Client::Rclpy, 4),
    ] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 10", &format!("flood /scan 30000 {threads}")]);
        let own = node.report("/scan");
        let Endpoint { counts, strength, .. } = subscription(&ledger, "/scan");
        assert_eq!(own.waiting, 0);
        assert_eq!(counts.taken, own.taken, "{client:?} {threads}");
        assert_eq!(own.taken + own.overwritten, 30_000);
        assert_eq!(publisher(&ledger, "/scan").counts.published, 30_000);
        match strength {
            Strength::Called => {
                assert_eq!((counts.started, counts.ended), (own.called, own.called));
                assert_eq!((own.called, counts.returned), (own.taken, 0));
            }
            Strength::Taken => {
                assert_eq!((counts.started, counts.ended), (0, 0));
                assert_eq!(counts.returned, own.taken);
            }
            Strength::Received => panic!("{client:?}"),
        }
        assert_eq!(strength == Strength::Called, client != Client::Rclpy);
        assert_eq!(counts.in_hand(strength), 0);
    }
}

#[test]
fn threads_that_take_or_wait_are_counted_for_their_program_alone() {
    let ledger = Ledger::new().unwrap();
    for threads in [4, 1, 3] {
        // Each has the place of the one before it.
        let mut node = Node::start(Client::Rclpy, &ledger);
        node.obey(&["sub /scan 10", "pub /scan 10", &format!("flood /scan 3000 {threads}")]);
        assert_eq!(only_process(&ledger).spinners, threads);
        node.kill();
        ledger.retire().unwrap();
    }
}

#[test]
fn a_module_that_python_loads_for_itself_has_the_strength_taken() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclpy, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 7", "spin / 1"]);
    let scan = subscription(&ledger, "/scan");
    assert_eq!(scan.strength, Strength::Taken);
    assert_eq!(scan.counts, Counts { taken: 7, returned: 7, ..Counts::default() });
    assert_eq!(ledger.strength_of(node.pid()).unwrap(), Some(Strength::Taken));
}

#[test]
fn what_others_create_and_destroy_meanwhile_costs_no_count() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 10", "busy /scan 100000 3"]);
    let own = node.report("/scan");
    let Counts { taken, started, ended, .. } = subscription(&ledger, "/scan").counts;
    assert_eq!((taken, started, ended), (own.taken, own.called, own.called));
    assert_eq!(own.taken + own.overwritten, 100_000);
    assert_eq!(publisher(&ledger, "/scan").counts.published, 100_000);
    let short = ledger.retire().unwrap();
    assert!(short.len() >= 10, "{}", short.len());
    assert_eq!(short.iter().find(|one| one.counts != Counts::default()), None);
}

#[test]
fn every_way_to_take_and_to_publish_counts_once() {
    for way in ["plain", "bare", "serialized", "raw", "loaned", "sequence"] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(Client::Rclcpp, &ledger);
        node.obey(&[&format!("sub /scan 100 {way}"), "pub /scan 1"]);
        ledger.own(&node.gid("/scan")).unwrap();
        node.obey(&["publish /scan 10 plain", "publish /scan 5 serialized"]);
        node.obey(&["publish /scan 4 loaned", "poison /scan"]);
        node.obey(&["spin / 1"]);
        assert_eq!(node.ask("sent /scan"), "19");
        let counts = publisher(&ledger, "/scan").counts;
        assert_eq!((counts.published, counts.offered), (19, 19), "{way}");
        let scan = subscription(&ledger, "/scan");
        assert_eq!((scan.counts.taken, node.report("/scan").taken), (19, 19), "{way}");
        // Who does not ask for it is not given a message's publisher.
        let asks = !matches!(way, "bare" | "raw" | "sequence");
        let origins = (scan.counts.taken_own, scan.counts.taken_unknown);
        assert_eq!(origins, if asks { (19, 0) } else { (0, 19) }, "{way}");
        // rclcpp's generic subscription, which rosbag2's recorder has, reports no callback.
        let reports = way != "serialized";
        assert_eq!(scan.strength == Strength::Called, reports, "{way}");
        assert_eq!(scan.counts.done(scan.strength), 19, "{way}");
    }
}

#[test]
fn topic_qos_thread_and_process_are_those_of_the_node() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /robot_1/scan 7", "default /map", "pub /map 1"]);
    let scan = subscription(&ledger, "/robot_1/scan");
    assert_eq!(scan.qos.depth, 7);
    assert_eq!(scan.qos.history, History::KeepLast);
    assert_eq!(scan.qos.reliability, Reliability::BestEffort);
    assert_eq!(scan.qos.durability, Durability::Volatile);
    assert_eq!((scan.thread, scan.destroyed, scan.process.pid), (None, false, node.pid()));
    // What the node left to the middleware is what that chose.
    let chosen = Qos {
        history: History::KeepLast,
        depth: 5,
        reliability: Reliability::Reliable,
        durability: Durability::Volatile,
        presence: Presence::NONE,
    };
    assert_eq!(subscription(&ledger, "/map").qos, chosen);
    node.obey(&["timely /timely", "endless /endless"]);
    let (deadline, lease) = (Some(Duration::from_millis(1_250)), Some(Duration::from_secs(2)));
    let timely = Presence { deadline, lease, manual: true };
    assert_eq!(subscription(&ledger, "/timely").qos.presence, timely);
    assert_eq!(subscription(&ledger, "/endless").qos.presence, Presence::NONE);
    node.obey(&["publish /map 1", "spin / 1", "empty /map 3"]);
    let thread: u32 = node.ask("thread").parse().unwrap();
    let map = subscription(&ledger, "/map");
    assert_eq!((map.thread, map.counts.taken), (Some(thread), 1));
    let process = only_process(&ledger);
    assert_eq!((process.id, process.alive, process.unlisted), (map.process, true, 0));
}

/// Whether each subscription of a topic is late, those first that were listed first.
fn late(ledger: &Ledger, topic: &str) -> Vec<bool> {
    let all = ledger.endpoints().unwrap();
    all.iter().filter(|one| one.topic == topic).map(|one| one.late).collect()
}

#[test]
fn late_is_who_comes_after_we_have_published_and_takes_no_other_s_place() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /there 1", "sub /before 1", "sub /ended 1", "destroy /before"]);
    ledger.note_published();
    node.obey(&["sub /new 1", "sub /new 1", "destroy /there", "sub /there 1", "sub /there 1"]);
    node.obey(&["sub /before 1", "destroy /ended"]);
    ledger.end(subscription(&ledger, "/ended").id).unwrap();
    node.obey(&["sub /ended 1"]);
    assert_eq!(late(&ledger, "/new"), [true, true]);
    // Of two in the place of one the second is late.
    assert_eq!(late(&ledger, "/there"), [false, false, true]);
    // Who left before we published has taken nothing of ours.
    assert_eq!(late(&ledger, "/before"), [false, true]);
    assert_eq!(late(&ledger, "/ended"), [false, true]);
    // Another player.
    ledger.disown_all();
    node.obey(&["sub /after 1"]);
    assert_eq!(late(&ledger, "/after"), [false]);
}

#[test]
fn when_nothing_was_left_and_what_was_published_last_have_moments_while_somebody_watches() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["default /map", "pub /map 1"]);
    let noted = |kind| {
        let all = ledger.endpoints().unwrap();
        let counts = all.iter().find(|one| one.kind == kind).unwrap().counts;
        (counts.rested, counts.seen_at)
    };
    let (map, publisher) = (|| noted(Kind::Subscription), || noted(Kind::Publisher));
    node.obey(&["publish /map 1", "spin / 1", "empty /map 1"]);
    assert_eq!((map(), publisher()), ((None, Duration::ZERO), (None, Duration::ZERO)));
    ledger.watch_matches(true);
    node.obey(&["publish /map 1"]);
    let published = publisher().1;
    assert_eq!((published > Duration::ZERO, map()), (true, (None, Duration::ZERO)));
    node.obey(&["spin / 1", "empty /map 1"]);
    let (rested, at) = map();
    assert_eq!((rested, at > published, publisher().1), (Some(2), true, published));
    // Of what comes later nothing is known yet.
    node.obey(&["publish /map 1"]);
    assert_eq!((map(), publisher().1 > at), ((Some(2), at), true));
    node.obey(&["spin / 1", "empty /map 1"]);
    assert_eq!((map().0, map().1 > publisher().1), (Some(3), true));
}

#[test]
fn each_endpoint_has_the_whole_name_of_its_node() {
    for client in [Client::Rclcpp, Client::Rclpy] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(client, &ledger);
        node.obey(&["sub /a 1", "be /robot_1/front 0 scanner", "sub /b 1", "pub /b 1"]);
        node.obey(&["be / 0 -", "sub /c 1", "pub /c 1"]);
        let of = |topic| (subscription(&ledger, topic).node, publisher(&ledger, topic).node);
        let front = "/robot_1/front/scanner".to_owned();
        assert_eq!(subscription(&ledger, "/a").node, "/node");
        assert_eq!(of("/b"), (front.clone(), front));
        assert_eq!(of("/c"), (String::new(), String::new()));
    }
}

#[test]
fn an_endpoint_whose_node_has_too_long_a_name_is_not_listed_and_that_is_reported() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    let fits = format!("/{}", "n".repeat(249));
    node.obey(&[&format!("be {fits} 0 node"), "sub /fits 1", "be /robot 0 node"]);
    assert_eq!(subscription(&ledger, "/fits").node.len(), 255);
    assert_eq!(ledger.unlisted(), Unlisted::default());
    node.obey(&[&format!("be {fits}n 0 node"), "sub /not 10", "pub /not 10", "publish /not 3"]);
    node.obey(&["spin / 1"]);
    assert_eq!(node.report("/not").called, 3);
    assert_eq!(ledger.endpoints().unwrap().len(), 1);
    assert_eq!(ledger.unlisted().endpoints, 2);
    assert_eq!(only_process(&ledger).unlisted, ledger.unlisted().endpoints);
}

#[test]
fn a_process_that_is_killed_in_a_callback_has_one_start_more_than_ends() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 3", "spin / 1", "stick /"]);
    node.obey(&["publish /scan 1"]);
    assert_eq!(node.ask("spin / 1"), "stuck");
    let before = subscription(&ledger, "/scan");
    node.kill_only();
    node.kill();
    let after = subscription(&ledger, "/scan");
    assert_eq!(after, before);
    assert_eq!(after.counts, Counts { taken: 4, started: 4, ended: 3, ..Counts::default() });
    assert_eq!(after.counts.in_hand(after.strength), 1);
    assert!(!only_process(&ledger).alive);
}

#[test]
fn two_processes_count_in_one_ledger_each_for_itself() {
    let ledger = Ledger::new().unwrap();
    let mut nodes = [Client::Rclcpp, Client::Rclpy].map(|client| Node::start(client, &ledger));
    for (node, messages) in nodes.iter_mut().zip(["3", "8"]) {
        node.obey(&["sub /scan 10", "pub /scan 1", &format!("publish /scan {messages}")]);
        node.obey(&["spin / 1"]);
    }
    let endpoints = ledger.endpoints().unwrap();
    let taken = |node: &Node| {
        let mine =
            |one: &&Endpoint| one.process.pid == node.pid() && one.kind == Kind::Subscription;
        endpoints.iter().filter(mine).map(|one| one.counts.taken).collect::<Vec<_>>()
    };
    assert_eq!((taken(&nodes[0]), taken(&nodes[1])), (vec![3], vec![8]));
}

#[test]
fn a_child_counts_for_itself_and_never_for_its_parent() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 2", "spin / 1", "publish /scan 1"]);
    let before = (subscription(&ledger, "/scan"), publisher(&ledger, "/scan"));
    let answer = node.ask("fork");
    assert_eq!((subscription(&ledger, "/scan"), publisher(&ledger, "/scan")), before);
    let child = subscription(&ledger, "/of_the_child");
    let pid = child.process.pid;
    assert_eq!(answer, format!("child {pid} took 3 called 3"));
    assert_eq!(child.counts, Counts { taken: 3, started: 3, ended: 3, ..Counts::default() });
    assert_ne!(pid, node.pid());
    // The parent goes on.
    node.obey(&["spin / 1"]);
    assert_eq!(subscription(&ledger, "/scan").counts.ended, 3);
    // So is how it ends its own, and a child that has created nothing ends for nobody.
    let processes = ledger.processes().unwrap();
    let statuses = processes.iter().map(|one| (one.id.pid, one.exit_status));
    assert_eq!(statuses.collect::<BTreeMap<_, _>>(), [(node.pid(), None), (pid, Some(4))].into());
}

#[test]
fn what_a_program_ends_with_is_what_it_gives_exit_and_nothing_of_one_that_gives_it_the_kernel() {
    for client in [Client::Rclcpp, Client::Component, Client::Rclpy] {
        for (way, expected) in [
            ("exit / 3", Some(3)),
            ("exit / 0", Some(0)),
            // As its parent gets it.
            ("exit / 259", Some(3)),
            ("_exit / 3", None),
            ("abort", None),
        ] {
            let ledger = Ledger::new().unwrap();
            let mut node = Node::start(client, &ledger);
            node.obey(&["sub /scan 10"]);
            assert_eq!(only_process(&ledger).exit_status, None);
            node.send(way);
            assert_eq!(node.answer(), "");
            assert_eq!(only_process(&ledger).exit_status, expected, "{client:?} {way}");
            ledger.retire().unwrap();
        }
    }
}

#[test]
fn who_hangs_in_exit_has_noted_its_status_where_it_made_an_endpoint_behind_what_hangs() {
    // The last has had more endpoints by then than it registers handlers for.
    for (commands, expected) in [
        (&["sub /scan 10", "hang_at_exit", "pub /out 10"], Some(3)),
        (&["sub /scan 10", "pub /out 10", "hang_at_exit"], None),
        (&["churn /short 63", "hang_at_exit", "sub /late 10"], Some(3)),
        (&["churn /short 64", "hang_at_exit", "sub /late 10"], None),
    ] {
        let ledger = Ledger::new().unwrap();
        let mut node = Node::start(Client::Rclcpp, &ledger);
        node.obey(commands);
        node.send("exit / 3");
        assert_eq!(node.answer(), "hangs");
        let process = only_process(&ledger);
        assert_eq!((process.exit_status, process.alive), (expected, true), "{commands:?}");
    }
}

#[test]
fn a_program_that_has_the_entry_of_one_before_has_not_its_end() {
    let ledger = Ledger::new().unwrap();
    let mut first = Node::start(Client::Rclcpp, &ledger);
    first.obey(&["sub /scan 10"]);
    first.send("exit / 3");
    assert_eq!(first.answer(), "");
    first.kill();
    ledger.retire().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10"]);
    assert_eq!(only_process(&ledger).exit_status, None);
}

#[test]
fn a_program_that_is_executed_counts_for_itself_and_the_one_before_has_ended() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /before 10"]);
    assert_eq!(node.ask("exec"), "ready");
    node.obey(&["sub /after 10", "pub /after 1", "publish /after 2", "spin / 1"]);
    assert!(subscription(&ledger, "/before").destroyed);
    let after = subscription(&ledger, "/after");
    assert_eq!((after.destroyed, after.counts.ended), (false, 2));
    let alive: Vec<bool> = ledger.processes().unwrap().iter().map(|one| one.alive).collect();
    assert_eq!(alive, [false, true]);
    assert_eq!(ledger.retire().unwrap().len(), 1);
    assert_eq!(only_process(&ledger).id, after.process);
}

#[test]
fn a_program_without_ros_that_is_executed_ends_the_one_before() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /before 10"]);
    let process = only_process(&ledger);
    assert!(process.alive);
    node.send("become");
    let deadline = Instant::now() + Duration::from_secs(30);
    let waited = ledger.wait(&[], &[process.id], deadline, |_| Ok(false)).unwrap();
    assert_eq!(waited, Waited::Ended(process.id));
    assert!(std::fs::read_to_string(format!("/proc/{}/comm", node.pid())).unwrap() == "sleep\n");
    assert_eq!(ledger.retire().unwrap().len(), 1);
}

#[test]
fn a_middleware_that_is_unloaded_and_loaded_again_is_called_where_it_is() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Again, &ledger);
    for round in 1..=3 {
        let topic = format!("/round_{round}");
        node.obey(&[&format!("sub {topic} 10"), &format!("pub {topic} 10")]);
        node.obey(&[&format!("publish {topic} 3"), "spin / 1"]);
        assert_eq!(subscription(&ledger, &topic).counts.returned, 3);
        assert_eq!(node.ask("leave"), "ready");
    }
}

#[test]
fn slots_are_used_again_only_after_they_were_retired() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 1"]);
    for round in 1..=3 {
        node.obey(&["churn /short 3000", "publish /scan 1", "spin / 1"]);
        // Those too that have the slots of others: who waits for new ones sees the number alone.
        assert_eq!(ledger.listed(), 2 + 3000 * round);
        let retired = ledger.retire().unwrap();
        assert_eq!(retired.len(), 3000);
        assert!(retired.iter().all(|one| one.destroyed && one.topic == "/short"));
        assert!(ledger.counts(retired[7].id).is_err());
    }
    assert_eq!(ledger.unlisted(), Unlisted::default());
    node.obey(&["churn /short 5000"]);
    assert_eq!(ledger.unlisted(), Unlisted { processes: 0, endpoints: 5002 - 4096 });
    assert_eq!(subscription(&ledger, "/scan").counts.ended, 3);
    assert_eq!(ledger.retire().unwrap().len(), 4094);
}

#[test]
fn a_full_table_is_reported_and_the_node_runs_on() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pubs /many 4200", "pub /scan 1", "sub /late 10"]);
    assert_eq!(ledger.unlisted(), Unlisted { processes: 0, endpoints: 4203 - 4096 });
    assert_eq!(only_process(&ledger).unlisted, 4203 - 4096);
    assert_eq!(ledger.endpoints().unwrap().len(), 4096);
    node.obey(&["publish /scan 5", "spin / 1"]);
    assert_eq!(node.report("/scan").called, 5);
    // Of the publisher nothing is counted, since it is not listed; of the subscription all is.
    assert_eq!(subscription(&ledger, "/scan").counts.ended, 5);
    assert!(ledger.endpoints().unwrap().iter().all(|one| one.counts.published == 0));
}

#[test]
fn a_node_with_more_callbacks_than_there_is_room_for_has_strength_taken_for_these() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["pub /scan 1", "subs /scan 4090", "publish /scan 1", "spin / 1"]);
    let mut all = ledger.endpoints().unwrap();
    all.retain(|one| one.kind == Kind::Subscription);
    let called = all.iter().filter(|one| one.strength == Strength::Called).count();
    assert!(called > 2000, "{called}");
    assert!(all.iter().all(|one| one.counts.done(one.strength) == one.counts.taken));
    let missing = all.len() - all.iter().map(|one| one.counts.taken as usize).sum::<usize>();
    let unlisted = ledger.unlisted().endpoints as usize;
    assert!(unlisted >= 4090 - called && unlisted >= missing, "{unlisted} {missing} {called}");
}

#[test]
fn the_table_of_processes_is_full_after_512_and_has_room_again_when_they_ended() {
    let ledger = Ledger::new().unwrap();
    let mut node = Node::start(Client::Rclcpp, &ledger);
    node.obey(&["sub /scan 10", "pub /scan 1"]);
    for _ in 0..513 {
        node.ask("fork");
    }
    assert_eq!(ledger.unlisted(), Unlisted { processes: 2, endpoints: 0 });
    assert_eq!(ledger.processes().unwrap().len(), 512);
    assert_eq!(ledger.retire().unwrap().len(), 511 * 2);
    node.ask("fork");
    assert_eq!(ledger.processes().unwrap().len(), 2);
    assert_eq!(ledger.unlisted().processes, 2);
}

#[test]
fn a_process_without_the_variables_is_received_by_at_the_most() {
    let ledger = Ledger::new().unwrap();
    for client in [Client::Rclcpp, Client::Rclpy] {
        let mut node = Node::with::<&str>(client, &[]);
        node.obey(&["sub /scan 10", "pub /scan 10", "publish /scan 12", "spin / 1"]);
        assert_eq!(node.report("/scan").called, 10);
        assert_eq!(ledger.strength_of(node.pid()).unwrap(), Some(Strength::Received));
    }
    assert_eq!((ledger.processes().unwrap(), ledger.endpoints().unwrap()), (vec![], vec![]));
    assert_eq!(ledger.strength_of(std::process::id()).unwrap(), None);
}

#[test]
fn a_library_without_a_ledger_only_passes_calls_on() {
    let library = built().join("ledger.so");
    // As long and with the same header, and yet nothing keeps others from cutting it.
    let ledger = Ledger::new().unwrap();
    let [(_, sealed), _] = ledger.environment(&library, None);
    let bytes = std::fs::read(sealed).unwrap();
    let mut cuttable = File::from(memfd_create("cuttable", MemfdFlags::ALLOW_SEALING).unwrap());
    cuttable.write_all(&bytes).unwrap();
    let unsealed = format!("/proc/{}/fd/{}", std::process::id(), cuttable.as_raw_fd());
    let short = tempfile("short", b"BAGPLDR1");
    for path in ["", "/nowhere/ledger", "/dev/null", "/", &unsealed, &short, &"x".repeat(5000)] {
        let variables = [("LD_PRELOAD", library.to_str().unwrap()), ("BAGPIPE_LEDGER", path)];
        let mut node = Node::with(Client::Rclcpp, &variables);
        node.obey(&["sub /scan 10", "pub /scan 10", "flood /scan 5000 2"]);
        let own = node.report("/scan");
        assert_eq!(own.called + own.overwritten, 5000, "{path}");
        assert_eq!(own.traced, 3 + 2 * own.called);
        assert_eq!(node.ask("errno"), "0", "{path}");
    }
    assert!(std::fs::read(unsealed).unwrap() == bytes);
    std::fs::remove_file(short).unwrap();
}

fn tempfile(name: &str, bytes: &[u8]) -> String {
    let path = std::env::temp_dir().join(format!("ros2-ledger-{}-{name}", std::process::id()));
    std::fs::write(&path, bytes).unwrap();
    path.to_str().unwrap().to_owned()
}
