//! How a player begins and ends, and what is missing where it can't: each is a sentence, in time.
#![allow(clippy::unwrap_used)]

mod standin;

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use bagpipe_ros2ledger::Kind;
use bagpipe_ros2player::{GraphPublisher, Player, PlayerError, PlayerOptions};
use standin::{
    ALL, Graph, LONG, RELIABLE, built, eventually, match_own, message, publish, threads_are,
    with_each_player, write_program,
};

/// A folder for one test.
fn folder(name: &str) -> PathBuf {
    let folder = std::env::temp_dir().join(format!("ros2player-{name}-{}", std::process::id()));
    let _left = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).unwrap();
    folder
}

/// A library of C into a folder.
fn library(folder: &Path, name: &str, source: &str) {
    let file = folder.join(name).with_extension("c");
    std::fs::write(&file, source).unwrap();
    let mut cc = Command::new("cc");
    cc.args(["-shared", "-fPIC", "-o"]).arg(folder.join(name)).arg(&file);
    assert!(cc.status().unwrap().success());
}

fn start_error(options: &PlayerOptions) -> PlayerError {
    Player::start(options).err().unwrap()
}

/// Whether a process is there, be it a zombie.
fn exists(pid: u32) -> bool {
    Path::new(&format!("/proc/{pid}")).exists()
}

fn runs(pid: u32) -> bool {
    let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
    stat.rsplit_once(") ").is_some_and(|(_, rest)| !rest.starts_with('Z'))
}

#[test]
fn the_graph_has_nodes_of_other_processes_with_their_topics() {
    with_each_player(|graph| {
        let _relay = graph.start(
            "standin_node_py",
            &["--name", "/ns/relay", "--sub", "/in:sensor_msgs/msg/Imu:10:reliable", "--pub"]
                .into_iter()
                .chain(["/out:std_msgs/msg/String:10:best_effort", "--relay", "/in=/out"])
                .collect::<Vec<_>>(),
        );
        let _bare = graph.node(&["--name", "/bare"]);
        let player = graph.player();
        let publisher = player.advertise("/in", "sensor_msgs/Imu", &RELIABLE).unwrap();
        let of = |name: &str| player.graph().unwrap().into_iter().find(|node| node.name == name);
        eventually(|| of("/ns/relay").is_some_and(|node| node.publishes.len() == 1));
        eventually(|| of("/ns/relay").is_some_and(|node| node.subscribes.len() == 1));
        let relay = of("/ns/relay").unwrap();
        assert_eq!(relay.publishes, [("/out".into(), "std_msgs/msg/String".into())]);
        assert_eq!(relay.subscribes, [("/in".into(), "sensor_msgs/msg/Imu".into())]);
        eventually(|| of("/bare").is_some());
        assert_eq!(of("/bare").unwrap().publishes, []);
        let own = of("/bagpipe/player").unwrap();
        assert_eq!(own.publishes, [("/in".into(), "sensor_msgs/msg/Imu".into())]);
        let listed = || graph.endpoint(Kind::Publisher, "/out").gid;
        let one = |node: &str, datatype: &str, gid: Option<[u8; 16]>| GraphPublisher {
            node: Some(node.to_owned()),
            datatype: datatype.to_owned(),
            gid,
        };
        let found = |name: &str| player.publishers_of(name).unwrap();
        assert_eq!(found("/out"), [one("/ns/relay", "std_msgs/msg/String", listed())]);
        let gid = player.gid(publisher);
        assert_eq!(found("/in"), [one("/bagpipe/player", "sensor_msgs/msg/Imu", gid)]);
        assert!(gid.is_some() && listed().is_some() && gid != listed());
        assert_eq!(found("/ou"), []);
        // Of two nodes of one name the lists by node show what one of them has.
        let _namesake =
            graph.node(&["--name", "/ns/relay", "--pub", "/out:sensor_msgs/msg/Imu:1:reliable"]);
        eventually(|| found("/out").len() == 2);
        let mut both = found("/out");
        both.sort_by(|one, other| one.datatype.cmp(&other.datatype));
        let expected = ["sensor_msgs/msg/Imu", "std_msgs/msg/String"];
        let gids = [both[0].gid, listed()];
        assert_eq!(both, [0, 1].map(|at| one("/ns/relay", expected[at], gids[at])));
        assert!(gids[0].is_some() && gids[0] != gids[1]);
        let topics = player.topics_of_graph().unwrap();
        let types = topics.iter().map(|(topic, types)| (topic.as_str(), types.count));
        assert_eq!(types.collect::<Vec<_>>(), [("/in", 1), ("/out", 2)]);
        assert_eq!(topics["/in"].first, "sensor_msgs/msg/Imu");
        assert!(expected.contains(&&*topics["/out"].first));
    });
}

