//! How real nodes end is evidence, whoever their parent is and whatever it says of them.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::process::Command;

use rmpv::Value;
use worker::*;

/// A node by its name, its last message and what it does then.
const NODE: &str = r#"
cat > "$ROS_HOME/node.py" <<'END'
import mmap, os, resource, signal, sys, threading, time, rospy
from std_msgs.msg import String
name, ends_at, way = sys.argv[1], int(sys.argv[2]), sys.argv[3]
awaited = sys.argv[4] if way == "holds" else None
while "SPARE" in os.environ and not os.path.exists(os.environ["SPARE"]):
    time.sleep(0.02)
if way == "elsewhere":
    os.getpid = lambda: 1
rospy.init_node(name)
out = rospy.Publisher("/echo", String, queue_size=1000)
held = rospy.Publisher("/held", String, queue_size=1000) if way == "holds" else None
received = [0]
def runs(node):
    listens = os.path.dirname(__file__) + node
    if not os.path.exists(listens) or not os.path.getsize(listens):
        return True
    try:
        stat = open("/proc/" + open(listens).read().strip() + "/stat").read()
        return stat.rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
def end():
    if way == "fails" and "ADDRESS" in os.environ:
        with open(os.environ["ADDRESS"] + ".part", "w") as file:
            file.write(rospy.get_node_uri())
        os.rename(os.environ["ADDRESS"] + ".part", os.environ["ADDRESS"])
    print(name + " has had enough", file=sys.stderr, flush=True)
    if way == "dumps":
        # The kernel looks at each page of it, which takes seconds, and writes one.
        resource.setrlimit(resource.RLIMIT_CORE, (resource.RLIM_INFINITY,) * 2)
        no_reserve = 0x4000
        kind = mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS | no_reserve
        large = mmap.mmap(-1, 128 << 30, flags=kind)
        large[0] = 1
    if way in ("segfault", "dumps"):
        os.kill(os.getpid(), signal.SIGSEGV)
    os._exit(3) if way == "fails" else rospy.signal_shutdown("done")
def answer(message):
    out.publish(message.data)
    received[0] += 1
    if way == "holds":
        # The play waits for its answers, and so goes on when the other one has ended.
        if received[0] == ends_at:
            open(os.path.dirname(__file__) + "/held", "w").close()
        while received[0] == ends_at and runs(awaited):
            time.sleep(0.02)
        held.publish(message.data)
    elif received[0] == ends_at:
        threading.Timer(0.8 if way == "later" else 0.05, end).start()
rospy.Subscriber("/chatter", String, answer, queue_size=1000)
if way in ("slowly", "later"):
    # Whoever asks it to end meanwhile does not learn how it would have ended.
    signal.signal(signal.SIGINT, lambda *_: os._exit(0))
with open(os.path.dirname(__file__) + "/" + name, "w") as file:
    file.write(str(os.getpid()))
rospy.spin()
if way in ("slowly", "later"):
    time.sleep(float(os.environ.get("LINGERS", "1")))
    os._exit(3)
END
"#;

/// A parent that, as roslaunch does, hides how its nodes end: `respawn` starts a node again.
const LAUNCH: &str = r#"
cat > "$ROS_HOME/launch.py" <<'END'
import os, subprocess, sys, time
python, here = "/usr/bin/python3", sys.argv[1] + "/node.py"
nodes = [subprocess.Popen([python, here, "bad", *sys.argv[2:4]])]
spare = None
if sys.argv[4] == "respawn":
    # On a slow machine rospy takes as long to load as the play: it is loaded beforehand.
    gate = {**os.environ, "SPARE": sys.argv[1] + "/spare"}
    spare = subprocess.Popen([python, here, "bad", "0", "never"], env=gate)
# The play begins when the first one listens: that one is known to the master then.
while not os.path.exists(sys.argv[1] + "/bad"):
    time.sleep(0.02)
