//! What a stack used: known CPU time and memory, burnt in every way a process can end.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use worker::exec::*;
use worker::*;

/// Holds so many MiB, burns half a second of its own CPU time, and rests for so many seconds once as
/// many as are named hold theirs: on a busy machine one may begin when another would have ended.
const BURN: &str = "
import os, sys, time
held = b'x' * (int(sys.argv[1]) << 20)
while time.process_time() < 0.5:
    pass
mebibytes, seconds, folder, many = sys.argv[1], float(sys.argv[2]), sys.argv[3], int(sys.argv[4])
open(os.path.join(folder, mebibytes + '-' + str(os.getpid())), 'w').close()
late = time.monotonic() + 60
while sum(name.startswith(mebibytes + '-') for name in os.listdir(folder)) < many:
    assert time.monotonic() < late
    time.sleep(0.01)
time.sleep(seconds)
";

#[test]
fn cpu_time_and_memory_of_all_processes_are_counted_however_they_end() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("burn.py");
    std::fs::write(&program, BURN).unwrap();
    let burn = format!("/usr/bin/python3 {}", program.display());
    // One that the shell waits for, two at a time, and one that left its parent and group.
    let script = format!(
        "met=$(mktemp -d -p {folder}); {burn} 1 0 $met 1; {burn} 128 2 $met 2 & \
         {burn} 128 2 $met 2 & wait; (setsid {burn} 1 0 $met 1 &); sleep 2 & wait; cat",
        folder = folder.path().display()
    );
    let agent = Agent::start(1);
    for round in 0..2 {
        let given = run(&agent, &script, &[], b"input");
        assert!(given.abort.is_none(), "{:?}", given.abort);
        let result = given.result.unwrap();
        let usage = |key: &str| at(&result, &format!("stack.usage.{key}")).as_f64().unwrap();
        println!("usage: {}", at(&result, "stack.usage"));
        // Four burners of half a second each; the shell and `sleep` take next to nothing.
        assert!((2.0..2.5).contains(&usage("cpu_seconds")), "round {round}: {result}");
        assert!(usage("seconds") >= 4.0, "{result}");
        let mebibytes = at(&result, "stack.usage.peak_memory_bytes").as_u64().unwrap() >> 20;
        assert!((256..320).contains(&mebibytes), "round {round}: {mebibytes} MiB");
    }
    assert_eq!(agent.left(), []);
}

/// Subscribes, says what it used itself when it is asked to end, and is a node alone.
const NODE: &str = r#"
exec /usr/bin/python3 -c '
import resource, sys
import rospy
from std_msgs.msg import String
rospy.init_node("counted")
rospy.Subscriber("/chatter", String, lambda message: None)
held = b"x" * (200 << 20)
rospy.spin()
used = resource.getrusage(resource.RUSAGE_SELF)
print("used", used.ru_utime + used.ru_stime, used.ru_maxrss, file=sys.stderr)
'
"#;

#[test]
fn the_rosmaster_is_not_the_stack() {
    if without_ros() {
        return;
    }
    let agent = Agent::start(1);
    for case in [agent.case(NODE, &[]), agent.case_with_rosmaster(NODE)] {
        let (result, _) = agent.run(0, case, &chatter(20)).result();
        let stderr = at(&result, "stack.stderr").as_array().unwrap();
        let line = stderr.iter().filter_map(|line| line.as_str()).find(|l| l.starts_with("used "));
        let used: Vec<f64> =
            line.unwrap().split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        println!("node: {used:?}, agent: {}", at(&result, "stack.usage"));
        let cpu = at(&result, "stack.usage.cpu_seconds").as_f64().unwrap();
        assert!((-0.03..0.25).contains(&(cpu - used[0])), "{cpu} and {}", used[0]);
        let memory = at(&result, "stack.usage.peak_memory_bytes").as_u64().unwrap() as f64;
        assert!((0.98..1.02).contains(&(memory / 1024.0 / used[1])), "{memory} and {}", used[1]);
    }
}