#[test]
fn publishers_are_read_from_what_each_distribution_lists_them_in() {
    let graph = Graph::new();
    let mut options = graph.options();
    options.environment.push(("STANDIN_DISTRIBUTION".into(), "humble".into()));
    let player = Player::start(&options).unwrap();
    let names: Vec<String> = (0..9).map(|one| format!("/{one}{}", "x".repeat(one * 20))).collect();
    let topic = "/out:std_msgs/msg/String:1:reliable";
    let _nodes: Vec<_> = names
        .iter()
        .zip(["handle", "gid"].iter().cycle())
        .map(|(name, origins)| graph.node(&["--name", name, "--pub", topic, "--origins", origins]))
        .collect();
    let found = || player.publishers_of("/out").unwrap();
    eventually(|| found().len() == names.len());
    let found: BTreeMap<_, _> = found().into_iter().map(|one| (one.node, one.gid)).collect();
    assert!(found.keys().flatten().eq(&names));
    // A publisher is in the graph a moment before its process has listed it.
    let listed =
        || graph.ledger.endpoints().unwrap().into_iter().map(|one| (Some(one.node), one.gid));
    eventually(|| listed().collect::<BTreeMap<_, _>>() == found);
    assert!(found.values().all(Option::is_some));
}

#[test]
fn who_leaves_is_in_nobody_s_graph_any_more() {
    let graph = Graph::new();
    let scout = graph.player();
    let there = || scout.publishers_of("/in").unwrap().len();
    for of in [&graph, &graph.with_player_on_dds()] {
        for _ in 0..10 {
            let player = of.player();
            player.advertise("/in", "sensor_msgs/Imu", &RELIABLE).unwrap();
            eventually(|| there() == 1);
            drop(player);
            let left = Instant::now();
            eventually(|| there() == 0);
            // Who leaves without a message is there for its lease, of ten seconds.
            assert!(left.elapsed() < Duration::from_secs(8));
        }
    }
}

// Promise: domain-of-its-own
#[test]
fn two_domains_never_meet() {
    let (here, there) = (Graph::new(), Graph::new());
    let (from, to) = (here.player(), there.player());
    let publisher = from.advertise("/in", "std_msgs/String", &ALL).unwrap();
    let subscription = to.subscribe("/in", "std_msgs/String", &ALL).unwrap();
    let own = from.subscribe("/in", "std_msgs/String", &ALL).unwrap();
    eventually(|| from.subscribers(publisher).unwrap() == 1);
    eventually(|| from.publishers(own).unwrap() == 1);
    publish(&from, publisher, &message(1, 1)).unwrap();
    assert_eq!(from.receive(LONG, &mut |_| ()).unwrap(), 1);
    assert_eq!(to.receive(Duration::from_millis(200), &mut |_| ()).unwrap(), 0);
    assert_eq!((to.publishers(subscription).unwrap(), from.graph().unwrap().len()), (0, 1));
}

