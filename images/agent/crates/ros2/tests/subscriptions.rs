//! Subscriptions that come and go while a recording is played, and nodes that share a name: what
//! each has lost is counted, and nothing else.
#![allow(clippy::unwrap_used)]

mod scene;
#[path = "../../ros2player/tests/standin/mod.rs"]
mod standin;

use std::sync::Arc;
use std::time::Duration;

use bagpipe_replay::{LedgerSubscriber, Mode, Progress, Replayed, Stage, Strength};
use scene::{Ask, DEFAULT, MS, Scene, assert_window_answered, recorded, recording};
use standin::{LONG, eventually};

/// Of a node that is still once all is over, however long that takes on a busy machine.
const REALTIME: Ask<'static> = Ask { mode: Mode::Realtime, drain: LONG, ..DEFAULT };
const LOCKSTEP: Ask<'static> = Ask { mode: Mode::Lockstep, ..DEFAULT };

/// A relay from /in to /out with a queue of so many messages, and one for answers that nothing
/// overwrites while a busy machine keeps the recorder from its socket.
fn relay<'a>(name: &'a str, subscription: &'a str, options: &[&'a str]) -> Vec<&'a str> {
    let out = "/out:std_msgs/msg/String:3000:reliable";
    let words = ["--name", name, "--sub", subscription, "--pub", out, "--relay", "/in=/out"];
    [&words[..], options].concat()
}

const TEN: &str = "/in:sensor_msgs/msg/Imu:10:reliable";
/// As deep as all that is played: in real time, no pause of the machine overwrites anything.
const DEEP: &str = "/in:sensor_msgs/msg/Imu:3000:reliable";
const ONE: &str = "/in:sensor_msgs/msg/Imu:1:reliable";

fn lines(replayed: &Replayed) -> &[LedgerSubscriber] {
    &replayed.ledger.topics[0].subscribers
}

#[test]
fn a_node_that_subscribes_again_and_again_loses_nothing_where_it_is_waited_for() {
    for program in ["standin_node", "standin_node_py"] {
        let scene = Scene::new();
        let _relay = scene.start(program, &relay("/renews", TEN, &["--renew-every", "20"]));
        let replayed = scene.play(&recording(&["/in"], 100, 50), &LOCKSTEP).unwrap();
        let line = &lines(&replayed)[0];
        assert_eq!((line.received, line.dropped), (100, 0), "{program}");
        assert_eq!(recorded(&replayed).len(), 100);
        assert!(line.strength >= Strength::Taken);
    }
}

#[test]
fn at_full_speed_what_lay_in_the_queue_of_a_subscription_that_is_destroyed_is_lost_and_no_more() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/renews", ONE, &["--renew-every", "20"]));
    let replayed = scene.play(&recording(&["/in"], 100, 50), &DEFAULT).unwrap();
    let line = &lines(&replayed)[0];
    // It is played ahead by the one that its queue holds, whenever it takes its callback that long.
    assert_eq!(line.received, recorded(&replayed).len() as u64, "{line:?}");
    assert!(line.dropped <= 5, "{line:?}");
}

#[test]
fn at_full_speed_who_has_no_subscription_for_a_moment_is_waited_for() {
    let scene = Scene::new();
    let apart = ["--renew-every", "20", "--apart-us", "10000"];
    let _relay = scene.start("standin_node", &relay("/renews", ONE, &apart));
    let replayed = scene.play(&recording(&["/in"], 100, 50), &DEFAULT).unwrap();
    let line = &lines(&replayed)[0];
    assert_eq!(line.received, recorded(&replayed).len() as u64, "{line:?}");
    assert!(line.dropped <= 5, "{line:?}");
}

#[test]
fn by_the_clock_what_a_node_took_before_and_after_it_subscribed_again_counts() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/renews", DEEP, &["--renew-every", "150"]));
    let replayed = scene.play(&recording(&["/in"], 3000, 50), &REALTIME).unwrap();
    let line = &lines(&replayed)[0];
    // It has answered each that it took, and no other.
    assert_eq!(line.received, recorded(&replayed).len() as u64);
    assert_eq!(line.received + line.dropped, 3000);
    // A subscription takes a while to be known, in which all may be lost: more than two of them
    // have taken 150 each.
    assert!(line.received > 300, "{line:?}");
}