nodes.append(subprocess.Popen([python, here, "good", *(sys.argv[5:] or ["0", "never"])]))
def has_ended(node):
    return os.waitid(os.P_PID, node.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is not None
while True:
    time.sleep(0.1)
    for place, node in enumerate(nodes):
        if node is not None and has_ended(node):
            # Whoever watches has that long to read how it ended, on a busy machine too.
            time.sleep(1)
            node.wait()
            open(sys.argv[1] + "/spare", "w").close()
            nodes[place], spare = spare, None
END
exec /usr/bin/python3 "$ROS_HOME/launch.py" "$ROS_HOME" "#;

/// Answers `getPid` where a node was, once that one has written its address and is gone.
const STRANGER: &str = r#"
import os, sys, time, urllib.parse, xmlrpc.server
deadline = time.monotonic() + 60
while True:
    assert time.monotonic() < deadline, "no node wrote its address"
    try:
        where = urllib.parse.urlsplit(open(sys.argv[1]).read())
        server = xmlrpc.server.SimpleXMLRPCServer(("", where.port), logRequests=False)
        break
    except OSError:
        time.sleep(0.01)
def pid(caller):
    with open(sys.argv[1] + ".answered", "w") as file:
        file.write(str(os.getpid()))
    return [1, "", os.getpid()]
server.register_function(pid, "getPid")
server.serve_forever()
"#;

/// Causes, names and signals of `stack.ended`, of a case of so many messages, 100 in a second.
fn ends(messages: u64, how: &str) -> Vec<(String, String, Option<i64>, String)> {
    ends_of(messages, &format!("{NODE}{LAUNCH}{how}"))
}

fn ends_of(messages: u64, script: &str) -> Vec<(String, String, Option<i64>, String)> {
    ends_within(messages, script, &[])
}

fn ends_within(
    messages: u64,
    script: &str,
    deadlines: &[(&str, f64)],
) -> Vec<(String, String, Option<i64>, String)> {
    let agent = Agent::start(1);
    let case = realtime(agent.case(script, deadlines), messages, &[]);
    ends_in(&agent, case, messages)
}

fn ends_in(
    agent: &Agent,
    case: Value,
    messages: u64,
) -> Vec<(String, String, Option<i64>, String)> {
    let (result, _) = agent.run(0, case, &chatter(messages)).result();
    println!("{}", at(&result, "stack.ended"));
    let ended = at(&result, "stack.ended").as_array().unwrap();
    let text = |end: &Value, key: &str| at(end, key).as_str().unwrap().to_owned();
    let found = ended.iter().map(|end| {
        (text(end, "cause"), text(end, "name"), at(end, "signal").as_i64(), text(end, "message"))
    });
    found.collect()
}

fn realtime(case: Value, messages: u64, allow: &[&str]) -> Value {
    let Value::Map(mut case) = case else { panic!() };
    case.retain(|(key, _)| !matches!(key.as_str(), Some("playback" | "window")));
    case.push(("window".into(), window(100_000_000_000, 100_000_000_000 + messages * 10_000_000)));
    case.push(("playback".into(), map(&[("mode", "realtime".into()), ("rate", 1.0.into())])));
    case.push(("faults".into(), map(&[("allow", strings(allow))])));
    Value::Map(case)
}

/// In lock-step with a node that holds the play.
fn held(case: Value) -> Value {
    let Value::Map(mut case) = case else { panic!() };
    case.retain(|(key, _)| key.as_str() != Some("playback"));
    let step = [("trigger", "/chatter"), ("answer", "/held")].map(|(key, of)| (key, of.into()));
    let step = map(&[&step[..], &[("deadline", 100.0.into())]].concat());
    let steps = Value::Array(vec![step]);
    case.push(("playback".into(), map(&[("mode", "lockstep".into()), ("steps", steps)])));
    Value::Map(case)
}

/// A case whose play begins once these nodes are connected.
fn awaiting(case: Value, nodes: &[&str]) -> Value {
    let Value::Map(mut case) = case else { panic!() };
    for (key, value) in &mut case {
        if let (Some("playback"), Value::Map(playback)) = (key.as_str(), value) {
            playback.push(("wait_for".into(), strings(nodes)));
        }
    }
    Value::Map(case)
}

fn short(ends: &[(String, String, Option<i64>, String)]) -> Vec<(&str, &str, Option<i64>)> {
    ends.iter().map(|(cause, name, signal, _)| (&**cause, &**name, *signal)).collect()
}

#[test]
fn a_node_that_its_parent_says_nothing_of_is_missed() {
    if without_ros() {
        return;
    }
    // However long it takes to end, that is before the last message.
    let ends = |way: &str| {
        let agent = Agent::start(1);
        let script = format!("{NODE}{LAUNCH}100 {way} keep 101 holds /bad");
        let case = held(realtime(agent.case(&script, &[]), 250, &[]));
        ends_in(&agent, awaiting(case, &["/bad", "/good"]), 250)
    };
    let crashed = ends("segfault");
    assert_eq!(short(&crashed), [("StackCrashed", "/bad", Some(11))]);
    let message = &crashed[0].3;
    assert!(message.starts_with("the node /bad was ended by signal 11 (SIGSEGV) at "), "{message}");
    assert!(
        message.ends_with("; the stack's last line on stderr: bad has had enough"),
        "{message}"
    );
    assert_eq!(short(&ends("fails")), [("StackCrashed", "/bad", None)]);
    assert_eq!(short(&ends("leaves")), [("NodeGone", "/bad", None)]);
}

#[test]
fn a_node_of_the_command_line_may_leave_during_the_play() {
    if without_ros() {
        return;
    }
    let node =
        |name: &str, rest: &str| format!("/usr/bin/python3 \"$ROS_HOME/node.py\" {name} {rest}\n");
    for (name, expected) in [("rostopic_7_1700000000000", None), ("bad", Some("/bad"))] {
        let leaves = node(name, "100 leaves");
        let holds = node("good", &format!("101 holds /{name}"));
        let script = format!("{NODE}{} & exec {holds}", leaves.trim_end());
        let agent = Agent::start(1);
        let nodes = [format!("/{name}"), "/good".to_owned()];
        let case = held(realtime(agent.case(&script, &[]), 250, &[]));
        let case = awaiting(case, &[&nodes[0], &nodes[1]]);
        let ended = ends_in(&agent, case, 250);
        let expected = expected.map(|name| ("NodeGone", name, None));
        assert_eq!(short(&ended), expected.into_iter().collect::<Vec<_>>());
    }
}

#[test]
fn a_node_that_is_started_again_is_seen() {
    if without_ros() {
        return;
    }
    let respawned = ends(800, "100 fails respawn");
    assert_eq!(respawned[0].0, "NodeRespawned");
    assert_eq!(respawned.len(), 1);
}

#[test]
fn a_stranger_at_the_address_of_a_node_that_ended_is_not_taken_for_it() {
    if without_ros() {
        return;
    }
    // A node of another slot, say: the kernel gives the same port again as soon as it is free.
    let folder = tempfile::tempdir().unwrap();
    let address = folder.path().join("uri");
    let stranger = Command::new("/usr/bin/python3").args(["-c", STRANGER]).arg(&address).spawn();
    let mut stranger = stranger.unwrap();
    let ended = ends_of(
        800,
        &format!("export ADDRESS={}\n{NODE}{LAUNCH}100 fails keep", address.display()),
    );
    let answered = std::fs::read_to_string(folder.path().join("uri.answered"));
    stranger.kill().unwrap();
    stranger.wait().unwrap();
    assert_eq!(answered.unwrap(), stranger.id().to_string());
    assert_eq!(short(&ended), [("StackCrashed", "/bad", None)]);
    assert!(ended[0].3.contains("ended with exit status 3"), "{}", ended[0].3);
}

// Promise: done-is-no-fault
#[test]
fn a_crash_right_after_the_last_answer_is_seen_and_a_good_end_is_none() {
    if without_ros() {
        return;
    }
    let crashed = ends(250, "250 segfault keep");
    assert_eq!(short(&crashed), [("StackCrashed", "/bad", Some(11))]);
    assert_eq!(short(&ends(250, "250 leaves keep")), []);
    assert_eq!(short(&ends(250, "0 never keep")), []);
}

// Promise: no-evidence-no-pass
#[test]
fn a_node_that_has_left_is_not_asked_to_end_before_it_has_ended_by_itself() {
    if without_ros() {
        return;
    }
    let crashed = ends(250, "250 slowly keep");
    assert_eq!(short(&crashed), [("StackCrashed", "/bad", None)]);
    assert!(crashed[0].3.contains("ended with exit status 3"), "{}", crashed[0].3);
}

// Promise: no-evidence-no-pass
#[test]
fn a_node_that_leaves_while_another_ends_is_left_to_end_as_well() {
    if without_ros() {
        return;
    }
    let node = |name, way| format!("/usr/bin/python3 \"$ROS_HOME/node.py\" {name} 250 {way} &\n");
    let nodes = [node("bad", "slowly"), node("late", "later")].concat();
    // The one leaves long before the other has ended, and both end while they are still waited for.
    let script = format!("{NODE}export LINGERS=2.5\n{nodes}sleep 600");
    let agent = Agent::start(1);
    // Who misses a message never leaves.
    let case = awaiting(realtime(agent.case(&script, &[]), 250, &[]), &["/bad", "/late"]);
    let crashed = ends_in(&agent, case, 250);
    let expected = [("StackCrashed", "/bad", None), ("StackCrashed", "/late", None)];
    assert_eq!(short(&crashed), expected);
}

#[test]
fn a_node_that_left_and_whose_process_is_not_known_is_not_waited_for() {
    if without_ros() {
        return;
    }
    let script =
        format!("{NODE}/usr/bin/python3 \"$ROS_HOME/node.py\" bad 250 elsewhere; sleep 600");
    let agent = Agent::start(1);
    let case = realtime(agent.case(&script, &[]), 250, &[]);
    let (result, _) = agent.run(0, case, &chatter(250)).result();
    assert_eq!(at(&result, "stack.ended").as_array().unwrap().len(), 0);
    println!("{}", at(&result, "timings"));
    assert!(at(&result, "timings.stop").as_f64().unwrap() < 5.0);
}

// Promise: no-evidence-no-pass
#[test]
fn a_parent_that_waits_for_a_node_does_not_hide_how_it_ended() {
    if without_ros() {
        return;
    }
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap();
    let mut numbers = kernel.split(['.', '-']).map_while(|number| number.parse::<u32>().ok());
    if (numbers.next(), numbers.next()) < (Some(6), Some(15)) {
        println!(
            "skipped: Linux {kernel} keeps how a process ended to its parent (docs/limits.md)"
        );
        return;
    }
    let script = format!("{NODE}/usr/bin/python3 \"$ROS_HOME/node.py\" bad 250 slowly; sleep 600");
    let crashed = ends_of(250, &script);
    assert_eq!(short(&crashed), [("StackCrashed", "/bad", None)]);
    assert!(crashed[0].3.contains("ended with exit status 3"), "{}", crashed[0].3);
}

// Promise: no-evidence-no-pass
#[test]
fn a_crash_whose_core_is_still_written_is_seen() {
    if without_ros() {
        return;
    }
    let pattern = std::fs::read_to_string("/proc/sys/kernel/core_pattern").unwrap();
    if pattern.trim().is_empty() || pattern.starts_with('|') {
        println!(
            "skipped: cores go to {pattern:?}, to which a sparse one is not written in seconds"
        );
        return;
    }
    let script = format!("{NODE}cd \"$ROS_HOME\"; exec /usr/bin/python3 node.py bad 250 dumps");
    let crashed = ends_within(250, &script, &[("drain", 0.5)]);
    assert_eq!(short(&crashed), [("StackCrashed", "/bad", Some(11))]);
}

#[test]
fn an_allowed_end_of_the_command_ends_no_replay() {
    if without_ros() {
        return;
    }
    // The command ends well in the middle, while its node holds the play, and that one goes on.
    let script = format!(
        "{NODE}echo $$ > \"$ROS_HOME/command\"\n\
         /usr/bin/python3 \"$ROS_HOME/node.py\" echo 10 holds /command &\n\
         while [ ! -e \"$ROS_HOME/held\" ]; do sleep 0.05; done; exit 0"
    );
    let agent = Agent::start(1);
    let case = |allow: &[&str]| held(realtime(agent.case(&script, &[]), 250, allow));
    let abort = agent.run(0, case(&[]), &chatter(250)).abort();
    assert_eq!((&*abort.reason, abort.exit_status), ("StackExited", Some(0)));
    let (result, _) = agent.run(0, case(&["StackExited"]), &chatter(250)).result();
    assert_eq!(at(&result, "stack.ended.0.cause").as_str(), Some("StackExited"));
    assert_eq!(at(&result, "ledger.received").as_u64(), Some(250));
}

/// A node that has its rosmaster sleep before it crashes itself, at its thirtieth message.
const SILENCES: &str = r#"
cat > "$ROS_HOME/node.py" <<'END'
import os, signal, rospy
from std_msgs.msg import String
rospy.init_node("crasher")
out = rospy.Publisher("/echo", String, queue_size=1000)
port = os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1].strip("/")
def is_master(pid):
    try:
        words = open("/proc/" + pid + "/cmdline").read()
    except OSError:
        return False
    return "rosmaster" in words and port in words and "sh" not in words.split("\0")[0]