#[test]
fn what_is_missing_is_a_sentence_that_says_what_to_do() {
    let graph = Graph::new();
    let empty = folder("empty");
    let nowhere = PlayerOptions { environment: graph.environment_with(&empty), ..graph.options() };
    let error = start_error(&nowhere).to_string();
    assert!(error.contains("librcl.so") && error.contains("setup.sh"), "{error}");

    library(&empty, "librcl.so", "int rcl_init(void) { return 0; }");
    let error = start_error(&nowhere).to_string();
    assert!(error.contains("librcl has no rcutils_get_default_allocator"), "{error}");

    let absent = PlayerOptions { program: empty.join("absent"), ..graph.options() };
    let error = start_error(&absent).to_string();
    assert!(error.contains("absent can't be started: No such file"), "{error}");

    let node = PlayerOptions { node: "1st player".into(), ..graph.options() };
    let error = start_error(&node).to_string();
    assert!(error.contains("rcl_node_init has failed with 201: 1st player is no name"), "{error}");

    let huge = PlayerOptions { room: (1 << 30) + 1, ..graph.options() };
    assert!(matches!(start_error(&huge), PlayerError::Room(_)));
    std::fs::remove_dir_all(empty).unwrap();
}

/// As Cyclone DDS' own settings name it.
const ONE_PLACE: &str = "<MaxAutoParticipantIndex>1</MaxAutoParticipantIndex>";

#[test]
fn a_domain_without_a_place_is_a_sentence_that_names_the_limit() {
    // One whose places no test of another process has.
    let graph = Graph::untagged();
    let mut environment = graph.environment();
    let settings = environment.iter_mut().find(|one| one.0 == "CYCLONEDDS_URI").unwrap();
    let whole = settings.1.to_str().unwrap().replace("</Discovery>", "");
    settings.1 = whole.replace("</Domain>", &format!("{ONE_PLACE}</Discovery></Domain>")).into();
    let options = PlayerOptions { environment, ..graph.options() };
    let _first = Player::start(&options).unwrap();
    let error = start_error(&options).to_string();
    assert!(error.contains("can't join its domain: rcl_init has failed with 1"), "{error}");
    assert!(error.contains("as many as MaxAutoParticipantIndex in CYCLONEDDS_URI"), "{error}");
    // Cyclone DDS' own reason, which rcl's text lacks.
    assert!(error.contains("; its last lines: ") && error.contains("participant index"), "{error}");
}

#[test]
fn a_refusal_with_security_on_names_the_keys_the_domain_and_what_the_middleware_has_written() {
    let graph = Graph::new();
    let options = |more: &[(&str, &str)]| {
        let mut environment = graph.environment();
        let strict = [("ROS_SECURITY_ENABLE", "true"), ("ROS_SECURITY_STRATEGY", "Enforce")];
        let all = strict.iter().chain(more);
        environment.extend(all.map(|(name, value)| (name.into(), value.into())));
        PlayerOptions { environment, ..graph.options() }
    };
    let keystore = ("ROS_SECURITY_KEYSTORE", "/keys");
    let error = start_error(&options(&[keystore, ("ROS_DOMAIN_ID", "33")])).to_string();
    let begin = "the ROS 2 player can't join the graph: rcl_node_init has failed with 1: error not";
    assert!(error.starts_with(begin), "{error}");
    assert!(error.contains("needs all keys in /keys/enclaves: the enclave / of ROS_"), "{error}");
    assert!(error.contains("into domain 33, and to what is played and recorded"), "{error}");
    let written = "; its last lines: Security was requested, and this DDS has none";
    assert!(error.ends_with(written), "{error}");

    let named = options(&[keystore, ("ROS_SECURITY_ENCLAVE_OVERRIDE", "/robot/player")]);
    let error = start_error(&named).to_string();
    assert!(error.contains("all keys in /keys/enclaves/robot/player: "), "{error}");
    let error = start_error(&options(&[])).to_string();
    assert!(error.contains("a folder that ROS_SECURITY_KEYSTORE does not name: "), "{error}");

    // What is wrong without security is not laid to it.
    let permissive = options(&[("ROS_SECURITY_STRATEGY", "Permissive")]);
    let node = PlayerOptions { node: "1st player".into(), ..permissive.clone() };
    let error = start_error(&node).to_string();
    assert_eq!(error, "rcl_node_init has failed with 201: 1st player is no name of a node");
    Player::start(&permissive).unwrap();
}