#[test]
fn two_processes_with_one_name_have_a_line_each() {
    let scene = Scene::new();
    let _whole = scene.start("standin_node", &["--name", "/twin", "--sub", DEEP]);
    let slow = ["--name", "/twin", "--sub", ONE, "--delay-us", "4000"];
    let _slow = scene.start("standin_node", &slow);
    scene.await_subscriptions(2);
    let replayed = scene.play(&recording(&["/in"], 400, 50), &REALTIME).unwrap();
    let mut dropped: Vec<u64> = lines(&replayed).iter().map(|line| line.dropped).collect();
    dropped.sort_unstable();
    assert_eq!((dropped.len(), dropped[0]), (2, 0), "{:?}", replayed.ledger);
    assert!(dropped[1] > 100, "{dropped:?}");
    assert_eq!(replayed.ledger.dropped, dropped[1]);
    let replayed = scene.play(&recording(&["/in"], 100, 50), &LOCKSTEP).unwrap();
    let all: Vec<(u64, u64)> =
        lines(&replayed).iter().map(|line| (line.received, line.dropped)).collect();
    assert_eq!(all, [(100, 0), (100, 0)]);
}

#[test]
fn what_two_nodes_of_one_name_publish_is_recorded_though_the_graph_shows_that_of_one() {
    let scene = Scene::new();
    let _first = scene.start("standin_node", &relay("/twin", DEEP, &[]));
    let other = ["--pub", "/out_other:std_msgs/msg/String:3000:reliable", "--relay"];
    let other = [&["--name", "/twin", "--sub", DEEP], &other[..], &["/in=/out_other"]].concat();
    let _second = scene.start("standin_node", &other);
    scene.await_subscriptions(2);
    let replayed = scene.play(&recording(&["/in"], 400, 50), &DEFAULT).unwrap();
    let all = recorded(&replayed);
    let of = |topic: &str| all.iter().filter(|(on, ..)| on == topic).count();
    assert_eq!((of("/out"), of("/out_other"), all.len()), (400, 400, 800));
}

#[test]
fn who_is_in_the_graph_before_its_ledger_has_it_is_proved_as_anybody() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/late", TEN, &["--lists-late-ms", "400"]));
    let replayed = scene.play(&recording(&["/in"], 100, 50), &LOCKSTEP).unwrap();
    let all: Vec<(u64, u64, Strength)> =
        lines(&replayed).iter().map(|line| (line.received, line.dropped, line.strength)).collect();
    assert_eq!(all, [(100, 0, Strength::Called)]);
}

#[test]
fn a_namesake_that_does_not_count_is_no_proof_of_its_own() {
    let scene = Scene::new();
    // One counts and publishes alone; the other has the subscription.
    let talker = ["--name", "/twin", "--pub", "/out_other:std_msgs/msg/String:1:reliable"];
    let _talker = scene.start("standin_node", &talker);
    let _hidden = scene.start_uncounted("standin_node", &["--name", "/twin", "--sub", TEN]);
    let replayed = scene.play(&recording(&["/in"], 20, 50), &DEFAULT).unwrap();
    let all: Vec<(&str, u64, Strength)> = lines(&replayed)
        .iter()
        .map(|line| (line.node.as_str(), line.received, line.strength))
        .collect();
    assert_eq!(all, [("/twin", 0, Strength::Sent)]);
}