received = [0]
def answer(message):
    out.publish(message.data)
    received[0] += 1
    if received[0] == 30:
        for pid in filter(is_master, filter(str.isdigit, os.listdir("/proc"))):
            os.kill(int(pid), signal.SIGSTOP)
        os.kill(os.getpid(), signal.SIGSEGV)
rospy.Subscriber("/chatter", String, answer, queue_size=1000)
rospy.spin()
END
/usr/bin/python3 "$ROS_HOME/node.py" &
wait
sleep 1000
"#;

#[test]
fn a_crash_is_the_reason_also_where_the_rosmaster_does_not_answer_any_more() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let abort = agent.run(0, agent.case_with_rosmaster(SILENCES), &chatter(50)).abort();
    assert_eq!(abort.reason, "StackCrashed", "{}", abort.message);
    let then = "; then: which nodes were there during the case can't be known";
    assert!(abort.message.contains("SIGSEGV") && abort.message.contains(then), "{}", abort.message);
}

#[test]
fn a_crash_that_the_job_allows_leaves_the_rosmaster_s_silence_the_reason() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    let Value::Map(mut case) = agent.case_with_rosmaster(SILENCES) else { panic!() };
    case.retain(|(key, _)| key.as_str() != Some("faults"));
    case.push(("faults".into(), map(&[("allow", strings(&["StackCrashed"]))])));
    let abort = agent.run(0, Value::Map(case), &chatter(50)).abort();
    assert_eq!(abort.reason, "RosMasterFailed", "{}", abort.message);
}