#[test]
fn a_type_that_is_missing_names_its_package() {
    let graph = Graph::new();
    let player = graph.player();
    let error = player.advertise("/n", "shape_msgs/Mesh", &RELIABLE).unwrap_err().to_string();
    let library = "libshape_msgs__rosidl_typesupport_c.so";
    assert!(
        error.contains(&format!("/n needs the messages of shape_msgs, and {library}")),
        "{error}"
    );
    assert!(error.contains("install the package shape_msgs in the image"), "{error}");
    let error = player.subscribe("/n", "sensor_msgs/msg/Radar", &ALL).unwrap_err().to_string();
    assert!(error.contains("/n needs sensor_msgs/msg/Radar"), "{error}");
    let error = player.subscribe("/a b", "sensor_msgs/msg/Imu", &ALL).unwrap_err().to_string();
    assert!(
        error.contains("rcl_subscription_init has failed with 103: /a b is no name"),
        "{error}"
    );
    assert!(player.advertise("/n", "Imu", &RELIABLE).is_err());
    // None of it is in the way of what comes after.
    let subscription = player.subscribe("/n", "sensor_msgs/msg/Imu", &ALL).unwrap();
    assert_eq!(player.publishers(subscription).unwrap(), 0);
}

#[test]
fn there_is_room_for_1024_of_each_and_none_of_another_player() {
    let graph = Graph::new();
    let (player, other) = (graph.player(), graph.player());
    let mut last = None;
    for one in 0..1024 {
        last = Some(player.advertise(&format!("/t{one}"), "no_such/Type", &ALL));
    }
    assert!(matches!(last, Some(Err(PlayerError::Package { .. }))));
    let error = player.advertise("/t", "std_msgs/String", &ALL).unwrap_err();
    assert!(matches!(error, PlayerError::TooMany { most: 1024, .. }), "{error}");
    player.subscribe("/s", "std_msgs/String", &ALL).unwrap();
    let publisher = other.advertise("/p", "std_msgs/String", &ALL).unwrap();
    let subscription = other.subscribe("/p", "std_msgs/String", &ALL).unwrap();
    let empty = graph.player();
    assert!(matches!(empty.subscribers(publisher), Err(PlayerError::Stranger)));
    assert!(matches!(empty.publishers(subscription), Err(PlayerError::Stranger)));
    assert!(matches!(publish(&empty, publisher, b"1234"), Err(PlayerError::Stranger)));
    // One that could not be made is known, and is none.
    let error = player.subscribers(publisher).unwrap_err().to_string();
    assert!(error.contains("there is no such publisher"), "{error}");
}

#[test]
fn dropping_it_ends_the_program_and_leaves_no_zombie() {
    with_each_player(|graph| {
        let player = graph.player();
        let pid = player.pid();
        player.subscribe("/in", "std_msgs/String", &ALL).unwrap();
        assert!(runs(pid));
        drop(player);
        assert!(!exists(pid));
    });
}

#[test]
fn its_threads_are_woken_for_its_end() {
    with_each_player(|graph| {
        let took = |_| {
            let player = graph.player();
            player.subscribe("/in", "std_msgs/String", &ALL).unwrap();
            eventually(|| threads_are(player.pid(), 'S'));
            let begun = Instant::now();
            drop(player);
            begun.elapsed()
        };
        // Who is not woken looks by itself after half a second.
        let fastest = (0..8).map(took).min().unwrap();
        assert!(fastest < Duration::from_millis(350), "{fastest:?}");
    });
}