#[test]
fn who_does_not_count_is_not_proved_by_one_of_its_name_that_is_gone() {
    let scene = Scene::new();
    let gone = scene.start("standin_node", &["--name", "/twin", "--sub", TEN]);
    scene.await_subscriptions(1);
    assert!(gone.end());
    let _relay = scene.start("standin_node", &relay("/relay", TEN, &[]));
    let _hidden = scene.start_uncounted("standin_node", &["--name", "/twin", "--sub", TEN]);
    // A scout would get to know them at another moment than the player.
    let ask = Ask { wait_for: &["/relay", "/twin"], ..DEFAULT };
    let replayed = scene.play(&recording(&["/in"], 20, 50), &ask).unwrap();
    let all: Vec<(&str, u64, Strength)> = lines(&replayed)
        .iter()
        .map(|line| (line.node.as_str(), line.received, line.strength))
        .collect();
    assert_eq!(all, [("/relay", 20, Strength::Called), ("/twin", 0, Strength::Sent)]);
}

#[test]
fn who_begins_to_subscribe_during_the_play_has_no_more_than_it_took_from_then_on() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/relay", DEEP, &[]));
    let late = ["--name", "/late", "--sub", ONE];
    for mode in [Mode::Max, Mode::Lockstep, Mode::Realtime] {
        let mut started = None;
        let mut seen = |progress: Progress| {
            if progress.stage == Stage::Play && started.is_none() {
                started = Some(scene.start("standin_node", &late));
            }
        };
        let ask = Ask { mode, ..REALTIME };
        let replayed = scene.play_while(&recording(&["/in"], 3000, 50), &ask, &mut seen).unwrap();
        let line = lines(&replayed).iter().find(|line| line.node == "/late");
        let counts = scene.ledger.endpoints().unwrap();
        let took = counts.iter().rfind(|one| one.node == "/late").map(|one| one.counts.taken);
        if let Some(line) = line {
            // What it took before we knew it counts as missed, too.
            assert!(took >= Some(line.received), "{mode:?}: {took:?}, {line:?}");
            assert_eq!(line.received + line.dropped, 3000);
        }
        let relay = lines(&replayed).iter().find(|line| line.node == "/relay").unwrap();
        assert_eq!((relay.received, relay.dropped), (3000, 0), "{mode:?}");
    }
}

#[test]
fn a_first_callback_that_takes_its_time_loses_nothing_of_the_window() {
    // Less than the lead-in alone; and no busy machine lets a node stand still for as long as this.
    const SHORT: &str = "/in:sensor_msgs/msg/Imu:290:reliable";
    for program in ["standin_node", "standin_node_py"] {
        let scene = Scene::new();
        let blocks = relay("/blocks", SHORT, &["--first-us", "2500000"]);
        let _blocks = scene.start(program, &blocks);
        let ask = Ask { lead_in: 300 * MS, rate: 0.5, ..REALTIME };
        let replayed = scene.play(&recording(&["/in"], 600, 50), &ask).unwrap();
        let line = &lines(&replayed)[0];
        assert_eq!(
            (replayed.ledger.lead_in, line.received, line.dropped),
            (300, 300, 0),
            "{program}"
        );
        assert_window_answered(&replayed, 300..600, 50);
    }
}

#[test]
fn what_is_played_is_none_of_the_stacks_answers() {
    for mode in [Mode::Max, Mode::Lockstep] {
        let scene = Scene::new();
        // It says that it could publish what is played to it, and publishes twenty of its own.
        let silent = ["--name", "/silent", "--sub", TEN, "--pub", TEN, "--burst", "20"];
        let _silent = scene.start("standin_node", &silent);
        let ask = Ask { mode, record: &["/in"], drain: Duration::from_secs(2), ..DEFAULT };
        let replayed = scene.play(&recording(&["/in"], 50, 100), &ask).unwrap();
        assert!(recorded(&replayed).len() <= 20, "{mode:?}");
        assert_eq!(replayed.ledger.sent, 50);
    }
}

