//! What a stack used: known CPU time and memory, burnt in every way a process can end.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use worker::exec::*;
use worker::*;

/// Holds so many MiB, burns half a second of its own CPU time and rests for so many seconds.
const BURN: &str = "
import sys, time
held = b'x' * (int(sys.argv[1]) << 20)
while time.process_time() < 0.5:
    pass
time.sleep(float(sys.argv[2]))
";

#[test]
fn cpu_time_and_memory_of_all_processes_are_counted_however_they_end() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("burn.py");
    std::fs::write(&program, BURN).unwrap();
    let burn = format!("/usr/bin/python3 {}", program.display());
    // One that the shell waits for, two at a time, and one that left its parent and group.
    let script = format!(
        "{burn} 1 0; {burn} 128 2 & {burn} 128 2 & wait; (setsid {burn} 1 0 &); sleep 2 & wait; cat"
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
    for _ in 0..2 {
        let (result, _) = agent.run(0, agent.case(NODE, &[]), &chatter(20)).result();
        let stderr = at(&result, "stack.stderr").as_array().unwrap();
        let said = stderr.iter().filter_map(|line| line.as_str()).find(|l| l.starts_with("used "));
        let said: Vec<f64> =
            said.unwrap().split(' ').skip(1).map(|word| word.parse().unwrap()).collect();
        println!("node: {said:?}, agent: {}", at(&result, "stack.usage"));
        let cpu = at(&result, "stack.usage.cpu_seconds").as_f64().unwrap();
        assert!((-0.03..0.25).contains(&(cpu - said[0])), "{cpu} and {}", said[0]);
        let memory = at(&result, "stack.usage.peak_memory_bytes").as_u64().unwrap() as f64;
        assert!((0.98..1.02).contains(&(memory / 1024.0 / said[1])), "{memory} and {}", said[1]);
    }
}