#[test]
fn variables_are_added_and_removed() {
    let graph = Graph::new();
    let folder = folder("variables");
    let program = folder.join("program");
    write_program(&program, b"#!/bin/sh\necho added=$ADDED removed=$REMOVED home=$PATH >&2\n");
    let variables = [("ADDED", "1"), ("REMOVED", "1"), ("PATH", "/bin")];
    let environment = variables.map(|(name, value)| (name.into(), value.into())).to_vec();
    let removed = vec!["REMOVED".into()];
    let options = PlayerOptions { program, environment, removed, ..graph.options() };
    let error = start_error(&options).to_string();
    assert!(error.ends_with("its last lines: added=1 removed= home=/bin"), "{error}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn an_answer_that_comes_too_late_is_not_taken_for_the_next() {
    // Both at once, since each waits for longer than a busy machine may take to start.
    std::thread::scope(|scope| {
        for graph in Graph::of_each_player() {
            scope.spawn(move || answers_too_late(&graph));
        }
    });
}

fn answers_too_late(graph: &Graph) {
    let deadline = Duration::from_secs(8);
    let player = Player::start(&PlayerOptions { deadline, ..graph.options() }).unwrap();
    let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
    let subscription = player.subscribe("/in", "std_msgs/String", &ALL).unwrap();
    match_own(&player, publisher, subscription);
    let pid = player.pid().to_string();
    let signal = |name: &str| Command::new("kill").args([name, &pid]).status().unwrap().success();
    assert!(signal("-STOP"));
    eventually(|| threads_are(player.pid(), 'T'));
    let begun = Instant::now();
    std::thread::scope(|scope| {
        // Each waits for the other, and still no longer than its own deadline.
        for _ in 0..4 {
            scope.spawn(|| {
                let error = player.graph().unwrap_err().to_string();
                assert!(error.contains("has not answered within 8 s"), "{error}");
            });
        }
    });
    assert!(begun.elapsed() < 3 * deadline, "{:?}", begun.elapsed());
    assert!(signal("-CONT"));
    assert_eq!(player.subscribers(publisher).unwrap(), 1);
    assert_eq!(player.graph().unwrap().len(), 1);
}

#[test]
fn a_program_that_is_killed_is_noticed_by_who_waits_for_room() {
    with_each_player(|graph| {
        let player = Player::start(&PlayerOptions { room: 1 << 16, ..graph.options() }).unwrap();
        let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
        let pid = player.pid().to_string();
        let signal =
            |name: &str| Command::new("kill").args([name, &pid]).status().unwrap().success();
        assert!(signal("-STOP"));
        eventually(|| threads_are(player.pid(), 'T'));
        let late = Instant::now() + LONG;
        let mut waited = 0;
        let error = loop {
            let mut kill = || {
                waited += 1;
                assert!(waited > 1 || signal("-KILL"));
                Instant::now() > late
            };
            if let Err(error) = player.publish(publisher, &[&[0; 1000]], &mut kill) {
                break error;
            }
        };
        assert!(matches!(error, PlayerError::Ended { .. }), "{error}");
    });
}

#[test]
fn a_program_that_was_killed_is_an_error_in_every_call_at_once() {
    with_each_player(|graph| {
        let player = graph.player();
        let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
        let subscription = player.subscribe("/in", "std_msgs/String", &ALL).unwrap();
        eventually(|| player.publishers(subscription).unwrap() == 1);
        publish(&player, publisher, &message(7, 7)).unwrap();
        eventually(|| player.taken(subscription) == 1);
        std::thread::scope(|scope| {
            let receiving = scope.spawn(|| {
                assert_eq!(player.receive(LONG, &mut |_| ()).unwrap(), 1);
                player.receive(LONG, &mut |_| ()).unwrap_err()
            });
            let kill = ["-KILL", &player.pid().to_string()].map(str::to_owned);
            assert!(Command::new("kill").args(kill).status().unwrap().success());
            let error = receiving.join().unwrap();
            assert!(matches!(error, PlayerError::Ended { .. }), "{error}");
        });
        let begun = Instant::now();
        let soon = begun + LONG;
        let errors = [
            publish(&player, publisher, b"1234").unwrap_err(),
            player.advertise("/n", "std_msgs/String", &ALL).unwrap_err(),
            player.subscribe("/n", "std_msgs/String", &ALL).unwrap_err(),
            player.subscribers(publisher).unwrap_err(),
            player.publishers(subscription).unwrap_err(),
            player.graph().unwrap_err(),
            player.flush(soon).unwrap_err(),
            player.receive(LONG, &mut |_| ()).unwrap_err(),
        ];
        for error in errors {
            assert!(error.to_string().contains("has ended (signal: 9 (SIGKILL))"), "{error}");
        }
        assert!(begun.elapsed() < LONG / 2);
        assert!(!exists(player.pid()));
    });
}

#[test]
fn the_last_lines_of_its_standard_error_are_in_the_error() {
    let graph = Graph::new();
    let folder = folder("lines");
    let program = folder.join("program");
    let script = "#!/bin/sh\nfor i in $(seq 50); do echo \"line $i\" >&2; done\nexit 7\n";
    write_program(&program, script.as_bytes());
    let error = start_error(&PlayerOptions { program, ..graph.options() }).to_string();
    assert!(error.contains("has ended (exit status: 7)"), "{error}");
    assert!(error.contains("line 31 | line 32") && error.ends_with("| line 50"), "{error}");
    assert!(!error.contains("line 30 "), "{error}");
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_program_that_hangs_is_late_and_ended() {
    let graph = Graph::new();
    let folder = folder("hangs");
    let program = folder.join("program");
    let script =
        format!("#!/bin/sh\ntrap '' TERM\necho $$ > {}/pid\nexec sleep 1000\n", folder.display());
    write_program(&program, script.as_bytes());
    // Until then it has written its number.
    let deadline = Duration::from_secs(7);
    let options = PlayerOptions { program, deadline, ..graph.options() };
    let error = start_error(&options).to_string();
    assert!(error.contains("has not answered within 7 s while it was to join"), "{error}");
    let pid = std::fs::read_to_string(folder.join("pid")).unwrap().trim().parse().unwrap();
    assert!(!exists(pid));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn a_full_ring_is_waited_for_until_the_caller_cancels() {
    with_each_player(|graph| {
        let options = PlayerOptions { room: 1 << 16, ..graph.options() };
        let player = Player::start(&options).unwrap();
        let publisher = player.advertise("/in", "std_msgs/String", &ALL).unwrap();
        let pid = player.pid().to_string();
        let signal =
            |name: &str| Command::new("kill").args([name, &pid]).status().unwrap().success();
        assert!(signal("-STOP"));
        eventually(|| threads_are(player.pid(), 'T'));
        let (mut asked, mut sent) = (0, 0);
        let error = loop {
            let mut cancelled = || {
                asked += 1;
                assert!(asked <= 3);
                asked == 3
            };
            match player.publish(publisher, &[&message(sent, 1000)], &mut cancelled) {
                Ok(()) => sent += 1,
                Err(error) => break error,
            }
        };
        assert!(matches!(error, PlayerError::Cancelled), "{error}");
        assert_eq!((asked, sent), (3, 62));
        assert!(!player.flush(Instant::now() + Duration::from_millis(50)).unwrap());
        assert!(signal("-CONT"));
        assert!(player.flush(Instant::now() + LONG).unwrap());
        assert_eq!(player.published(publisher), 62);
    });
}

/// What the test below starts as the process that is killed; without the variable it does nothing.
#[test]
fn agent_of_its_own() {
    let Some(pids) = std::env::var_os("PLAYER_TEST_PIDS") else { return };
    let graph = Graph::new();
    let idle = graph.player();
    // Full, so that its thread waits for room that nobody makes.
    let full = Player::start(&PlayerOptions { room: 1 << 16, ..graph.options() }).unwrap();
    let publisher = idle.advertise("/in", "std_msgs/String", &ALL).unwrap();
    let subscription = full.subscribe("/in", "std_msgs/String", &ALL).unwrap();
    eventually(|| full.publishers(subscription).unwrap() == 1);
    eventually(|| idle.subscribers(publisher).unwrap() == 1);
    for one in 0..200 {
        publish(&idle, publisher, &message(one, 1000)).unwrap();
    }
    eventually(|| full.taken(subscription) >= 50);
    // The thread that starts a program may end before its player does.
    let options = graph.options();
    let from_thread = std::thread::spawn(move || Player::start(&options).unwrap()).join().unwrap();
    from_thread.advertise("/n", "std_msgs/String", &ALL).unwrap();
    // One that can't publish on, since a reliable reader was stopped.
    let node = graph.node(&["--sub", "/stuck:std_msgs/msg/UInt8MultiArray:1:reliable"]);
    let stuck = Player::start(&PlayerOptions { room: 1 << 20, ..graph.options() }).unwrap();
    let publisher = stuck.advertise("/stuck", "std_msgs/UInt8MultiArray", &ALL).unwrap();
    graph.met("/stuck", &stuck, publisher);
    let stop = ["-STOP", &node.pid().to_string()].map(str::to_owned);
    assert!(Command::new("kill").args(stop).status().unwrap().success());
    let bytes = message(1, 100_000);
    loop {
        let begun = Instant::now();
        let mut cancelled = || begun.elapsed() > Duration::from_millis(500);
        if stuck.publish(publisher, &[&bytes], &mut cancelled).is_err() {
            break;
        }
    }
    // One whose parent is not its agent, and lives on: it has its socket to go by.
    let folder = Path::new(&pids).parent().unwrap();
    let program = folder.join("program");
    let (real, pid) = (built().join("player"), folder.join("pid"));
    let (real, pid_file) = (real.display(), pid.display());
    // It may have joined before its number is written.
    let script = format!(
        "#!/bin/sh\nexec 3<&0 0<&-\n{real} <&3 3<&- &\nexec 3<&-\necho $! > {pid_file}.new\n\
         mv {pid_file}.new {pid_file}\nwait\n"
    );
    write_program(&program, script.as_bytes());
    let _far = Player::start(&PlayerOptions { program, ..graph.options() }).unwrap();
    eventually(|| pid.exists());
    let far = std::fs::read_to_string(&pid).unwrap();
    let players = [&idle, &full, &from_thread, &stuck].map(|player| player.pid().to_string());
    let all = format!("{} {} {}", node.pid(), far.trim(), players.join(" "));
    std::fs::write(pids, all).unwrap();
    println!("ready");
    std::thread::sleep(2 * LONG);
}

/// A process whose parent was killed; dropping it kills it.
struct Orphan(u32);

impl Drop for Orphan {
    fn drop(&mut self) {
        let _ended_already = Command::new("kill").args(["-KILL", &self.0.to_string()]).status();
    }
}

#[test]
fn its_agent_killed_the_program_ends_within_a_second_whatever_it_waits_for() {
    let folder = folder("agent");
    built();
    let mut agent = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "agent_of_its_own", "--nocapture"])
        .env("PLAYER_TEST_PIDS", folder.join("pids"))
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let lines = BufReader::new(agent.stdout.take().unwrap()).lines();
    assert!(lines.map_while(Result::ok).any(|line| line.contains("ready")));
    let text = std::fs::read_to_string(folder.join("pids")).unwrap();
    let mut pids: Vec<u32> = text.split(' ').map(|pid| pid.parse().unwrap()).collect();
    let node = Orphan(pids.remove(0));
    assert!(pids.iter().all(|pid| runs(*pid)), "{pids:?}");
    agent.kill().unwrap();
    agent.wait().unwrap();
    let killed = Instant::now();
    eventually(|| !pids.iter().any(|pid| runs(*pid)));
    assert!(killed.elapsed() < LONG / 4, "{:?}", killed.elapsed());
    drop(node);
    std::fs::remove_dir_all(folder).unwrap();
}