#[test]
fn what_one_of_two_lost_that_goes_just_before_the_end_is_not_hidden_by_the_other() {
    let scene = Scene::new();
    let goes = ["--sub", ONE, "--slow", "2:5000", "--gone", "2"];
    let node = ["--name", "/two", "--threads", "2", "--sub", DEEP];
    let two = scene.start("standin_node", &[&node[..], &goes].concat());
    scene.await_subscriptions(2);
    let is_gone =
        || scene.ledger.endpoints().unwrap().iter().filter(|one| !one.destroyed).count() == 1;
    let mut goes = false;
    let mut seen = |progress: Progress| {
        // Between the last three looks, which are half a second apart.
        if progress.stage == Stage::Play && progress.sent > 900 {
            match goes {
                false => two.signal("USR2"),
                true => eventually(is_gone),
            }
            goes = true;
        }
    };
    let ask = Ask { record: &["/none"], ..REALTIME };
    let replayed = scene.play_while(&recording(&["/in"], 1700, 50), &ask, &mut seen).unwrap();
    let line = &lines(&replayed)[0];
    // It took one of five at most. On a machine so busy that a look comes before it goes, that is known.
    assert!(line.strength == Strength::Sent || line.dropped > 400, "{line:?}");
}

/// A node with two subscriptions, of which the second one answers.
fn two<'a>(options: &[&'a str]) -> Vec<&'a str> {
    relay("/two", DEEP, &[&["--threads", "3", "--sub", DEEP], options].concat())
}

/// A play of five messages in a second, 30 in all, of whose two subscriptions the second one is away.
fn while_one_of_two_is_away(renew: &str) -> Replayed {
    let scene = Scene::new();
    let _two = scene.start("standin_node", &two(&["--renew", renew]));
    scene.await_subscriptions(2);
    let ask = Ask { rate: 0.005, ..REALTIME };
    scene.play(&recording(&["/in"], 30, 50), &ask).unwrap()
}

#[test]
fn by_the_clock_what_one_of_two_missed_while_it_was_away_is_lost() {
    let replayed = while_one_of_two_is_away("2:13:450000");
    let (line, answers) = (&lines(&replayed)[0], recorded(&replayed).len() as u64);
    assert!((20..30).contains(&answers), "{answers}");
    assert_eq!((line.received, line.dropped), (answers, 30 - answers), "{line:?}");
}

#[test]
fn one_of_two_that_comes_back_after_it_was_away_for_long_is_unproved() {
    let replayed = while_one_of_two_is_away("2:8:2500000");
    assert_eq!(lines(&replayed)[0].strength, Strength::Sent, "{:?}", replayed.ledger);
}

#[test]
fn what_one_of_two_lost_of_the_lead_in_hides_nothing_that_the_other_lost_of_the_window() {
    let scene = Scene::new();
    let away = ["--renew", "1:100:200000", "--renew", "2:900:100000"];
    let _two = scene.start("standin_node", &two(&away));
    scene.await_subscriptions(2);
    let ask = Ask { lead_in: 500 * MS, ..REALTIME };
    let replayed = scene.play(&recording(&["/in"], 1500, 50), &ask).unwrap();
    let line = &lines(&replayed)[0];
    // Of the first one nothing of the window is lost.
    let lost = 1000 - recorded(&replayed).len() as u64;
    assert!(lost > 20, "{lost}");
    assert_eq!(line.received + line.dropped, 1000);
    assert!(line.dropped >= lost, "{lost} were lost: {line:?}");
}

/// Waits until a topic has so many publishers, whoever counts.
fn await_publishers(scene: &Scene, topic: &str, many: usize) {
    let scout = scene.graph.player();
    eventually(|| scout.publishers_of(topic).unwrap().len() == many);
}

/// The warnings of a play beside a program of DDS that is no node.
fn warnings_beside(arguments: &[&str]) -> Vec<String> {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/relay", DEEP, &[]));
    let _program = scene.start_uncounted("dds_relay", arguments);
    scene.await_subscriptions(1);
    // The relay publishes /out as well.
    await_publishers(&scene, arguments[1], if arguments[1] == "/out" { 2 } else { 1 });
    let ask = Ask { rate: 0.1, ..REALTIME };
    let replayed = scene.play(&recording(&["/in"], 200, 50), &ask).unwrap();
    assert_eq!((replayed.ledger.received, replayed.ledger.dropped), (200, 0));
    replayed.playback.warnings
}

