//! Messages that wait for the middleware go out several in a datagram, and never past those of another
//! topic: by what Cyclone DDS itself writes down of its datagrams.
#![allow(clippy::unwrap_used)]

mod standin;

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Instant;

use bagpipe_ros2player::{Player, PlayerOptions, Qos, Reliability};
use standin::{ALL, Graph, LONG, message, publish, threads_are, with_each_player};

/// Without heartbeats, which send what is kept back now and then.
const NO_HEARTBEATS: Qos = Qos { reliability: Reliability::BestEffort, ..ALL };

/// A player whose Cyclone DDS writes to a file what it sends.
fn traced(graph: &Graph, file: &Path) -> Player {
    let PlayerOptions { mut environment, .. } = graph.options();
    let own = environment.iter().rev().find(|(name, _)| name == "CYCLONEDDS_URI").unwrap();
    let settings = format!(
        "{},<CycloneDDS><Domain><Tracing><Category>trace</Category><OutputFile>{}</OutputFile>\
         </Tracing></Domain></CycloneDDS>",
        own.1.to_str().unwrap(),
        file.display()
    );
    environment.push(("CYCLONEDDS_URI".into(), settings.into()));
    Player::start(&PlayerOptions { environment, ..graph.options() }).unwrap()
}

/// The datagrams with messages that the thread sent which publishes, each as what of each message's
/// writer collects them, in their order.
fn datagrams(trace: &str) -> Vec<Vec<&str>> {
    let mut all = vec![Vec::new()];
    for line in trace.lines() {
        // A time, the domain, a thread's name and what it does.
        let Some((head, what)) = line.split_once(": ") else { continue };
        if !head.ends_with("player") && !head.ends_with("player-dds") {
            continue;
        }
        if let Some(message) = what.strip_prefix("xpack_addmsg ").filter(|it| it.contains("(data("))
        {
            all.last_mut().unwrap().push(message.split_once(' ').unwrap().0);
        } else if what.contains("xpack_send") && all.last().is_some_and(|last| !last.is_empty()) {
            all.push(Vec::new());
        }
    }
    assert_eq!(all.pop(), Some(vec![]), "something was kept back");
    all
}

fn signal(player: &Player, name: &str) {
    let pid = player.pid().to_string();
    assert!(Command::new("kill").args(["-s", name, &pid]).status().unwrap().success());
}

#[test]
fn what_waits_goes_out_together_and_not_past_another_topic() {
    with_each_player(|graph| {
        let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
        let file = folder.join(format!("trace-{}", std::process::id()));
        let _old = std::fs::remove_file(&file);
        let topics =
            ["/in", "/other"].map(|topic| format!("{topic}:std_msgs/msg/String:100:best_effort"));
        let node = graph.node(&["--name", "/sink", "--sub", &topics[0], "--sub", &topics[1]]);
        let player = traced(&graph, &file);
        let [one, other] = ["/in", "/other"]
            .map(|topic| player.advertise(topic, "std_msgs/String", &NO_HEARTBEATS).unwrap());
        let reader = graph.met("/in", &player, one);
        let other_reader = graph.met("/other", &player, other);
        // All of it stands in the ring before any goes out.
        signal(&player, "STOP");
        standin::eventually(|| threads_are(player.pid(), 'T'));
        let order = [(one, 10), (other, 1), (one, 1), (other, 3), (one, 2)];
        let all = order.iter().flat_map(|(to, count)| std::iter::repeat_n(*to, *count));
        for (number, to) in all.enumerate() {
            publish(&player, to, &message(number as u64, 1000)).unwrap();
        }
        signal(&player, "CONT");
        assert!(player.flush(Instant::now() + LONG).unwrap());
        assert_eq!((player.published(one), player.published(other)), (13, 4));
        let counts =
            |reader: &bagpipe_ros2ledger::Endpoint| graph.ledger.counts(reader.id).unwrap();
        standin::eventually(|| (counts(&reader).ended, counts(&other_reader).ended) == (13, 4));
        // A player that leaves sends that it does.
        let text = std::fs::read_to_string(&file).unwrap();
        drop(player);
        assert!(node.end());
        let sent = datagrams(&text);
        let lengths: Vec<usize> = sent.iter().map(Vec::len).collect();
        assert_eq!(lengths, order.map(|(_, count)| count), "{sent:?}");
        assert!(sent.iter().all(|writers| writers.iter().all(|writer| *writer == writers[0])));
        assert!(sent.windows(2).all(|two| two[0][0] != two[1][0]), "{sent:?}");
        std::fs::remove_file(&file).unwrap();
    });
}

/// Two libraries: another DDS that keeps nothing back, and one that calls it for a writer again and again,
/// which aborts where another DDS answers.
const OTHER_DDS: [(&str, &str); 2] = [
    ("other_dds.so", "int dds_create_writer(void) { return 7; }"),
    (
        "caller.so",
        "#include <pthread.h>\n#include <stdlib.h>\n#include <unistd.h>\n\
         extern int dds_create_writer(int, int, const void *, const void *);\n\
         static void *call(void *unused) {\n\
           for (;; usleep(100)) if (dds_create_writer(1, 2, 0, 0) != 7) abort();\n\
           return unused;\n\
         }\n\
         __attribute__((constructor)) static void begin(void) {\n\
           pthread_t thread;\n\
           if (pthread_create(&thread, 0, call, 0) != 0) abort();\n\
         }",
    ),
];

/// The libraries in a folder, as LD_PRELOAD has them: the one that calls is linked to the other or not.
fn other_dds(folder: &Path, linked: bool) -> OsString {
    let build = |(name, source): (&str, &str)| {
        let library = folder.join(name);
        let file = library.with_extension("c");
        std::fs::write(&file, source).unwrap();
        let mut cc = Command::new("cc");
        cc.args(["-shared", "-fPIC", "-o"]).arg(&library).arg(&file);
        cc.args((linked && name == "caller.so").then(|| folder.join("other_dds.so")));
        assert!(cc.status().unwrap().success());
        library.into_os_string()
    };
    OTHER_DDS.map(build).join(":".as_ref())
}

fn all_arrives_beside_another_dds(linked: bool) {
    let graph = Graph::new();
    let topic = "/in:std_msgs/msg/String:100:best_effort";
    let node = graph.node(&["--name", "/sink", "--sub", topic]);
    let folder = PathBuf::from(env!("CARGO_TARGET_TMPDIR"));
    let folder = folder.join(format!("other-dds-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let PlayerOptions { mut environment, .. } = graph.options();
    environment.push(("LD_PRELOAD".into(), other_dds(&folder, linked)));
    let options = PlayerOptions { environment, removed: Vec::new(), ..graph.options() };
    let player = Player::start(&options).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let publisher = player.advertise("/in", "std_msgs/String", &NO_HEARTBEATS).unwrap();
    let reader = graph.met("/in", &player, publisher);
    for number in 0..50 {
        publish(&player, publisher, &message(number, 100)).unwrap();
    }
    assert!(player.flush(Instant::now() + LONG).unwrap());
    standin::eventually(|| graph.ledger.counts(reader.id).unwrap().ended == 50);
    assert!(node.end());
}

#[test]
fn another_dds_of_the_process_makes_its_own_writers_and_nothing_is_kept_back_by_it() {
    [false, true].into_iter().for_each(all_arrives_beside_another_dds);
}
