//! What a stack used: known CPU time and memory, burnt in every way a process can end.
#![allow(clippy::unwrap_used, clippy::expect_used)]

mod worker;

use std::path::{Path, PathBuf};

use worker::exec::*;
use worker::*;

/// Holds so many MiB, burns half a second of its own CPU time, and rests for so many seconds once as
/// many as are named hold theirs: on a busy machine one may begin when another would have ended.
/// What it has burnt in all is its last word: to start and to take memory costs a slow machine more.
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
with open(os.path.join(folder, 'burnt-' + str(os.getpid())), 'w') as last:
    last.write(str(time.process_time()))
";

/// What the programs of a folder have burnt, in seconds; the folder is empty then.
fn burnt(folder: &Path) -> Vec<f64> {
    let met: Vec<_> = std::fs::read_dir(folder).unwrap().map(|file| file.unwrap().path()).collect();
    let last = |file: &PathBuf| file.file_name().unwrap().to_str().unwrap().starts_with("burnt-");
    let words = met.iter().filter(|file| last(file));
    let burnt = words.map(|file| std::fs::read_to_string(file).unwrap().parse().unwrap()).collect();
    met.iter().for_each(|file| std::fs::remove_file(file).unwrap());
    burnt
}

#[test]
fn cpu_time_and_memory_of_all_processes_are_counted_however_they_end() {
    let folder = tempfile::tempdir().unwrap();
    let program = folder.path().join("burn.py");
    std::fs::write(&program, BURN).unwrap();
    let burn = format!("/usr/bin/python3 {}", program.display());
    let met = folder.path().join("met");
    std::fs::create_dir(&met).unwrap();
    // One that the shell waits for, two at a time, and one that left its parent and group, whose
    // end is that of what can be read of the pipe: on a busy machine it takes its time.
    let script = format!(
        "met={}; {burn} 1 0 $met 1; {burn} 128 3.5 $met 2 & {burn} 128 3.5 $met 2 & wait; \
         mkfifo $met/end; (setsid {burn} 1 0 $met 1 9>$met/end &); read line <$met/end; cat",
        met.display()
    );
    let agent = Agent::start(1);
    for round in 0..2 {
        let given = run(&agent, &script, &[], b"input");
        assert!(given.abort.is_none(), "{:?}", given.abort);
        let result = given.result.unwrap();
        let usage = |key: &str| at(&result, &format!("stack.usage.{key}")).as_f64().unwrap();
        println!("usage: {}", at(&result, "stack.usage"));
        // Four burners of half a second each; the shell, and a burner's last moments, take little.
        let burnt = burnt(&met);
        let all: f64 = burnt.iter().sum();
        assert!(burnt.len() == 4 && all >= 2.0, "round {round}: {burnt:?}");
        let counted = usage("cpu_seconds") / all;
        assert!((0.97..1.25).contains(&counted), "round {round}: {burnt:?} {result}");
        assert!(usage("seconds") >= 3.5, "{result}");
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
        // Its end takes processor time too, on a slow machine more; a rosmaster would take as much
        // as the node.
        let more = 0.25_f64.max(0.4 * used[0]);
        assert!((-0.03..more).contains(&(cpu - used[0])), "{cpu} and {}", used[0]);
        let memory = at(&result, "stack.usage.peak_memory_bytes").as_u64().unwrap() as f64;
        assert!((0.98..1.02).contains(&(memory / 1024.0 / used[1])), "{memory} and {}", used[1]);
    }
}