#[test]
fn a_program_of_dds_that_is_no_node_is_named_by_the_topic_that_it_reads() {
    let reads = "programs of DDS that are no nodes, or nodes of a name that another has, subscribe to /in \
                 (at least 1), so that what they got of ours can't be known";
    assert_eq!(warnings_beside(&["/in", "/other", "sensor_msgs/Imu"]), [reads]);
    let writes = "programs of DDS that are no nodes, or nodes of a name that another has, publish /out (at \
                  least 1), so that whether all of it was recorded can't be known";
    assert_eq!(warnings_beside(&["/other", "/out", "std_msgs/String"]), [writes]);
}

#[test]
fn what_the_command_line_publishes_beside_the_stack_is_compared_with_nothing() {
    let scene = Scene::new();
    let _relay = scene.start("standin_node", &relay("/relay", DEEP, &[]));
    let people = ["--name", "/_ros2cli_7", "--pub", "/out:std_msgs/msg/String:10:reliable"];
    let _people = scene.start_uncounted("standin_node", &people);
    scene.await_subscriptions(1);
    await_publishers(&scene, "/out", 2);
    let ask = Ask { rate: 0.1, ..REALTIME };
    let replayed = scene.play(&recording(&["/in"], 100, 50), &ask).unwrap();
    let why = "/_ros2cli_7 publishes /out in a process that does not count, so that whether all of it was \
               recorded can't be known";
    assert_eq!(replayed.playback.warnings, [why]);
}

#[test]
fn by_the_clock_who_is_slow_to_take_the_time_holds_nothing_up() {
    let scene = Scene::new();
    // A message comes each millisecond, and its callback takes twenty; so does that of the time.
    let slow = ["--sub", "/clock:rosgraph_msgs/msg/Clock:1:best_effort", "--delay-us", "20000"];
    let _relay = scene.start("standin_node", &relay("/slow", ONE, &slow));
    scene.await_subscriptions(2);
    let ask = Ask { use_sim_time: true, ..REALTIME };
    let replayed = scene.play(&recording(&["/in"], 100, 50), &ask).unwrap();
    let line = &lines(&replayed)[0];
    assert_eq!(line.received + line.dropped, 100, "{line:?}");
    assert!(line.dropped > 50, "{line:?}");
}

#[test]
fn what_the_command_line_has_missed_behind_its_end_is_not_lost() {
    // It takes the first ten, or all but the last three: nobody looks once more before the end.
    for (mode, takes) in [Mode::Realtime, Mode::Max, Mode::Lockstep]
        .into_iter()
        .flat_map(|mode| [(mode, "10"), (mode, "97")])
    {
        let missed = |name: &str| {
            let scene = Scene::new();
            let _relay = scene.start("standin_node", &relay("/relay", DEEP, &[]));
            let echo = ["--name", name, "--sub", DEEP, "--ends-after", takes];
            let _echo = scene.start("standin_node", &echo);
            scene.await_subscriptions(2);
            let replayed = scene.play(&recording(&["/in"], 100, 50), &Ask { mode, ..REALTIME });
            let lines = lines(&replayed.unwrap()).to_vec();
            let of = |node: &str| lines.iter().find(|one| one.node == node).map(|one| one.dropped);
            assert_eq!(of("/relay"), Some(0), "{mode:?} {takes}");
            of(name)
        };
        assert_eq!(missed("/_ros2cli_7"), None, "{mode:?} {takes}");
        // What has left in lock-step is sent no more.
        assert!(missed("/other").is_some(), "{mode:?} {takes}");
    }
}

#[test]
fn a_node_that_was_killed_and_started_again_is_known_by_the_process_that_runs() {
    let scene = Scene::new();
    let start = || scene.start("standin_node", &["--name", "/again", "--sub", TEN]);
    let killed = start();
    scene.await_subscriptions(1);
    drop(killed);
    let again = start();
    scene.await_subscriptions(2);
    let middleware = scene.middleware();
    let node = scene::joined(&middleware, Arc::default());
    let pid = node.audit(LONG).pid("/again").unwrap();
    assert_eq!(u32::try_from(pid).unwrap(), again.pid());
}
